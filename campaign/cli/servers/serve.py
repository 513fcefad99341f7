"""``clearcap serve``: serve pages and the API over a store."""

import hashlib
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster

_PANEL = "Where to listen"


@on_cluster
def serve(
    where: "Cluster",
    store: StoreUrl = "runs",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port.", rich_help_panel=_PANEL)] = 8700,
    host: Annotated[
        str, typer.Option(help="Address to listen on; any but loopback needs TLS.", rich_help_panel=_PANEL)
    ] = "127.0.0.1",
    name: Annotated[
        list[str] | None,
        typer.Option(help="Host name by which browsers address the server; may be repeated.", rich_help_panel=_PANEL),
    ] = None,
    https_cert: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Certificate for HTTPS, PEM.", rich_help_panel=_PANEL)
    ] = None,
    https_key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Its private key.", rich_help_panel=_PANEL)
    ] = None,
    behind_proxy: Annotated[
        bool,
        typer.Option("--behind-proxy", help="A proxy in front of the server terminates TLS.", rich_help_panel=_PANEL),
    ] = False,
    proxy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ADDRESS",
            help="With --behind-proxy: address or network of the proxy, by default loopback; may be repeated.",
            rich_help_panel=_PANEL,
        ),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of accounts, audit trail and sign-offs; by default one for each store."
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML file with limits and the company's login service.")
    ] = None,
    no_drive: Annotated[
        bool, typer.Option("--no-drive", help="Start no coordinator; another one computes what is queued.")
    ] = False,
    login_link: Annotated[
        str | None, typer.Option(metavar="USER", help="Print a link by which a user logs in once, and exit.")
    ] = None,
    json: Json = False,
) -> None:
    """Serve pages and the API over a store, and compute what is queued in it.

    It prints a link by which you log in once. It answers this machine only, unless it has a certificate or stands
    behind a proxy.
    """
    from campaign.errors import SpecError, StoreError
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    try:
        from campaign.web.configuration import read_configuration
        from campaign.web.only_server import only_server
        from campaign.web.server import check_settings, serve_http
        from campaign.web.server import login_link as new_link
        from campaign.web.settings import Settings
        from campaign.web.web_service import open_service
    except ModuleNotFoundError as error:
        raise SpecError(f"clearcap serve needs the package {error.name}: pip install 'clearcap[web]'") from error

    if (https_cert is None) != (https_key is None):
        raise SpecError("--https-cert, --https-key: one of them is missing; HTTPS needs both")
    if proxy and not behind_proxy:
        raise SpecError("--proxy: works only with --behind-proxy; add that, or leave --proxy out")
    https = (https_cert, https_key) if https_cert and https_key else None
    files = open_store(store, QUICK).files
    if not no_drive and login_link is None:
        with suppress(StoreError):  # an unreachable disk or server may come back: the coordinator waits
            files.check_writable()
    options = None if no_drive else tuple(where.options())
    limits, oidc, webhook_hosts = read_configuration(config)
    settings = Settings(
        store,
        data or _data_folder(files.full_url),
        host,
        port,
        tuple(name or ()),
        https,
        behind_proxy,
        tuple(proxy) if proxy else Settings.proxies,
        options,
        limits=limits,
        oidc=oidc,
        webhook_hosts=webhook_hosts,
    )
    check_settings(settings)
    service = open_service(settings)
    if login_link is not None:
        made = new_link(service, login_link)
        service.close()
        print_json({"address": settings.address, "login": made}) if json else print_text(made)
        return
    with only_server(settings):
        has_login = any(user.has_password for user in service.users.all()) or oidc is not None
        link = new_link(service) if settings.is_local or not has_login else None
        if json:
            print_json(
                {"address": settings.address, "login": link, "store": service.store.url, "data": str(settings.data)}
            )
        else:
            say(f"serving store {service.store.url} at {settings.address}; Ctrl-C ends it")
            say(f"log in once, within 15 minutes: {link}" if link else "log in there by password or company account")
        serve_http(service)


def _data_folder(url: str) -> Path:
    """Return the default data folder of a server, which differs for each store."""
    base = Path(os.environ.get("XDG_DATA_HOME") or Path("~/.local/share").expanduser())
    return base / "clearcap" / f"server-{hashlib.sha256(url.encode()).hexdigest()[:12]}"
