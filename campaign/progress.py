"""How far a campaign is: a live bar on a terminal, a line now and then elsewhere; on standard error."""

from time import monotonic
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

LINE_EVERY = 10.0  # s, between two lines where there is no terminal


class Watcher(Protocol):
    """Is told how far a campaign is, inside a ``with`` block."""

    def __enter__(self) -> Self:
        """Begin to show."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop showing."""

    def advance(self, done: int, failed: int) -> None:
        """Take note of ``done`` more rows, ``failed`` of them not ok."""


class Bar:
    """A live bar with rows done and failed, rate and time to go.

    Parameters
    ----------
    console : Console
        Where to draw.
    total, done, failed : int
        Rows planned, and rows there from the start.
    """

    def __init__(self, console: Console, total: int, done: int, failed: int) -> None:
        self._bar = Progress(
            SpinnerColumn(),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f} runs, {task.fields[failed]} failed"),
            _Rate(),
            TextColumn("ETA"),
            TimeRemainingColumn(),
            console=console,
        )
        self._failed = failed
        self._task = self._bar.add_task("", total=total, completed=done, failed=failed)

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the bar as it is."""
        self._bar.stop()

    def advance(self, done: int, failed: int) -> None:
        """Take note of ``done`` more rows, ``failed`` of them not ok."""
        self._failed += failed
        self._bar.update(self._task, advance=done, failed=self._failed)


class Lines:
    """A line every ten seconds and one at the end.

    Parameters
    ----------
    console : Console
        Where to write.
    total, done, failed : int
        Rows planned, and rows there from the start.
    """

    def __init__(self, console: Console, total: int, done: int, failed: int) -> None:
        self._console = console
        self._total, self._done, self._failed = total, done, failed
        self._before = done
        self._start = self._said = monotonic()

    def __enter__(self) -> Self:
        """Start the clock."""
        self._start = self._said = monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Do nothing: the last line has been written."""

    def advance(self, done: int, failed: int) -> None:
        """Take note of ``done`` more rows, ``failed`` of them not ok."""
        self._done += done
        self._failed += failed
        now = monotonic()
        if now - self._said < LINE_EVERY and self._done < self._total:
            return
        self._said = now
        rate = (self._done - self._before) / max(now - self._start, 1e-9)
        left = (self._total - self._done) / rate if rate > 0 else 0.0
        text = f"{self._done}/{self._total} runs, {self._failed} failed, {rate:.1f} runs/s, ETA {left:.0f} s"
        self._console.print(text, highlight=False)


class _Rate(ProgressColumn):
    """Runs a second."""

    def render(self, task: Task) -> Text:
        """Return the rate of the last while."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} runs/s", style="progress.data.speed")


def watcher(console: Console, total: int, done: int, failed: int) -> Watcher:
    """Return the bar on a terminal, the lines elsewhere."""
    kind = Bar if console.is_terminal else Lines
    return kind(console, total, done, failed)
