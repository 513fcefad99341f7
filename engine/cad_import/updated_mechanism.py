"""A mechanism file for a new revision of its CAD file: what a person wrote stays, what the CAD file said follows."""

import re
from dataclasses import dataclass, field

_KEY = re.compile(r"(?:# )?([A-Za-z_][\w-]*) = (.*?)(?:\s+# .*)?")
_TABLE = re.compile(r"(?:# )?(\[[\w.-]+\])(?:\s+# .*)?")
Keys = tuple[str, str]
"""The header of a table, empty at the top, and a key in it."""


@dataclass(frozen=True)
class UpdatedMechanism:
    """What became of a mechanism file.

    Attributes
    ----------
    text : str
        The file for the new revision.
    kept : list of str
        Where the proposal has changed and the file has a value of its own, which stays; each as a line.
    gone : list of str
        Tables of which the new revision has nothing left; they stay, too.
    added : list of str
        Tables that are new.
    """

    text: str
    kept: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)


def updated_mechanism(text: str, before: str, after: str) -> UpdatedMechanism:
    """Return a mechanism file in which what was proposed for one revision is as it is proposed for another.

    Parameters
    ----------
    text : str
        The file, with whatever the person has written into it.
    before, after : str
        What `engine.cad_import.proposed_mechanism.proposed_mechanism` returns of the two revisions.

    Returns
    -------
    UpdatedMechanism
        A line changes only where the person left it as it was proposed, with its mark or without it.
    """
    lines = text.splitlines()
    own, old, new = _keys(lines), _keys(before.splitlines()), _keys(after.splitlines())
    updated = UpdatedMechanism(text)
    for key, (new_place, entry) in new.items():
        if key not in old:
            continue
        was, proposed = before.splitlines()[old[key][0]], after.splitlines()[new_place]
        if was.removeprefix("# ") == proposed.removeprefix("# "):  # a comment says what "as drawn" is
            continue
        if key in own and own[key][1] == old[key][1]:
            place = own[key][0]
            mark = "# " if lines[place].startswith("# ") else ""
            lines[place] = mark + proposed.removeprefix("# ")
        elif old[key][1] != entry and (key not in own or own[key][1] != entry):
            updated.kept.append(f"{_path(key)}: proposed is now {entry}, and was {old[key][1]}")
    for table in dict.fromkeys(table for table, _ in old):
        if table not in {each for each, _ in new}:
            updated.gone.append(table)
    for table in dict.fromkeys(table for table, _ in new):
        if table not in {each for each, _ in (*old, *own)}:
            lines += ["", *_block(after, table)]
            updated.added.append(table)
    return UpdatedMechanism("\n".join(lines) + "\n", updated.kept, updated.gone, updated.added)


def _keys(lines: list[str]) -> dict[Keys, tuple[int, str]]:
    """Return the place of each key's line, and its value as it is written; marked lines count as others."""
    found: dict[Keys, tuple[int, str]] = {}
    table = ""
    for place, line in enumerate(lines):
        if match := _TABLE.fullmatch(line):
            table = match[1]
        elif match := _KEY.fullmatch(line):
            found.setdefault((table, match[1]), (place, match[2].strip()))
    return found


def _block(text: str, table: str) -> list[str]:
    """Return the lines of a table up to the next empty one, with the questions in it."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if (match := _TABLE.fullmatch(line)) and match[1] == table)
    end = next((i for i in range(start, len(lines)) if not lines[i].strip()), len(lines))
    return lines[start:end]


def _path(key: Keys) -> str:
    return ".".join(filter(None, (key[0].strip("[]"), key[1])))
