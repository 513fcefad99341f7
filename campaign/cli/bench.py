"""``clearcap bench``: how fast this machine simulates mechanisms."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.named_mechanism import named_mechanism
from campaign.cli.output import Json, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from engine.profile.step_times import StepTimes


def bench(
    mechanisms: Annotated[
        list[str] | None, typer.Argument(metavar="[MECHANISM]...", help="Shipped mechanisms or mechanism files.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Number of time steps; by default those of the horizon, at most 7000.")
    ] = None,
    json: Json = False,
) -> None:
    """Measure the time of a step, its share per stage, and the residuals that the solver leaves.

    Without arguments it measures all shipped mechanisms.
    """
    from engine import library_names
    from engine.profile.step_times import measure_step_times

    loaded = [named_mechanism(name) for name in mechanisms or library_names()]
    say("compiling the time loop that measures its stages: about a minute, before the first mechanism")
    measured = []
    for mechanism in loaded:
        measured.append(measure_step_times(mechanism, steps))
        say(f"{mechanism.name}: {measured[-1].step_us:.3g} us per step")
    if json:
        print_json([asdict(entry) for entry in measured])
    else:
        _print(measured)
    if any(entry.status != "ok" for entry in measured):
        raise typer.Exit(1)


def _print(measured: "list[StepTimes]") -> None:
    """Print three tables with one mechanism per row."""
    for title, columns in TABLES.items():
        rows = [[entry.mechanism, *(_text(getattr(entry, c)) for c in columns)] for entry in measured]
        print_table(title, ("mechanism", *columns.values()), rows, texts=1)
    shares = [[entry.mechanism, *(f"{100 * part:.1f}" for part in entry.shares.values())] for entry in measured]
    print_table("share of the time [%]", ("mechanism", *measured[0].shares), shares, texts=1)
    for entry in measured:
        if entry.message:
            print_text(f"{entry.mechanism}: {entry.message}")


TABLES = {
    "size and speed": {
        "bodies": "bodies",
        "contacts": "contacts",
        "ties": "joint rows",
        "steps": "steps",
        "repeated": "repeated",
        "step_us": "us/step",
        "iterations_per_step": "iter/step",
    },
    "largest residuals of the steps": {
        "status": "status",
        "max_residual": "residual",
        "max_penetration": "penetration",
        "max_violation": "joint violation",
    },
}


def _text(value: object) -> str:
    """Return a value for a table; numbers have three digits."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
