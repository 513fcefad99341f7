"""The questions still open in a campaign file and in the mechanism file that it names."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from engine.cad_import.proposed_text import questions_of_file
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml


def campaign_questions(campaign: object) -> Iterator[str]:
    """Yield the open questions of a campaign file, given by its path, each with its file and line."""
    if not isinstance(campaign, str | Path):
        return
    yield from _said(campaign)
    mechanism = _tables(Path(campaign)).get("mechanism")
    if isinstance(mechanism, str) and (Path(mechanism).suffix == ".toml" or len(Path(mechanism).parts) > 1):
        yield from _said(Path(campaign).parent / mechanism)


def _said(path: str | Path) -> Iterator[str]:
    for question in questions_of_file(path):
        yield f"question: {path}, line {question.line}: {question.text}"


def _tables(path: Path) -> Mapping[str, Any]:
    """Return the tables of a file; empty if it cannot be read, as loading it reports the reason."""
    try:
        return parse_toml(read_regular_file(path, LARGEST))
    except (OSError, ValueError, UnfitToml):
        return {}
