"""The command ``clearcap``; each verb imports what it needs when it is called, so that the help is quick."""

import sys
from typing import Annotated

import typer

from campaign.cli.bench import bench
from campaign.cli.campaigns import report, status, watch
from campaign.cli.certificates import certificates
from campaign.cli.control import cancel, coordinate, resume
from campaign.cli.mechanism import mechanism_app
from campaign.cli.output import say, show_logs
from campaign.cli.polarisation import polarisation
from campaign.cli.questions import advise, whatif
from campaign.cli.repeat import replay, rerun
from campaign.cli.run import run, submit
from campaign.cli.schema import schema_app
from campaign.cli.simulate import simulate
from campaign.cli.stored import compact, list_campaigns

app = typer.Typer(
    name="clearcap",
    help="From clearance to capability: what the play in a mechanism's joints does to its function.",
    epilog="Exit status: 0 done; 1 the work failed; 2 wrong input; 3 cancelled; 4 store or cluster out of reach;"
    " 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.command()(run)
app.command()(submit)
app.command()(coordinate)
app.command()(status)
app.command()(watch)
app.command()(resume)
app.command()(cancel)
app.command("list")(list_campaigns)
app.command()(compact)
app.command()(rerun)
app.command()(replay)
app.command()(report)
app.command()(whatif)
app.command()(advise)
app.command()(simulate)
app.command()(polarisation)
app.command()(bench)
app.command()(certificates)
app.add_typer(mechanism_app, name="mechanism")
app.add_typer(schema_app, name="schema")


def _version(asked: bool) -> None:
    if asked:
        from campaign.version import clearcap_version

        print(f"clearcap {clearcap_version()}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """From clearance to capability: what the play in a mechanism's joints does to its function."""


def main() -> None:
    """Run the command; a fault of the user's input is one message and an exit status, never a traceback."""
    show_logs()
    try:
        app()
    except Exception as error:
        code = _exit_code(error)
        if code is None:
            raise
        say(f"error: {error}")
        sys.exit(code)


def _exit_code(error: Exception) -> int | None:
    """Return the exit status for an error with a message made for the user; None for a bug."""
    from campaign.errors import CampaignError
    from engine import EngineError, MechanismError

    if isinstance(error, CampaignError):
        return error.exit_code
    if isinstance(error, MechanismError):
        return 2
    return 1 if isinstance(error, EngineError) else None
