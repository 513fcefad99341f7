"""``clearcap certificates``: mutual TLS for a campaign cluster in one command."""

from pathlib import Path
from typing import Annotated

import typer

from campaign.cli.output import Json, print_json


def certificates(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write them to.")],
    days: Annotated[int, typer.Option(help="Days they are valid, up to 825.")] = 365,
    hosts: Annotated[
        list[str] | None,
        typer.Option("--host", help="A name or address of the scheduler; may be repeated. Dask checks none."),
    ] = None,
    json: Json = False,
) -> None:
    """Make an authority and certificates for the mutual TLS of a cluster.

    Dask lets in whoever has a certificate of the same authority, whatever host it is on: keep the folder private, give
    each machine only its role's files, and make a new folder for each cluster. The authority's own key is not kept.
    """
    from campaign.errors import SpecError

    try:
        from campaign.cluster.tls_certificates import make_certificates
    except ImportError as error:
        raise SpecError("certificates: needs a package that is not here; pip install 'clearcap[tls]'") from error
    paths = make_certificates(folder, days, hosts or ())
    if json:
        print_json({"folder": str(folder), "days": days, "files": {name: str(path) for name, path in paths.items()}})
        return
    for path in paths.values():
        print(path)
