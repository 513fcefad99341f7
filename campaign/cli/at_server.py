"""Verbs that use a server of ``clearcap serve`` in place of a store."""

import shlex
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.environment import SERVER, STORE

if TYPE_CHECKING:
    from campaign.client.remote_server import RemoteServer

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


def asked_server(context: typer.Context, server: str | None) -> "RemoteServer | None":
    """Return the server that a verb uses; None if it uses a store.

    An option on the command line takes precedence over an environment variable. Raises SpecError if both a server and a
    store are named, or the server cannot be used.
    """
    from campaign.errors import SpecError

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
    from campaign.client.remote_server import connect

    return connect(server)


def command_at(remote: "RemoteServer", verb: str, *words: str) -> str:
    """Return a complete command that uses the same server."""
    return shlex.join(["clearcap", verb, *words, "--server", remote.address])
