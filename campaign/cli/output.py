"""Results go to standard output, messages and progress to standard error."""

import json
import logging
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]


def print_json(document: Any) -> None:
    """Print one JSON document on standard output; a number that is not finite becomes null."""
    json.dump(_finite(document), sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write("\n")


def say(text: str) -> None:
    """Print a message on standard error."""
    print(f"clearcap: {text}", file=sys.stderr)


def show_logs() -> None:
    """Send what the campaign logs to standard error, as messages."""
    logger = logging.getLogger("campaign")
    logger.addHandler(_MessageHandler())
    logger.setLevel(logging.INFO)


class _MessageHandler(logging.Handler):
    """Prints what is logged, above the progress bar if there is one."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


def print_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: bool = False) -> None:
    """Print a table on standard output; with ``numbers`` all columns but the first are aligned right."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    for head in heads:
        table.add_column(head, justify="right" if numbers and head != heads[0] else "left")
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def number(value: float | None, digits: int = 5) -> str:
    """Return a number for a table; a dash for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def _finite(document: Any) -> Any:
    """Return a document with None in place of NaN and infinities."""
    if isinstance(document, float):
        return document if math.isfinite(document) else None
    if isinstance(document, dict):
        return {key: _finite(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [_finite(value) for value in document]
    return document
