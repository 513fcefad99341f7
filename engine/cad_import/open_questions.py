"""The open questions in a proposed file: its lines that begin with ``#?``."""

from dataclasses import dataclass
from pathlib import Path

from engine.cad_import.toml_lines import QUESTION
from engine.mechanism import library_names
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST


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
