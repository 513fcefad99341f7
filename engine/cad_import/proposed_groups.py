"""Parts that move as one body: proposed from subassemblies and touching faces, or as a mechanism file lists them.

A subassembly is one body unless a joint with pin or ball is drawn in it. A part that no joint holds is one body with
the part that it lies against, without play, over most of the area in which it touches others at all.
"""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from engine.cad.cad_model import CadAssembly, CadPart
from engine.cad.findings import FacingPlanes
from engine.mechanism.faults import as_table, named_tables, sub_table
from engine.mechanism.geometry.part_bodies import parts_of_body

_TOUCHING = 1e-3  # mm between two planes without play
_LEAST_SHARE = 0.03  # of a part's surface that lies against another part
_MOST_OF_IT = 0.6  # of the area in which a part touches others


@dataclass(frozen=True)
class PartGroup:
    """Parts that are one body."""

    name: str
    parts: tuple[str, ...]
    """The first one gives the body its frame."""
    why: str = ""
    """How it was found, in words; empty if a person has listed it."""


class _Groups:
    """Parts in disjoint sets, each with the reasons for which it was made."""

    def __init__(self, parts: Iterable[str]) -> None:
        self.of = {part: [part] for part in parts}
        self._why: dict[str, list[str]] = {part: [] for part in self.of}

    def join(self, parts: Sequence[str], why: str) -> None:
        """Make parts, and what they are joined to already, one set."""
        first = self.of[parts[0]]
        for part in parts[1:]:
            if (other := self.of[part]) is not first:
                self._why[first[0]] += [*self._why[other[0]], why]
                first += other
                self.of |= dict.fromkeys(other, first)

    def sets(self) -> list[tuple[list[str], str]]:
        """Return the sets of several parts, each with its reasons."""
        return [
            (parts, " and ".join(dict.fromkeys(self._why[parts[0]])))
            for part, parts in self.of.items()
            if len(parts) > 1 and part == parts[0]
        ]


def proposed_groups(
    assembly: CadAssembly, jointed: Sequence[frozenset[str]], planes: Sequence[FacingPlanes]
) -> list[PartGroup]:
    """Return the groups of parts of an assembly; none if all of its parts would be one body.

    `jointed` are the pairs of parts with a joint between them, `planes` the flat faces that face each other.
    """
    groups = _Groups(part.name for part in assembly.parts)
    for parts in _rigid_subassemblies(assembly.parts, jointed):
        groups.join(parts, "by subassembly")
    _join_touching(assembly, groups, jointed, planes)
    sets = groups.sets()
    if len(sets) == 1 and len(sets[0][0]) == len(assembly.parts):
        return []
    volumes = {part.name: sum(solid.volume for solid in part.solids) for part in assembly.parts}
    order = [part.name for part in assembly.parts]
    found: list[PartGroup] = []
    for parts, why in sets:
        main = max(parts, key=lambda name: volumes[name])
        others = sorted((name for name in parts if name != main), key=order.index)
        found.append(PartGroup(main, (main, *others), why))
    return sorted(found, key=lambda group: order.index(group.parts[0]))


def _rigid_subassemblies(parts: Sequence[CadPart], jointed: Sequence[frozenset[str]]) -> list[list[str]]:
    """Return the parts of each subassembly without a joint in it."""
    found: dict[tuple[int, ...], list[str]] = {}
    for part in parts:
        for depth in range(2, len(part.branch)):
            found.setdefault(part.branch[:depth], []).append(part.name)
    return [
        names
        for names in found.values()
        if 1 < len(names) < len(parts) and not any(pair <= set(names) for pair in jointed)
    ]


def _join_touching(
    assembly: CadAssembly, groups: _Groups, jointed: Sequence[frozenset[str]], planes: Sequence[FacingPlanes]
) -> None:
    """Join each part without a joint to the one that it lies against over most of the area in which it touches."""
    areas = dict.fromkeys((part.name for part in assembly.parts), 0.0)
    for face in assembly.faces:
        areas[face.part] += face.area
    touched: dict[str, dict[str, float]] = {part: {} for part in areas}
    for pair in planes:
        if abs(pair.gap) <= _TOUCHING:
            for one, other in (pair.parts, pair.parts[::-1]):
                touched[one][other] = touched[one].get(other, 0.0) + pair.area
    held = {part for pair in jointed for part in pair}
    for part in sorted(touched, key=lambda name: areas[name]):
        shares: dict[int, tuple[float, str]] = {}
        for other, area in touched[part].items():
            key = id(groups.of[other])
            shares[key] = (shares.get(key, (0.0, ""))[0] + area, other)
        own = id(groups.of[part])
        if any(each in held for each in groups.of[part]) or own in shares or not shares:
            continue
        area, other = max(shares.values())
        if area >= max(_LEAST_SHARE * areas[part], _MOST_OF_IT * sum(each for each, _ in shares.values())):
            groups.join([other, part], "by touching faces")


# -- groups in a mechanism file ---------------------------------------------------------------------------------------


def groups_of_bodies(text: str) -> list[PartGroup]:
    """Return the groups of a mechanism file for which its bodies are written, under the names of its ``[groups]``."""
    listed = listed_groups(text) or []
    found: list[PartGroup] = []
    for name, body in named_tables(_tables(text), "bodies").items():
        parts = tuple(parts_of_body(body))
        if "parts" in body and parts:
            common = max(listed, key=lambda group: len(set(group.parts) & set(parts)), default=None)
            is_listed = common is not None and set(common.parts) & set(parts)
            taken = {group.name for group in found}
            own = common.name if is_listed and common is not None and common.name not in taken else name
            found.append(PartGroup(own, parts))
    return found


def listed_groups(text: str) -> list[PartGroup] | None:
    """Return the groups that a person wants according to a mechanism file; None if it has no ``[groups]``."""
    tables = _tables(text)
    if "groups" not in tables:
        return None
    return [
        PartGroup(name, tuple(dict.fromkeys(part for part in parts if isinstance(part, str))))
        for name, parts in sub_table(tables, "groups").items()
        if isinstance(parts, list)
    ]


def _tables(text: str) -> Mapping[str, Any]:
    return as_table(tomllib.loads(text))


def updated_groups(
    listed: Sequence[PartGroup], proposed: Sequence[PartGroup], names: Mapping[str, str], parts: Sequence[str]
) -> list[PartGroup]:
    """Return the groups of a new revision: as listed, with new parts where they would be proposed.

    `names` are the names that parts of the earlier revision have in the new one, which has `parts`. A group of which
    only new parts are left out by the listed ones is new.
    """
    known = set(names.values())
    groups = {group.name: [names[part] for part in group.parts if part in names] for group in listed}
    for proposal in proposed:
        new = [part for part in proposal.parts if part not in known]
        sizes = {name: len(set(own) & set(proposal.parts)) for name, own in groups.items()}
        target = max(sizes, key=lambda name: sizes[name], default="")
        if new and target and sizes[target]:
            groups[target] += new
        elif len(new) > 1:
            groups[new[0]] = new
    return [PartGroup(name, tuple(own)) for name, own in groups.items() if own and set(own) <= set(parts)]


def usable(groups: Iterable[PartGroup], parts: Iterable[str]) -> list[PartGroup]:
    """Return the groups of two or more parts of an assembly, without parts that it lacks or that an earlier one has."""
    free = set(parts)
    found = []
    for group in groups:
        own = tuple(part for part in group.parts if part in free)
        free -= set(own)
        if len(own) > 1:
            found.append(PartGroup(group.name, own, group.why))
    return found
