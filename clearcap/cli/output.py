r"""Print results to standard output, messages and progress to standard error; no text can control the terminal.

Titles, names, messages and paths come from files, stores and options that others may have written. Characters that a
terminal interprets, or that hide or reorder letters, are printed as escapes such as ``\x1b``. Rich, which takes a while
to import, does not interpret texts as markup.
"""

import json
import logging
import sys
import traceback
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.json_values import json_values
from campaign.waits import counted

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from campaign.coordinator.heartbeat import Heartbeat, Show

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]

LOGGED = ("campaign", "clearcap")  # packages whose log is shown
NARROWEST = 12  # characters; least width of a column of texts on a terminal
UNLIMITED = 10_000  # characters of a line without a terminal

# Control characters, formats such as the direction of writing, halves of characters, ends of lines and paragraphs.
INVISIBLE = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def visible(text: str, keep: str = "") -> str:
    """Return a text with escapes for characters that a terminal interprets or hides, except those in `keep`."""
    if text.isprintable():
        return text
    return "".join(_escape(char) if _is_invisible(char) and char not in keep else char for char in text)


def _is_invisible(char: str) -> bool:
    return unicodedata.category(char) in INVISIBLE


def _escape(char: str) -> str:
    return char.encode("unicode_escape").decode() if not "\ud800" <= char <= "\udfff" else f"\\u{ord(char):04x}"


def print_text(text: object, *, lines: bool = False) -> None:
    """Print a line, or with ``lines`` a text of several lines, on standard output."""
    print(visible(str(text), "\n" if lines else ""))


def say(text: str) -> None:
    """Print a message on standard error; only its first line has the prefix of messages."""
    print(f"clearcap: {visible(text, chr(10))}".replace("\n", "\n  "), file=sys.stderr)


def print_json(document: Any) -> None:
    """Print one JSON document on standard output; a number that is not finite becomes null."""
    text = json.dumps(json_values(document), indent=2, ensure_ascii=False, allow_nan=False)
    print("".join(json.dumps(char)[1:-1] if _is_invisible(char) and char != "\n" else char for char in text))


def console(*, stderr: bool = False) -> "Console":
    """Return a rich console that prints texts without interpreting markup."""
    from rich.console import Console

    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def print_table(
    title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], *, texts: int | None = None, bold: str = ""
) -> None:
    """Print a table on standard output; its first ``texts`` columns hold texts and the others numbers.

    The column with the head ``bold`` stands out. On a terminal, texts are wrapped to its width, but numbers are not,
    and nothing is cut off. In a file or a pipe, which have no width, no line is wrapped.
    """
    from rich.box import SIMPLE
    from rich.cells import cell_len
    from rich.table import Table

    shown = [[visible(cell) for cell in row] for row in rows]
    output = console()
    table = Table(box=SIMPLE, padding=(0, 1, 0, 0))
    least = 2  # characters that the table needs
    for place, head in enumerate(map(visible, heads)):
        is_number = texts is not None and place >= texts
        longest = max(cell_len(text) for text in (*head.split(), *(row[place] for row in shown)))
        width = longest if is_number else min(longest, NARROWEST)
        kind: Any = {"justify": "right", "width": width} if is_number else {"justify": "left"}
        table.add_column(head, style="bold" if head == bold else "", overflow="fold", min_width=width, **kind)
        least += width + 2
    for row in shown:
        table.add_row(*row)
    print_text(title)  # separately, because a table's own title is wrapped to the table's width
    output.width = max(output.width, least) if output.is_terminal else UNLIMITED
    output.print(table)


def number(value: float | None, digits: int = 5) -> str:
    """Return a number for a table; a dash for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def mean_number(mean: float | None, std: float | None) -> str:
    """Return a mean for a table with five digits, or with those that its standard deviation makes meaningful."""
    from reporting.format_numbers import decimals_for, fixed

    if mean is None or not std or abs(float(number(mean)) - mean) <= std / 20:
        return number(mean)
    return fixed(mean, decimals_for(std, 2))


def labelled(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, if it has one."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def show_logs() -> None:
    """Print our log, warnings of libraries and the traceback of a bug on standard error as messages."""
    handler = _MessageHandler()
    for package in LOGGED:
        logger = logging.getLogger(package)
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    logging.lastResort = _MessageHandler(logging.WARNING)
    sys.excepthook = lambda *bug: print(
        visible("".join(traceback.format_exception(*bug)), "\n"), end="", file=sys.stderr
    )


class _MessageHandler(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())  # above the progress bar if there is one


# -- the progress of a campaign --------------------------------------------------------------------------------------

LINE_EVERY = 10.0  # s between two lines without a terminal
LONGEST = 1e9  # s
BAR = 40  # characters


@contextmanager
def display(console: "Console") -> Iterator["Show"]:
    """Yield a function that shows a heartbeat: in the live view on a terminal, otherwise in lines."""
    if not console.is_terminal:
        yield Lines(console)
        return
    from rich.live import Live

    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda heartbeat: live.update(view(heartbeat), refresh=True)


class Lines:
    """Print a line every ten seconds, and one when the state changes."""

    def __init__(self, console: "Console") -> None:
        self._console = console
        self._printed_at, self._state = monotonic(), "running"

    def __call__(self, heartbeat: "Heartbeat") -> None:
        """Print a line if one is due."""
        from rich.text import Text

        now = monotonic()
        if now - self._printed_at >= LINE_EVERY or heartbeat.state != self._state:
            self._printed_at, self._state = now, heartbeat.state
            self._console.print(Text(line(heartbeat)), soft_wrap=True)


def line(heartbeat: "Heartbeat") -> str:
    """Return one line about the progress of a campaign."""
    repeats = f", {heartbeat.repeated}/{heartbeat.repeats} repeats" if heartbeat.repeats else ""
    head = f"{heartbeat.done}/{heartbeat.samples} runs, {heartbeat.failed} failed{repeats}"
    if heartbeat.state != "running":
        return f"{head}, {visible(heartbeat.state)}"
    speed = f"{heartbeat.rate:.1f} runs/s, ETA {eta(heartbeat.eta_s)}, {counted(heartbeat.workers, 'worker')}"
    return f"{head}, {speed}{f'; {visible(heartbeat.waits_for)}' if heartbeat.waits_for else ''}"


def view(heartbeat: "Heartbeat") -> "RenderableType":
    """Return the live view: a bar, the line beside it, and the responses so far."""
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    bar = Table.grid(padding=(0, 1))
    done = ProgressBar(total=max(heartbeat.samples, 1), completed=heartbeat.done, width=BAR)
    bar.add_row(done, Text(line(heartbeat)))
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
