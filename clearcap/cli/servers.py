"""Verbs of who operates a server: ``serve``, ``backup``, ``restore``, ``doctor``; ``coordinate``, ``certificates``."""

import hashlib
import os
import sys
import time
from contextlib import closing, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.waits import counted
from clearcap.cli.computing import drive
from clearcap.cli.options import Decide, NoReport, StoreUrl, on_cluster, opened_store
from clearcap.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.plan import Plan
    from campaign.store import Store
    from clearcap.web.maintenance import Contents

_listen = partial(typer.Option, rich_help_panel="Where to listen")


@on_cluster
def serve(
    where: "Cluster",
    store: StoreUrl = "runs",
    port: Annotated[int, _listen(min=0, max=65535, help="Port.")] = 8700,
    host: Annotated[str, _listen(help="Address to listen on; any but loopback needs TLS.")] = "127.0.0.1",
    name: Annotated[
        list[str] | None, _listen(help="Host name by which browsers address the server; may be repeated.")
    ] = None,
    https_cert: Annotated[Path | None, _listen(metavar="FILE", help="Certificate for HTTPS, PEM.")] = None,
    https_key: Annotated[Path | None, _listen(metavar="FILE", help="Its private key.")] = None,
    behind_proxy: Annotated[
        bool, _listen("--behind-proxy", help="A proxy in front of the server terminates TLS.")
    ] = False,
    proxy: Annotated[
        list[str] | None,
        _listen(
            metavar="ADDRESS",
            help="With --behind-proxy: address or network of the proxy, by default loopback; may be repeated.",
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
    files = opened_store(store).files
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
            hint = "log in there; without a password use: clearcap serve --login-link USER"
            how = f"{hint} --data {settings.data}, with these options"
            if link is not None:
                how = f"log in once, within 15 minutes: {link}"
            elif file is not None:
                how = f"the link by which admin logs in once, within 15 minutes, is in {file}"
            say(how)
        serve_http(service)


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
        int | None, typer.Option(hidden=True, help="End when this process, which has started it, ends.")
    ] = None,
    json: Json = False,
) -> None:
    """Compute a planned campaign; without an id, serve the store: compute every queued campaign.

    A process supervisor may kill and restart it at any time.
    """
    from clearcap.cli.termination import terminate_with_parent

    if parent is not None:
        terminate_with_parent(parent)
    opened = opened_store(store, is_patient=True)
    if campaign is None:
        from campaign.coordinator.service import serve

        report, decides = None if no_report else _report, None if decide is False else _decide
        completed = serve(opened, where, report=report, decide=decides, once=once)
        if json:
            print_json({"store": opened.url, "campaigns": completed})
        return
    drive(opened, opened.plan(opened.find(campaign)), where, with_report=not no_report, as_json=json, decide=decide)


def _decide(store: "Store", plan: "Plan", cluster: "Cluster") -> None:
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


PASSPHRASE = "CLEARCAP_BACKUP_PASSPHRASE"  # environment variable
Data = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder of the server; by default the one of this store.")
]
Encrypted = Annotated[bool, typer.Option("--encrypted", help=f"Use the passphrase in the variable {PASSPHRASE}.")]
File = Annotated[Path, typer.Argument(metavar="FILE", help="The backup.")]


def backup(
    file: File, store: StoreUrl = "runs", data: Data = None, encrypted: Encrypted = False, json: Json = False
) -> None:
    """Back up accounts, audit trail, sign-offs and signing key of a server, which may run meanwhile.

    Copy the store afterwards, as you copy other files: it then holds everything that was signed.
    """
    from clearcap.web.maintenance import audit_fault, back_up

    folder = data or _folder_of(store)
    contents = back_up(folder, file, time.time(), _passphrase(encrypted))
    if json:
        print_json({"file": str(file), **asdict(contents)})
        return
    print_text(f"{file}: {_words(contents)}")
    if (entry := audit_fault(folder)) is not None:
        say(f"warning: entry {entry} of the audit trail was changed, or is missing")


def restore(
    file: File,
    store: StoreUrl = "runs",
    data: Data = None,
    check: Annotated[bool, typer.Option("--check", help="Only check the backup; write nothing.")] = False,
    encrypted: Encrypted = False,
    json: Json = False,
) -> None:
    """Restore the folder of a server from a backup, and compare its sign-offs with the store.

    Restore the store first. A folder that is not empty is refused: move it away.
    """
    from clearcap.web.maintenance import check_backup
    from clearcap.web.maintenance import restore as restored

    folder = data or _folder_of(store)
    contents = check_backup(file, _passphrase(encrypted)) if check else restored(file, folder, _passphrase(encrypted))
    differing = [] if check else _differing(store, folder)
    if json:
        where = None if check else str(folder)
        print_json({"file": str(file), "data": where, **asdict(contents), "differing": differing})
    else:
        print_text(f"{file}: {'whole' if check else f'restored to {folder}'}: {_words(contents)}")
        for campaign in differing:
            say(f"warning: {campaign} is signed, and the store does not hold what was signed; restore the store too")
    if differing:
        raise typer.Exit(1)


def _differing(store: str, folder: Path) -> list[str]:
    """Return the signed campaigns that are not in the store as they were signed."""
    from clearcap.web.access.database import DATABASE, Database
    from clearcap.web.signing_service import SigningService

    opened, found = opened_store(store), []
    with closing(Database(folder / DATABASE)) as database:
        signing, stored = SigningService(database, opened), set(opened.campaigns())
        for row in database.rows("SELECT DISTINCT campaign FROM signoffs ORDER BY campaign"):
            campaign = row["campaign"]
            try:
                is_same = not signing.is_signed(campaign) or (
                    campaign in stored and not signing.signoffs(campaign, anew=True)[-1].differences
                )
            except CampaignError:
                is_same = False
            found += [] if is_same else [campaign]
    return found


def doctor(store: StoreUrl = "runs", data: Data = None, json: Json = False) -> None:
    """Check a store and the folder of its server: versions, access, room, clocks, queue, database.

    Exit status 1 if anything is at fault; nothing is changed.
    """
    from clearcap.web.maintenance import FAULT, examine

    findings = examine(opened_store(store), data or _folder_of(store))
    if json:
        print_json([asdict(each) for each in findings])
    else:
        for each in findings:
            print_text(f"{each.status:8}{each.what:10}{each.text}")
    if any(each.status == FAULT for each in findings):
        raise typer.Exit(1)


def _folder_of(store: str) -> Path:
    return data_folder(opened_store(store).files.full_url)


def _passphrase(encrypted: bool) -> str | None:
    if not encrypted:
        return None
    if not (passphrase := os.environ.get(PASSPHRASE)):
        raise SpecError(f"--encrypted: the environment variable {PASSPHRASE} is missing; set the passphrase")
    return passphrase


def _words(contents: "Contents") -> str:
    has = f"{counted(contents.users, 'user')}, {counted(contents.signoffs, 'signed document')}"
    return f"{has}, {contents.audit} entries of the audit trail, the newest {contents.newest[:12] or 'none'}"
