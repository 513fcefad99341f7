"""Arguments and options that several verbs share: which campaign or mechanism, which store or server, which cluster."""

import inspect
import shlex
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import SpecError
from campaign.processes import SERVER, STORE
from clearcap.cli.output import say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.plan import Plan
    from campaign.store import Store
    from clearcap.client.remote_server import RemoteServer
    from engine import Mechanism


AT_SERVER = {"driver": "service", "pid": None, "log": None}  # the coordinator of a campaign submitted to a server
ServerUrl = Annotated[
    str | None,
    typer.Option(
        "--server",
        metavar="URL",
        envvar=SERVER,
        help="Use this clearcap server instead of a store; the token is read from CLEARCAP_TOKEN.",
    ),
]
CampaignId = Annotated[str, typer.Argument(metavar="ID", help="Id of the campaign; its first letters are enough.")]
Id = Annotated[str | None, typer.Argument(help="Id of the campaign; not needed if it is the only one.")]


def _warn_of_secret(context: typer.Context, url: str) -> str:
    """Warn once that other users can see a password on the command line, and say where to put it instead."""
    from campaign.store.files.private_url import PrivateUrl

    source = context.get_parameter_source("store")
    if PrivateUrl(url).has_secrets and source is not None and source.name == "COMMANDLINE":
        say(
            f"warning: --store {PrivateUrl(url)}: any user of this machine can read the password in the list of"
            f" processes; put the URL into the environment variable {STORE}, or the password into fsspec's"
            " configuration (docs/campaign.md)"
        )
    return url


StoreUrl = Annotated[
    str,
    typer.Option("--store", envvar=STORE, help="Folder or URL where the results are kept.", callback=_warn_of_secret),
]

Campaign = Annotated[str, typer.Argument(help="A shipped campaign (c60) or a campaign file.")]
Samples = Annotated[int | None, typer.Option(help="Number of samples, in place of the file's.")]
Seed = Annotated[int | None, typer.Option(help="Seed of the random numbers, in place of the file's.")]
BatchSize = Annotated[
    int | None, typer.Option(min=1, help="Samples per batch of a new campaign; by default a batch takes about 10 s.")
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Do not write the report.")]
Decide = Annotated[
    bool | None,
    typer.Option(
        "--decide/--no-decide",
        help="Compute further runs for verdicts that the samples leave open; by default where a report is written.",
        show_default=False,
    ),
]

_where = partial(typer.Option, rich_help_panel="Where to compute")


def cluster_from(
    scheduler: Annotated[
        str | None,
        _where(
            metavar="ADDRESS",
            help="Use this dask scheduler and its workers: tls://host:port, tcp://host:port, or its scheduler file.",
        ),
    ] = None,
    cluster: Annotated[
        str,
        _where(
            metavar="KIND",
            help="Where to start workers: local (this machine), or as jobs: slurm, oar, pbs, kubernetes.",
        ),
    ] = "local",
    workers: Annotated[
        str | None,
        _where(
            metavar="N",
            help="Number of worker processes to start; by default one per core. MIN:MAX lets the jobs of a batch system"
            " follow the work.",
        ),
    ] = None,
    tls_ca: Annotated[
        Path | None, _where(metavar="FILE", help="Certificate of the authority that signed the cluster's certificates.")
    ] = None,
    tls_cert: Annotated[Path | None, _where(metavar="FILE", help="Certificate of this process.")] = None,
    tls_key: Annotated[
        Path | None,
        _where(metavar="FILE", help="Private key of that certificate; only you may read the file (mode 0600)."),
    ] = None,
    insecure: Annotated[bool, _where("--insecure", help="Allow a cluster on other machines without TLS.")] = False,
) -> "Cluster":
    """Return the cluster that the options describe, after all checks that need no connection; SpecError."""
    from campaign.cluster.cluster import Cluster, Tls, security, workers_in
    from campaign.cluster.connect import check_cluster

    files = {"--tls-ca": tls_ca, "--tls-cert": tls_cert, "--tls-key": tls_key}
    missing = [option for option, path in files.items() if path is None]
    if missing and len(missing) < len(files):
        raise SpecError(f"{', '.join(missing)}: not given; TLS needs --tls-ca, --tls-cert and --tls-key together")
    tls = None if missing else Tls(*(str(Path(path).absolute()) for path in files.values() if path))
    number = None if workers is None else workers_in(workers)
    where = Cluster(scheduler, cluster, number, tls, insecure)  # type: ignore[arg-type]  # check_cluster checks it
    check_cluster(where)
    if tls:
        security(tls)
    return where


def on_cluster(verb: Callable[..., None]) -> Callable[..., None]:
    """Replace a verb's parameter ``where`` by the options that describe a cluster."""
    own, options = inspect.signature(verb).parameters, inspect.signature(cluster_from).parameters

    @wraps(verb)
    def with_options(**arguments: Any) -> None:
        where = cluster_from(**{name: arguments.pop(name) for name in options})
        verb(where=where, **arguments)

    parameters = [p for name, p in own.items() if name != "where"]
    last = next((i for i, p in enumerate(parameters) if p.name == "json"), len(parameters))
    parameters[last:last] = options.values()
    with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # what typer reads
    with_options.__annotations__ = {p.name: p.annotation for p in parameters}
    return with_options


def asked_server(context: typer.Context, server: str | None) -> "RemoteServer | None":
    """Return the server that a verb uses; None if it uses a store. The command line precedes the environment."""
    if server is None:
        return None
    sources = map(context.get_parameter_source, ("server", "store"))
    of_server, of_store = (source.name if source else "" for source in sources)
    if of_server == of_store == "COMMANDLINE":
        raise SpecError("--server, --store: both are given; a server has a store of its own: leave one out")
    if of_server == of_store == "ENVIRONMENT":
        raise SpecError(f"{SERVER}, {STORE}: both are set in the environment; unset one, or give --server or --store")
    if of_store == "COMMANDLINE":
        return None
    from clearcap.client.remote_server import connect

    return connect(server)


def opened_store(store: str, *, is_patient: bool = False) -> "Store":
    """Return a store; only if `is_patient`, one that is away is waited for."""
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    return open_store(store) if is_patient else open_store(store, QUICK)


def opened_campaign(store: str, campaign: str | None, *, is_patient: bool = False) -> "tuple[Store, Plan]":
    """Return a store, as `opened_store` does, and the plan of one of its campaigns."""
    opened = opened_store(store, is_patient=is_patient)
    return opened, opened.plan(opened.find(campaign))


def command_at(remote: "RemoteServer", verb: str, *words: str) -> str:
    """Return a complete command that uses the same server."""
    return shlex.join(["clearcap", verb, *words, "--server", remote.address])


def named_mechanism(name: str) -> "Mechanism":
    """Load a shipped mechanism or a mechanism file; SpecError if the name is that of a shipped campaign."""
    from campaign.spec.named_files import campaign_names
    from engine import library_names, load_mechanism

    if name in set(campaign_names()) - set(library_names()):
        raise SpecError(f"{name}: is a shipped campaign, not a mechanism; compute it with: clearcap run {name}")
    return load_mechanism(name)
