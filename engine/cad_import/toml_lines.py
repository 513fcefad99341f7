"""Lines of a proposed file: keys with values on one line, comments, and questions."""

from collections.abc import Iterable, Mapping
from typing import Any

from engine.faults.fault import one_line

QUESTION = "#?"
"""The start of a line that asks the owner of the file a question."""


def value(entry: Any) -> str:
    """Return a value as TOML on one line: texts, numbers, true and false, lists, nested tables."""
    match entry:
        case bool():
            return str(entry).lower()
        case str():
            return f'"{"".join(_escaped(c) for c in entry)}"'
        case float():
            return repr(round(entry, 12) + 0.0)  # + 0.0 turns -0.0 into 0.0
        case int():
            return str(entry)
        case Mapping():
            return f"{{ {', '.join(f'{key} = {value(inner)}' for key, inner in entry.items())} }}"
        case Iterable():
            return f"[{', '.join(value(float(inner) if hasattr(inner, 'dtype') else inner) for inner in entry)}]"
    raise TypeError(f"{type(entry).__name__} is no TOML")


def key_line(key: str, entry: Any, comment: str = "") -> str:
    """Return a line with a key and its value."""
    line = f"{key} = {value(entry)}"
    return f"{line:<36} # {one_line(comment)}" if comment else line


def question(key: str, text: str) -> str:
    """Return the line of a question about a key or table."""
    return f"{QUESTION} {key}: {one_line(text)}"


def marked(lines: Iterable[str]) -> list[str]:
    """Return lines with marks, which are inactive until their marks are removed."""
    return [f"# {line}" for line in lines]


def _escaped(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    return character if character.isprintable() else f"\\U{ord(character):08x}"
