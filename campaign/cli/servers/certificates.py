"""``clearcap certificates``: mutual TLS for a campaign cluster in one command."""

from pathlib import Path
from typing import Annotated

import typer

from campaign.cli.output import Json, print_json, print_text


def certificates(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write the certificates to.")],
    days: Annotated[int, typer.Option(help="Number of days for which they are valid, at most 825.")] = 365,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            help="Host name or address of the scheduler, written into its certificate; may be repeated. Dask itself"
            " does not check it.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Make a certificate authority and the certificates for mutual TLS in a cluster.

    Dask accepts every process with a certificate of the same authority, on any host. Keep the folder private, give
    each machine only the files of its role, and make a new folder for each cluster. The authority's own key is not
    kept.
    """
    from campaign.cluster.tls_certificates import make_certificates

    paths = make_certificates(folder, days, hosts or ())
    if json:
        print_json({"folder": str(folder), "days": days, "files": {name: str(path) for name, path in paths.items()}})
        return
    for path in paths.values():
        print_text(path)
