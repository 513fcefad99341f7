"""The command ``clearcap``: its verbs, grouped in modules by what they do.

Verbs import tables, dask and the engine inside their functions, so that ``clearcap --help`` and wrong options do not
wait a second for them.
"""

import sys
from typing import Annotated, Any

import typer

from campaign.interrupts import INTERRUPTED, exit_at_interrupt
from campaign.safe_path import leave_current_folder_out
from clearcap.cli.campaigns import compact, delete, label, list_campaigns, status, watch
from clearcap.cli.computing import cancel, repeat, rerun, resume, run, submit
from clearcap.cli.help_pages import Group
from clearcap.cli.mechanism import mechanism_app, schema_app
from clearcap.cli.output import print_text, say, show_logs, visible
from clearcap.cli.predictions import advise, calibrate, design, whatif
from clearcap.cli.reports import capability, gauge, monitor, report, validate, verify
from clearcap.cli.servers import backup, certificates, coordinate, doctor, restore, serve
from clearcap.cli.single_runs import bench, polarisation, replay, simulate
from clearcap.cli.termination import terminated_in_order


class _Verbs(Group):
    """The group of verbs; on Ctrl-C it names the interrupted verb, unless that verb has printed this itself."""

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]  # typer's own context
        """Call the verb named on the command line."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say(f"interrupted: clearcap {ctx.invoked_subcommand} ended without a result")
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="clearcap",
    cls=_Verbs,
    help="From clearance to capability: what the play in a mechanism's joints does to its function.",
    epilog="Exit status: 0 done; 1 the work failed; 2 wrong input; 3 cancelled; 4 store, disk or cluster cannot be"
    " reached; 130 interrupted; 143 or 129 ended by SIGTERM or SIGHUP.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
for verb in (
    *(run, submit, coordinate, status, watch, resume, cancel, list_campaigns, label, compact, delete),
    *(repeat, rerun, replay, report, capability, gauge, validate, calibrate, monitor, whatif, advise, design, verify),
    *(simulate, polarisation, bench, certificates, serve, backup, restore, doctor),
):
    app.command("list" if verb is list_campaigns else None)(verb)
app.add_typer(mechanism_app, name="mechanism")
app.add_typer(schema_app, name="schema")


def _version(wanted: bool) -> None:
    if wanted:
        from campaign.row_build import clearcap_version, short_build

        print_text(f"clearcap {clearcap_version()}, build {short_build()}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and the build.")
    ] = False,
) -> None:
    """From clearance to capability: what the play in a mechanism's joints does to its function."""


def main() -> None:
    """Run the command; an error that users can fix gives one message and an exit status, never a traceback."""
    leave_current_folder_out()
    show_logs()
    with exit_at_interrupt():
        _check_words(sys.argv[1:])
        try:
            with terminated_in_order():
                app()
        except Exception as error:
            code = _exit_code(error)
            if code is None:
                raise
            say(f"error: {error}")
            sys.exit(code)


def _check_words(words: list[str]) -> None:
    """Refuse characters that a terminal hides or interprets, because messages about options would print them."""
    for word in words:
        if visible(word) != word:
            say(f"error: {visible(word)}: has characters that a terminal hides or acts on; leave them out")
            sys.exit(2)


def _exit_code(error: Exception) -> int | None:
    from campaign.errors import CampaignError, unwritable
    from engine import CadError, EngineError, FolderError, MechanismError

    if isinstance(error, CampaignError):
        return error.exit_code
    if isinstance(error, CadError | FolderError | MechanismError):
        return 2
    if isinstance(error, EngineError):
        return unwritable(str(error), error.__cause__).exit_code if isinstance(error.__cause__, OSError) else 1
    return None
