"""``clearcap bench``: how fast mechanisms are computed here."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.bench import Bench


def bench(
    mechanisms: Annotated[
        list[str] | None, typer.Argument(metavar="[MECHANISM]...", help="Shipped mechanisms or mechanism files.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Time steps; by default those of the horizon, at most 7000.")
    ] = None,
    json: Json = False,
) -> None:
    """Measure the time of a step, what it is spent on, and what the solver leaves: all shipped mechanisms, or these."""
    from campaign.bench import bench as measure
    from engine import library_names, load_mechanism

    loaded = [load_mechanism(name) for name in mechanisms or library_names()]
    say("the first mechanism waits for the loop with clocks to be compiled, about a minute")
    measured = []
    for mechanism in loaded:
        measured.append(measure(mechanism, steps))
        say(f"{mechanism.name}: {measured[-1].step_us:.3g} us a step")
    if json:
        print_json([asdict(entry) for entry in measured])
    else:
        _print(measured)
    if any(entry.status != "ok" for entry in measured):
        raise typer.Exit(1)


def _print(measured: "list[Bench]") -> None:
    """Print the measurements as a table, one mechanism a column."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="fixed steps, with and after rest", title_justify="left")
    table.add_column("")
    for entry in measured:
        table.add_column(entry.mechanism, justify="right")
    for field, name in ROWS.items():
        table.add_row(name, *(_text(getattr(entry, field)) for entry in measured))
    for stage in measured[0].shares:
        table.add_row(f"share: {stage}", *(f"{100 * entry.shares[stage]:.1f} %" for entry in measured))
    Console().print(table)
    for entry in measured:
        if entry.message:
            print(f"{entry.mechanism}: {entry.message}")


ROWS = {
    "status": "status",
    "bodies": "moving bodies",
    "contacts": "contacts",
    "ties": "rows of ideal joints",
    "step": "step [file's unit]",
    "steps": "steps",
    "repeated": "steps repeated",
    "step_us": "time of a step [us]",
    "iterations_per_step": "solver iterations a step",
    "max_residual": "largest residual",
    "max_penetration": "largest penetration",
    "max_violation": "largest joint violation",
}


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
