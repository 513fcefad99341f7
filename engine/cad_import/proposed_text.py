"""The lines of a proposed file: tables, keys, and the questions above them, each with its line index."""

import re
from dataclasses import dataclass

from engine.cad_import.toml_lines import QUESTION

MARK = "# "
"""The start of a line that has no effect until this mark is removed."""

Key = tuple[str, str]
"""The header of a table (empty at the top of the file) and a key in it; the key is empty for the header itself."""

_KEY = re.compile(r"(# )?([A-Za-z_][\w-]*) = (.*?)(?:\s+# .*)?")
_TABLE = re.compile(r"(# )?(\[[\w.-]+\])(?:\s+# .*)?")
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


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
