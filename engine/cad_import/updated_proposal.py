"""Update a proposed file for a new revision of its CAD file: edits by a person stay, other entries follow the file.

The CAD file for which it was written may have been replaced already, see `earlier_revision`. Parts, joints and stops
that are still present keep the names of the earlier revision; a person may have changed them, so names in the mechanism
file come before those that would be proposed. A stop or a joint gets a number if several are alike: otherwise a new one
would take the number of another one, together with what a person has written about that one.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import RECOGNITION, read_step
from engine.cad.archive import cached
from engine.cad.cad_model import CadAssembly, CadPart
from engine.cad_import.found_geometry import FoundGeometry, find_geometry
from engine.cad_import.proposed_groups import PartGroup, updated_groups
from engine.cad_import.proposed_joints import stop_sides
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
from engine.mechanism.geometry.part_bodies import parts_of_body
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml

_FAR = 5.0  # mm between two positions of the same stop
_ALIKE = 1e-6  # relative difference of the volumes and inertias of a renamed part
_SAME_PLACE = 1e-3  # mm between the two centres of a renamed part

_SAME = 0.5  # mm from the position of a stop according to the file
_STOP_PLACES = (  # the keys at which the side b of a proposed stop holds a point
    *((kind, "near") for kind in ("plane", "pin", "hole")),
    *((kind, "centre") for kind in ("sphere", "socket")),
    *((kind, "point") for kind in ("extruded", "turned")),
    ("surface", "faces", 0, "near"),
)


@dataclass(frozen=True, eq=False)
class _NamedPlace:
    """The position of a named feature."""

    name: str
    kind: tuple[Any, ...]  # only features of the same kind can be the same
    point: Array  # shape (3,) [mm]


def named_as_before(found: FoundGeometry, before: FoundGeometry) -> FoundGeometry:
    """Return the features found, with the names that the same parts, joints and stops had in an earlier revision.

    Parts of one product, and joints between two parts, are matched with the nearest earlier ones. A part of a new
    product is matched with one of a product that has disappeared, if its solids have the same volume and inertia and
    are in the same place. A stop is matched with an earlier one within 5 mm with the same normal. All others get names
    that the earlier revision did not have.
    """
    names = _matched(_parts(found, _former_products(found.assembly, before.assembly)), _parts(before, {}))
    found = replace(found, bodies=dict(zip(found.bodies, names, strict=True)))
    stops = _matched(_places_of_stops(found), _places_of_stops(before), _FAR)
    return _renamed(found, _matched(_places_of_joints(found), _places_of_joints(before)), stops)


def _parts(found: FoundGeometry, products: Mapping[str, str]) -> list[_NamedPlace]:
    """Return the parts, each as one of its own product, or of the product that a mapping gives for the part."""
    return [
        _NamedPlace(found.bodies[p.name], (products.get(p.name, p.product),), p.bounds.mean(axis=0))
        for p in found.assembly.parts
    ]


def _former_products(now: CadAssembly, before: CadAssembly) -> dict[str, str]:
    """Return the earlier product of each part that has been renamed."""
    new = {part.product for part in now.parts} - {part.product for part in before.parts}
    gone = {part.product for part in before.parts} - {part.product for part in now.parts}
    return {
        part.name: former.product
        for part in now.parts
        if part.product in new
        for former in before.parts
        if former.product in gone and _is_same(part, former)
    }


def revised_groups(listed: Sequence[PartGroup], before: CadAssembly, now: CadAssembly) -> list[PartGroup]:
    """Return the groups of a new revision: as a person listed them for the earlier one, with new parts as proposed."""
    former = _former_products(now, before)
    products = {former.get(part.name, part.product): part.product for part in now.parts}
    stays = {part.name for part in now.parts}
    names = {part.name: part.name for part in before.parts if part.name in stays}
    for part in before.parts:
        again = [new.name for new in now.parts if new.product == products.get(part.product) and _is_same(new, part)]
        if part.name not in names and again:
            names[part.name] = again[0]
    proposed = find_geometry(now).groups if set(stays) - set(names.values()) else ()
    return updated_groups(listed, proposed, names, [part.name for part in now.parts])


def _is_same(part: CadPart, former: CadPart) -> bool:
    """Return whether two parts have the same solids in the same place."""
    if not part.solids or len(part.solids) != len(former.solids):
        return False
    return all(
        abs(one.volume - other.volume) <= _ALIKE * abs(other.volume)
        and float(np.linalg.norm(one.centre - other.centre)) <= _SAME_PLACE
        and bool(np.all(np.abs(one.inertia - other.inertia) <= _ALIKE * np.abs(other.inertia).max()))
        for one, other in zip(part.solids, former.solids, strict=True)
    )


def renamed_parts(found: FoundGeometry, before: FoundGeometry) -> list[tuple[str, str, str]]:
    """Return body, earlier name and new name of each renamed part; `found` is from `named_as_before`."""
    parts = {body: part for part, body in found.bodies.items()}
    return [(body, part, parts[body]) for part, body in before.bodies.items() if parts.get(body, part) != part]


def _places_of_joints(found: FoundGeometry) -> list[_NamedPlace]:
    """Return the joints with pins and with balls, each in the frame of the body around it."""
    pins = [(j.name, (j.pin.journal, j.pin.bearing), j.pin.point) for j in found.joints]
    balls = [(b.name, (b.ball.ball_part, b.ball.socket_part), b.ball.centre) for b in found.balls]
    return [
        _NamedPlace(name, (found.bodies[parts[0]], found.bodies[parts[1]]), found.to_body(parts[1], point))
        for name, parts, point in [*pins, *balls]
    ]


def _places_of_stops(found: FoundGeometry) -> list[_NamedPlace]:
    """Return the stops, each in the frame of the body with its plane."""
    places = []
    for stop in found.stops:
        plane, other = stop.pair.parts
        normal = found.assembly.part(plane).placement.rotation.T @ stop.pair.normal
        kind = (found.bodies[plane], found.bodies[other], *(np.round(normal, 1) + 0.0).tolist())
        places.append(_NamedPlace(stop.name, kind, found.to_body(plane, stop.pair.middle)))
    return places


def _matched(now: list[_NamedPlace], before: list[_NamedPlace], most: float = np.inf) -> list[str]:
    """Return a name for each place: that of the nearest earlier one of its kind, nearest pairs first, or a new name."""
    pairs = [
        (float(np.linalg.norm(here.point - there.point)), i, j)
        for i, here in enumerate(now)
        for j, there in enumerate(before)
        if here.kind == there.kind
    ]
    names: dict[int, str] = {}
    # nearest pairs first over all places, or a new joint could take the name of a neighbour that is still there
    for far, i, j in sorted(pairs):
        if far <= most and i not in names and before[j].name not in names.values():
            names[i] = before[j].name
    taken = {place.name for place in before}
    for i, place in enumerate(now):
        if i not in names:
            names[i] = _free(place.name, taken)
            taken.add(names[i])
    return [names[i] for i in range(len(now))]


def _free(name: str, taken: set[str]) -> str:
    """Return a free name: the name itself, or the name with the next free number."""
    stem = re.sub(r"-\d+$", "", name)
    first = 2 if stem == name else 1
    return name if name not in taken else next(each for n in count(first) if (each := f"{stem}-{n}") not in taken)


def _renamed(found: FoundGeometry, names: list[str], stops: list[str]) -> FoundGeometry:
    """Return features with other names: those of joints with pins, then of joints with balls, and those of stops."""
    joints, balls = names[: len(found.joints)], names[len(found.joints) :]
    return replace(
        found,
        joints=tuple(replace(each, name=name) for each, name in zip(found.joints, joints, strict=True)),
        balls=tuple(replace(each, name=name) for each, name in zip(found.balls, balls, strict=True)),
        stops=tuple(replace(each, name=name) for each, name in zip(found.stops, stops, strict=True)),
    )


# -- names in a mechanism file of the features found in its CAD file --------------------------------------------------


def named_as_written(found: FoundGeometry, text: str) -> FoundGeometry:
    """Return the features of a mechanism file's CAD file with their names in its text, marked tables included."""
    tables = _tables(text)
    of_parts = [(name, parts_of_body(table)) for kind, name, table in tables if kind == "bodies"]
    bodies = {found.whole(parts[0]): name for name, parts in of_parts if parts}
    found = replace(found, bodies={part: bodies.get(part, name) for part, name in found.bodies.items()})
    written = [place for kind, name, table in tables if kind == "joints" for place in _joint(name, table)]
    stops = [place for kind, name, table in tables if kind == "contacts" for place in _stop(name, table)]
    proposed = [(stop.name, *stop_sides(found, stop)) for stop in found.stops]
    of_stops = [place for name, a, b in proposed for place in _stop(name, {"a": a, "b": b})]
    return _renamed(found, _matched(_places_of_joints(found), written), _matched(of_stops, stops, _SAME))


def _tables(text: str) -> list[tuple[str, str, dict[str, Any]]]:
    """Return kind, name and keys of each named table; lines that cannot be read on their own are skipped."""
    found: dict[str, dict[str, Any]] = {}
    for (header, key), entry in entries_of(text.splitlines()).items():
        table = found.setdefault(header.strip("[]"), {})
        try:
            table |= tomllib.loads(f"{key} = {entry.value}") if key else {}
        except tomllib.TOMLDecodeError:  # a value that continues on the next line
            continue
    return [(*header.split("."), table) for header, table in found.items() if header.count(".") == 1]  # type: ignore[misc]


def _joint(name: str, table: dict[str, Any]) -> Iterator[_NamedPlace]:
    """Yield the position of a joint in the body around its pin or ball."""
    for outer, inner, where in (("bearing", "journal", ("hole", "near")), ("socket", "ball", ("point",))):
        point = _point(table, outer, *where)
        if point is not None:
            yield _NamedPlace(name, (_body(table, inner), _body(table, outer)), point)


def _stop(name: str, table: dict[str, Any]) -> Iterator[_NamedPlace]:
    """Yield the position of a stop in the body of its side b, and the kind of that side."""
    for kind, *where in _STOP_PLACES:
        point = _point(table, "b", kind, *where)
        if point is not None:
            yield _NamedPlace(name, (kind, _body(table, "b"), _body(table, "a")), point)


def _body(table: dict[str, Any], side: str) -> str:
    return str(entry.get("body")) if isinstance(entry := table.get(side), dict) else ""


def _point(table: dict[str, Any], *path: str | int) -> Array | None:
    """Return a point in a table; None if there is no list of three numbers."""
    entry: Any = table
    for key in path:
        if isinstance(key, int):
            entry = entry[key] if isinstance(entry, list) and key < len(entry) else None
        else:
            entry = entry.get(key) if isinstance(entry, dict) else None
    if isinstance(entry, list | np.ndarray) and len(entry) == 3 and all(isinstance(x, int | float) for x in entry):
        return np.array(entry, float)
    return None


# -- the text of the file ---------------------------------------------------------------------------------------------

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
        lines, self._before, self._after = text.splitlines(), before.splitlines(), after.splitlines()
        self._lines, self._joined = lines, _joined_bodies(before, after)
        self._own, self._old, self._new = entries_of(lines), entries_of(self._before), entries_of(self._after)
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
        return replace(self._said, text=text + "\n")

    def _follow(self, key: Key, entry: ProposedLine) -> None:
        """Replace a line that is still as it was proposed by the one proposed now."""
        was, own = self._old[key], self._own.get(key)
        if own is not None:
            self._out[own.place][:0] = self._not_asked(entry)  # the new questions about a key above its line
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
            self._drop_joined(own)
        elif (key[0], "") in self._new or key[0] in ("", _PARAMETERS) or (header and header.marked):
            if (own.value, own.marked) == (was.value, was.marked):
                self._out[own.place].pop(0)
            elif not was.questions or not self._asks.keys() & set(map(what_it_asks, was.questions)):
                self._said.kept.append(f"{path_of(key)}: no longer proposed, and was {was.value}")

    def _drop_joined(self, header: ProposedLine) -> None:
        """Remove the table of a body that has become part of another one, or of its joint, if it is as proposed."""
        own, proposed = (_without_questions(table_lines(x, header.value)) for x in (self._lines, self._before))
        names = {header.value, *re.findall(r'body = ("[\w-]+")', "\n".join(own))}
        if own != proposed or not names & self._joined:
            return
        first = header.place - len(header.questions)
        for place in range(first, first + len(table_lines(self._lines, header.value))):
            self._out[place] = []

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

    def _not_asked(self, entry: ProposedLine) -> list[str]:
        """Return the questions about a key that were not asked about the earlier revision."""
        return [line for line in entry.questions if what_it_asks(line) not in self._asked]


def _joined_bodies(before: str, after: str) -> set[str]:
    """Return the bodies that are part of others now, as their headers and as texts: ``[bodies.lid]``, ``"lid"``."""
    old, new = (
        {n: set(parts_of_body(b)) for n, b in sub_table(tomllib.loads(x), "bodies").items()} for x in (before, after)
    )
    elsewhere = set().union(*new.values())
    gone = [name for name, parts in old.items() if name not in new and parts <= elsewhere]
    return {each for name in gone for each in (f"[bodies.{name}]", f'"{name}"')}


def _without_questions(lines: list[str]) -> list[str]:
    return [line for line in lines if not line.startswith(QUESTION)]


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
