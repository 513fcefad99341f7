"""Update a proposed file for a new revision of its CAD file: edits by a person stay, other entries follow the file.

The CAD file for which it was written may have been replaced already, see `earlier_revision`.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine.cad import RECOGNITION, CadAssembly, read_step
from engine.cad.assembly_cache import cached
from engine.cad_import.proposed_text import (
    MARK,
    QUESTION,
    Key,
    ProposedLine,
    entries_of,
    path_of,
    table_lines,
    what_it_asks,
)
from engine.errors import CadError, MechanismError
from engine.mechanism.faults import sub_table
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml

_PARAMETERS = "[parameters]"


@dataclass(frozen=True)
class UpdatedProposal:
    """The result of updating a mechanism file or a campaign file."""

    text: str  # the file for the new revision
    # places, one per line, where the proposal has changed but the file's own value is kept
    kept: list[str] = field(default_factory=list)
    # tables of which nothing remains in the new revision; they are kept, too
    gone: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)  # new tables


def updated_proposal(text: str, before: str, after: str) -> UpdatedProposal:
    """Return a file, including a person's edits, updated from the proposal of one revision to that of another.

    A line is changed or removed only if the person left it as it was proposed. What has become a question is one again,
    and a question that is no longer asked is removed, unless the person has answered it.
    """
    return _Merge(text, before, after).result()


class _Merge:
    """The lines of a file, each with the lines that replace it, and the lists of what was done."""

    def __init__(self, text: str, before: str, after: str) -> None:
        lines, self._after = text.splitlines(), after.splitlines()
        self._own, self._old, self._new = entries_of(lines), entries_of(before.splitlines()), entries_of(self._after)
        self._asked, self._asks = _questions(before), _questions(after)
        self._out = [[line] for line in lines]
        self._said = UpdatedProposal(text)

    def result(self) -> UpdatedProposal:
        """Return the file for the new revision."""
        self._update_questions()
        for key, entry in self._new.items():
            if key in self._old:
                self._follow(key, entry)
            elif key[1] and (key[0], "") in {*self._own, ("", "")}:
                self._insert(key, entry)
        for key, was in self._old.items():
            if key not in self._new:
                self._drop(key, was)
        # after all keys are dropped: only the lines that are left show which parameters are used
        self._remove_parameters()
        self._add_tables()
        lines: list[str] = []
        for place, each in enumerate(self._out):
            gone = place > 0 and not self._out[place - 1]
            if not (each == lines[-1:] == [""] and gone):  # a removed table leaves no second empty line
                lines += each
        text = "\n".join(lines)
        return UpdatedProposal(text + "\n", self._said.kept, self._said.gone, self._said.added)

    def _follow(self, key: Key, entry: ProposedLine) -> None:
        """Replace a line that is still as it was proposed by the one proposed now."""
        was, own = self._old[key], self._own.get(key)
        if own is not None:
            self._ask(own, entry)
        if (was.unmarked, was.marked) == (entry.unmarked, entry.marked):  # with the comment, which explains "as drawn"
            return
        is_stop = entry.marked and key[0].startswith("[contacts.")  # a person removes its mark, not its geometry
        answered = own is not None and was.marked and not own.marked and not is_stop
        if own is not None and own.value == was.value and not answered:
            mark = MARK if (own.marked if was.marked == entry.marked else entry.marked) else ""
            self._out[own.place][-1] = mark + entry.unmarked
        elif was.value != entry.value and (own is None or own.value != entry.value):
            self._said.kept.append(f"{path_of(key)}: proposed is now {entry.value}, and was {was.value}")

    def _insert(self, key: Key, entry: ProposedLine) -> None:
        """Write a new key into its table, after the key that precedes it in the proposal."""
        if key in self._own:
            if self._own[key].value != entry.value:
                self._said.kept.append(f"{path_of(key)}: proposed is now {entry.value}")
            return
        questions = self._not_asked(entry)
        if entry.marked and entry.questions and not questions:  # the same question as before, asked elsewhere
            return
        before = [k for k, e in self._new.items() if k[0] == key[0] and e.place < entry.place and k in self._own]
        if before:
            self._out[self._own[before[-1]].place] += [*questions, entry.line]

    def _drop(self, key: Key, was: ProposedLine) -> None:
        """Remove a key that is no longer proposed, unless the person changed it; record a table that is gone."""
        if (own := self._own.get(key)) is None or key == (_PARAMETERS, ""):
            return
        header = self._own.get((key[0], ""))
        if not key[1] and not own.marked:
            self._said.gone.append(key[0])
        elif (key[0], "") in self._new or key[0] in ("", _PARAMETERS) or (header and header.marked):
            if (own.value, own.marked) == (was.value, was.marked):
                self._out[own.place].pop(0)
            elif not was.questions or not self._asks.keys() & set(map(what_it_asks, was.questions)):
                self._said.kept.append(f"{path_of(key)}: no longer proposed, and was {was.value}")

    def _remove_parameters(self) -> None:
        """Keep a parameter that is no longer proposed if it is used elsewhere; remove the table if it is empty."""
        header = self._own.get((_PARAMETERS, ""))
        own = {key[1]: entry for key, entry in self._own.items() if key[0] == _PARAMETERS and key[1]}
        rest = "\n".join(line.partition("#")[0] for lines in self._out for line in lines)
        for name, entry in own.items():
            if not self._out[entry.place] and re.search(rf"\b{name}\b", rest):
                self._out[entry.place] = [entry.line]
        if header and own and not any(self._out[entry.place] for entry in own.values()):
            self._out[header.place] = []

    def _add_tables(self) -> None:
        """Append new tables at the end, with those of their questions that are not open already."""
        open_now = {line for lines in self._out for line in lines if line.startswith(QUESTION)}
        for key in self._new:
            if not key[1] and key not in self._old and key not in self._own:
                self._out.append(["", *(x for x in table_lines(self._after, key[0]) if x not in open_now)])
                self._said.added.append(key[0])

    def _update_questions(self) -> None:
        """Remove open questions that are no longer asked, and update the numbers in the others."""
        for lines in self._out:
            if lines[0].startswith(QUESTION) and (asks := what_it_asks(lines[0])) in self._asked:
                lines[:] = [self._asks[asks]] if asks in self._asks else []

    def _ask(self, own: ProposedLine, entry: ProposedLine) -> None:
        """Write the new questions about a key above its line."""
        self._out[own.place][:0] = self._not_asked(entry)

    def _not_asked(self, entry: ProposedLine) -> list[str]:
        """Return the questions about a key that were not asked about the earlier revision."""
        return [line for line in entry.questions if what_it_asks(line) not in self._asked]


def _questions(text: str) -> dict[str, str]:
    """Return the questions in a file, by their text without numbers."""
    return {what_it_asks(line): line for line in text.splitlines() if line.startswith(QUESTION)}


@dataclass(frozen=True, eq=False)
class EarlierRevision:
    """A mechanism file, and the assembly named in its ``[cad]`` table."""

    text: str  # content of the mechanism file
    name: str  # of the mechanism
    file: str  # path of the CAD file, as given in the mechanism file
    assembly: CadAssembly  # in mm


def earlier_revision(path: Path) -> EarlierRevision:
    """Read a mechanism file and the earlier content of its CAD file, even if another file has replaced it since.

    Raises MechanismError if the mechanism file cannot be read or names no CAD file; CadError if the CAD file has other
    content now, and what was read of it before is no longer in the cache.
    """
    try:
        content = read_regular_file(path, LARGEST)
        tables: dict[str, Any] = parse_toml(content)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise MechanismError(f"{path}: cannot be read ({reason}); give the mechanism file") from None
    except UnfitToml as error:
        raise MechanismError(f"{path}: {error}") from None
    cad, name = sub_table(tables, "cad"), tables.get("name")
    file, sha256, recognition = cad.get("file"), cad.get("sha256"), cad.get("recognition", RECOGNITION)
    if not (isinstance(file, str) and isinstance(sha256, str) and isinstance(name, str)):
        raise MechanismError(f"{path}: names no CAD file with its sha256; give a file of mechanism import")
    assembly = cached(sha256, float(recognition))
    if assembly is None:
        assembly = read_step(path.parent / file, float(recognition))
        if assembly.sha256 != sha256:
            raise CadError(
                f"{path}: {file} has another content by now, and what it held is not kept here; put the earlier file"
                " back, and give the new one another name"
            )
    return EarlierRevision(content.decode("utf-8-sig"), name, file, assembly)
