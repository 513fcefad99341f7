"""Verbs that serve other processes: ``serve``, ``coordinate``, and ``certificates`` for the TLS of a cluster."""

import hashlib
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clearcap.cli.drive import drive
from clearcap.cli.options import Decide, NoReport, StoreUrl, on_cluster
from clearcap.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.plan import Plan
    from campaign.store import Store


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

    At its first start it prints a link by which you log in once. It answers this machine only, unless it has a
    certificate or runs behind a proxy.
    """
    from campaign.errors import SpecError, StoreError
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    try:
        from clearcap.web.server import check_settings, first_login, instance_lock, read_configuration, serve_http
        from clearcap.web.server import login_link as new_link
        from clearcap.web.settings import Settings
        from clearcap.web.web_service import open_service
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
    settings = Settings(
        store,
        data or data_folder(files.full_url),
        host,
        port,
        tuple(name or ()),
        https,
        behind_proxy,
        tuple(proxy) if proxy else Settings.proxies,
        options,
        **read_configuration(config),
    )
    check_settings(settings)
    service = open_service(settings)
    if login_link is not None:
        made = new_link(service, login_link)
        service.close()
        print_json({"address": settings.address, "login": made}) if json else print_text(made)
        return
    with instance_lock(settings):
        link, file = first_login(service, is_terminal=(sys.stdout if json else sys.stderr).isatty())
        if json:
            where_data = {"store": service.store.url, "data": str(settings.data)}
            login = {"login": link, "login_file": None if file is None else str(file)}
            print_json({"address": settings.address, **login, **where_data})
        else:
            say(f"serving store {service.store.url} at {settings.address}; Ctrl-C ends it")
            say(_how_to_log_in(settings.data, link, file))
        serve_http(service)


def _how_to_log_in(data: Path, link: str | None, file: Path | None) -> str:
    """Return what the operator of a server reads at its start."""
    if link is not None:
        return f"log in once, within 15 minutes: {link}"
    if file is not None:
        return f"the link by which admin logs in once, within 15 minutes, is in {file}"
    return f"log in there; without a password use: clearcap serve --login-link USER --data {data}, with these options"


def data_folder(url: str) -> Path:
    """Return the default data folder of a server, which differs for each store."""
    base = Path(os.environ.get("XDG_DATA_HOME") or Path("~/.local/share").expanduser())
    return base / "clearcap" / f"server-{hashlib.sha256(url.encode()).hexdigest()[:12]}"


@on_cluster
def coordinate(
    where: "Cluster",
    campaign: Annotated[
        str | None, typer.Argument(help="Id of the campaign; without it, all queued campaigns.")
    ] = None,
    store: StoreUrl = "runs",
    once: Annotated[bool, typer.Option("--once", help="Without an id: end when no campaign is queued.")] = False,
    decide: Decide = None,
    no_report: NoReport = False,
    parent: Annotated[
        int | None, typer.Option(hidden=True, help="End when this process ends, which has started it.")
    ] = None,
    json: Json = False,
) -> None:
    """Compute a planned campaign; without an id, serve the store: compute every queued campaign.

    A process supervisor may kill and restart it at any time.
    """
    from campaign.store import open_store
    from clearcap.cli.termination import terminate_with_parent

    if parent is not None:
        terminate_with_parent(parent)
    opened = open_store(store)
    if campaign is None:
        from campaign.coordinator.service import serve

        report, decides = None if no_report else _report, None if decide is False else _decide
        completed = serve(opened, where, report=report, decide=decides, once=once)
        if json:
            print_json({"store": opened.url, "campaigns": completed})
        return
    drive(opened, opened.plan(opened.find(campaign)), where, with_report=not no_report, as_json=json, decide=decide)


def _decide(store: "Store", plan: "Plan", cluster: "Cluster") -> None:
    """Compute the aimed campaigns that a completed campaign needs."""
    from functools import partial

    from campaign.coordinator.coordinate import coordinate as computed
    from clearcap.questions.decision import decide

    decide(store, plan, partial(computed, store, cluster=cluster, is_served=True), say)


def _report(store: "Store", plan: "Plan") -> None:
    """Write the report of a completed campaign; what writes it is loaded then, not while the service waits."""
    from clearcap.questions.report import report

    report(store, plan)


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
