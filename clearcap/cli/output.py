r"""Print results to standard output, messages and progress to standard error; no text can control the terminal.

Titles, names, messages and paths come from files, stores and options that others may have written. Characters that a
terminal interprets, or that hide or reorder letters, are printed as escapes such as ``\x1b``. Rich does not interpret
texts as markup.
"""

import json
import logging
import sys
import traceback
import unicodedata
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.json_values import json_values

if TYPE_CHECKING:
    from rich.console import Console

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]

NARROWEST = 12  # characters; least width of a column of texts on a terminal
UNLIMITED = 10_000  # characters of a line without a terminal

# Control characters, formats such as the direction of writing, halves of characters, ends of lines and paragraphs.
INVISIBLE = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def visible(text: str, keep: str = "") -> str:
    """Return a text with escapes in place of control characters and others that a terminal interprets or hides.

    The characters in `keep` stay, such as the line feeds of a text of several lines.
    """
    if text.isprintable():
        return text
    return "".join(_escape(char) if _is_invisible(char) and char not in keep else char for char in text)


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

    The column with the head ``bold`` stands out.

    On a terminal, texts are wrapped to its width, but numbers are not, and nothing is cut off. In a file or a pipe,
    which have no width, no line is wrapped.
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
        table.add_column(
            head,
            style="bold" if head == bold else "",
            justify="right" if is_number else "left",
            overflow="fold",
            min_width=width,
            width=width if is_number else None,
        )
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


LOGGED = ("campaign", "clearcap")  # packages whose log is shown


def show_logs() -> None:
    """Print our log, warnings of libraries and the traceback of a bug on standard error as messages."""
    handler = _MessageHandler()
    for package in LOGGED:
        logger = logging.getLogger(package)
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    logging.lastResort = _MessageHandler(logging.WARNING)
    sys.excepthook = _print_bug


class _MessageHandler(logging.Handler):
    """A handler that prints log records as messages, above the progress bar if there is one."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


def _print_bug(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print the traceback of a bug."""
    print(visible("".join(traceback.format_exception(kind, error, trace)), "\n"), end="", file=sys.stderr)


def _is_invisible(char: str) -> bool:
    return unicodedata.category(char) in INVISIBLE


def _escape(char: str) -> str:
    """Return a character as a Python escape in ASCII."""
    return char.encode("unicode_escape").decode() if not "\ud800" <= char <= "\udfff" else f"\\u{ord(char):04x}"
