"""Show the progress of a campaign on standard error: a live view on a terminal, otherwise a line every ten seconds."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from time import monotonic
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from campaign.waits import counted
from clearcap.cli.output import visible

if TYPE_CHECKING:
    from campaign.coordinator.heartbeat import Heartbeat, Show

LINE_EVERY = 10.0  # s between two lines without a terminal
LONGEST = 1e9  # s
BAR = 40  # characters


@contextmanager
def display(console: Console) -> Iterator["Show"]:
    """Yield a function that shows a heartbeat: in the live view on a terminal, otherwise in lines."""
    if not console.is_terminal:
        yield Lines(console)
        return
    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda heartbeat: live.update(view(heartbeat), refresh=True)


class Lines:
    """Print a line every ten seconds, and one when the state changes."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._printed_at, self._state = monotonic(), "running"

    def __call__(self, heartbeat: "Heartbeat") -> None:
        """Print a line if one is due."""
        now = monotonic()
        if now - self._printed_at < LINE_EVERY and heartbeat.state == self._state:
            return
        self._printed_at, self._state = now, heartbeat.state
        self._console.print(Text(line(heartbeat)), soft_wrap=True)


def line(heartbeat: "Heartbeat") -> str:
    """Return one line about the progress of a campaign."""
    repeats = f", {heartbeat.repeated}/{heartbeat.repeats} repeats" if heartbeat.repeats else ""
    head = f"{heartbeat.done}/{heartbeat.samples} runs, {heartbeat.failed} failed{repeats}"
    if heartbeat.state != "running":
        return f"{head}, {visible(heartbeat.state)}"
    speed = f"{heartbeat.rate:.1f} runs/s, ETA {eta(heartbeat.eta_s)}, {counted(heartbeat.workers, 'worker')}"
    waits = f"; {visible(heartbeat.waits_for)}" if heartbeat.waits_for else ""
    return f"{head}, {speed}{waits}"


def view(heartbeat: "Heartbeat") -> RenderableType:
    """Return the live view: a bar, the line beside it, and the responses so far."""
    bar = Table.grid(padding=(0, 1))
    bar.add_row(
        ProgressBar(total=max(heartbeat.samples, 1), completed=heartbeat.done, width=BAR), Text(line(heartbeat))
    )
    limited = {name: r for name, r in heartbeat.responses.items() if r["cpk"] is not None}
    if not limited:
        return bar
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for head in ("so far", "n", "mean", "sigma", "Cpk"):
        table.add_column(head, justify="left" if head == "so far" else "right")
    for name, r in limited.items():
        table.add_row(Text(visible(name)), f"{r['n']}", *(f"{r[key] or 0.0:.4g}" for key in ("mean", "std", "cpk")))
    return Group(bar, table)


def eta(seconds: float | None) -> str:
    """Return the remaining time as h:mm:ss; a dash if it is unknown or longer than `LONGEST`."""
    return str(timedelta(seconds=round(seconds))) if seconds is not None and seconds < LONGEST else "-"
