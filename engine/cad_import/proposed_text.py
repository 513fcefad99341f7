"""The text of a proposed file: lines of tables, keys and questions, written, and found again by their line index."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.errors import one_line
from engine.mechanism import library_names
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST

QUESTION = "#?"  # the start of a line that asks the owner of the file a question

MARK = "# "  # the start of a line that has no effect until this mark is removed

Key = tuple[str, str]
"""The header of a table (empty at the top of the file) and a key in it; the key is empty for the header itself."""

_KEY = re.compile(r"(# )?([A-Za-z_][\w-]*) = (.*?)(?:\s+# .*)?")
_TABLE = re.compile(r"(# )?(\[[\w.-]+\])(?:\s+# .*)?")
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


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


@dataclass(frozen=True)
class ProposedLine:
    """A key with its value, or the header of a table."""

    place: int  # index of its line
    line: str
    value: str  # as written, without the comment after it; for a header, the header itself
    marked: bool  # whether it has a mark, so that it is inactive
    questions: tuple[str, ...]  # those in the lines above it

    @property
    def unmarked(self) -> str:
        """The line without its mark, but with the comment after it."""
        return self.line.removeprefix(MARK)


def entries_of(lines: list[str]) -> dict[Key, ProposedLine]:
    """Return the keys and tables of a file; of duplicates, the first."""
    found: dict[Key, ProposedLine] = {}
    table, asked = "", []
    for place, line in enumerate(lines):
        if line.startswith(QUESTION):
            asked.append(line)
            continue
        if match := _TABLE.fullmatch(line):
            table = match[2]
            found.setdefault((table, ""), ProposedLine(place, line, table, bool(match[1]), tuple(asked)))
        elif match := _KEY.fullmatch(line):
            entry = ProposedLine(place, line, match[3].strip(), bool(match[1]), tuple(asked))
            found.setdefault((table, match[2]), entry)
        asked = []
    return found


def table_lines(lines: list[str], header: str) -> list[str]:
    """Return the lines of a table up to the next empty one, including the questions in it and above it."""
    entry = entries_of(lines)[header, ""]
    start = entry.place - len(entry.questions)
    end = next((i for i in range(entry.place, len(lines)) if not lines[i].strip()), len(lines))
    return lines[start:end]


def what_it_asks(question: str) -> str:
    """Return a question without its numbers and trailing text, to compare it with that about another revision."""
    return _NUMBER.sub("0", question.removeprefix(QUESTION).partition("?")[0])


def path_of(key: Key) -> str:
    """Return the dotted path of a key."""
    return ".".join(filter(None, (key[0].strip("[]"), key[1])))


# The open questions in a proposed file: its lines that begin with ``#?``.


@dataclass(frozen=True)
class OpenQuestion:
    """A question in the text of a file."""

    line: int  # from 1
    text: str  # the key or table in question, a colon, and the question


def open_questions(text: str) -> list[OpenQuestion]:
    """Return the unanswered questions in a file; a person who answers one removes its line."""
    lines = enumerate(text.splitlines(), 1)
    return [
        OpenQuestion(number, line.strip().removeprefix(QUESTION).strip())
        for number, line in lines
        if line.lstrip().startswith(QUESTION)
    ]


def questions_of_file(name_or_path: str | Path) -> list[OpenQuestion]:
    """Return the open questions in a mechanism or campaign file; none for a shipped file or one that cannot be read."""
    if str(name_or_path) in library_names():
        return []
    try:
        return open_questions(read_regular_file(name_or_path, LARGEST).decode("utf-8", "replace"))
    except (OSError, ValueError):  # ValueError: a null character in the name
        return []
