"""Texts for pages, with each fault beside its line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

AROUND = 2  # lines shown before and after one with a fault


@dataclass(frozen=True)
class MarkedLine:
    """A line of a text."""

    number: int  # from 1
    text: str
    faults: tuple[str, ...]


def marked_lines(text: str, faults: Sequence[Mapping[str, Any]]) -> list[MarkedLine]:
    """Return the lines of a text that have faults, with some lines around each; faults of other files are left out."""
    by_line: dict[int, list[str]] = {}
    for fault in faults:
        if fault.get("line") and not fault.get("file"):
            by_line.setdefault(fault["line"], []).append(said(fault))
    near = {number for line in by_line for number in range(line - AROUND, line + AROUND + 1)}
    lines = enumerate(text.split("\n"), 1)
    return [MarkedLine(n, line.rstrip("\r"), tuple(by_line.get(n, ()))) for n, line in lines if n in near]


def said(fault: Mapping[str, Any]) -> str:
    """Return a fault as one line: the key, its value, and what is wrong."""
    value = "" if fault.get("value") is None else f" = {fault['value']}"
    return f"{'.'.join(fault['keys'])}{value}: {fault['text']}" if fault["keys"] else str(fault["text"])


def unix_lines(text: str) -> str:
    """Return a text that a browser sent, with Unix line ends."""
    return text.replace("\r\n", "\n").replace("\r", "\n")
