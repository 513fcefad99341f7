"""Parts that move as one body: proposed from fasteners, subassemblies and touching faces, or as a file lists them.

Screws, nuts and washers on one axis join the only part that they hold, or two parts that are held on two axes; on a
single axis between two parts they may be a pivot, and join the part that they are screwed into. A bearing joins the
part in which it sits, a pin the part into which it is pressed, a component its circuit board. A subassembly is one body
unless a joint with pin or ball is drawn in it, and several if it is in places apart from each other. A part that no
joint holds is one body with the part that it lies against, without play, over most of the area in which it touches
others.
"""

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from engine.cad.cad_model import CadAssembly, CadFace, CadPart
from engine.cad.findings.facing_planes import FacingPlanes
from engine.cad.findings.joints import UndrawnPin, coaxial_fits
from engine.cad.findings.standard_parts import StandardPart
from engine.mechanism.faults import as_table, named_tables, sub_table
from engine.mechanism.geometry.part_bodies import parts_of_body

_TOUCHING = 1e-3  # mm between two planes without play
_SOLDERED = 0.15  # mm between a component and its board
_ONE_AXIS = 0.5  # mm between the axes of screws, nuts and washers that are one stack
_TIGHT = 1e-3  # mm between the radii of a thread or a press fit, as drawn
_EQUAL = 1e-6  # mm between radii of a pin and a hole that are drawn alike
_PRESSED, _SHARE_PRESSED = 0.04, 0.01  # mm, and share of the radius, by which a pressed pin is larger at most
_BESIDE = 1.0  # mm between boxes around parts that are beside each other
_LEAST_SHARE = 0.03  # of a part's surface that lies against another part
_MOST_OF_IT = 0.6  # of the area in which a part touches others


@dataclass(frozen=True)
class PartGroup:
    """Parts that are one body."""

    name: str
    parts: tuple[str, ...]  # the first one gives the body its frame
    why: str = ""  # how it was found, in words; empty if a person has listed it


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
    assembly: CadAssembly,
    jointed: Sequence[frozenset[str]],
    planes: Sequence[FacingPlanes],
    standard: Sequence[StandardPart] = (),
    undrawn: Sequence[UndrawnPin] = (),
) -> list[PartGroup]:
    """Return the groups of parts of an assembly; none if all of its parts would be one body.

    `jointed` are the pairs of parts with a joint between them, `planes` the flat faces that face each other, `standard`
    the parts that are bought, `undrawn` the holes for pins or screws that are not drawn.
    """
    kinds = {each.part: each.kind for each in standard}
    jointed = [pair for pair in jointed if not pair & set(kinds)]
    groups = _Groups(part.name for part in assembly.parts)
    fits = coaxial_fits(assembly)
    for hole, pin in fits:
        if _is_pressed(hole, pin):
            groups.join([hole.part, pin.part], "by press fit")
    _join_bearings(groups, kinds, fits)
    _join_boards(groups, kinds, planes)
    jointed = [*jointed, *_join_fasteners(assembly, groups, kinds, fits, planes)]
    jointed = [*jointed, *_join_screw_holes(groups, undrawn, planes)]
    for parts in _rigid_subassemblies(assembly.parts, jointed):
        groups.join(parts, "by subassembly")
    _join_touching(assembly, groups, jointed, planes)
    sets = groups.sets()
    if len(sets) == 1 and len(sets[0][0]) == len(assembly.parts):
        return []
    order = [part.name for part in assembly.parts]
    found: list[PartGroup] = []
    for parts, why in sets:
        main = max(parts, key=lambda name: _volume(assembly, name))
        others = sorted((name for name in parts if name != main), key=order.index)
        found.append(PartGroup(main, (main, *others), why))
    return sorted(found, key=lambda group: order.index(group.parts[0]))


Fits = Sequence[tuple[CadFace, CadFace]]


def _is_pressed(hole: CadFace, pin: CadFace) -> bool:
    """Return whether a pin is drawn larger than the hole around it by as much as it is pressed in."""
    gaps = hole.recognition_gap + pin.recognition_gap + _EQUAL
    larger = pin.radius - hole.radius
    return gaps < larger <= min(_PRESSED, _SHARE_PRESSED * pin.radius) and _apart(hole, pin) <= _PRESSED


def _join_bearings(groups: _Groups, kinds: Mapping[str, str], fits: Fits) -> None:
    """Join each bearing, or ring of one, to the part in which it sits; without one, to the shaft in it."""
    for part, kind in kinds.items():
        if kind != "bearing":
            continue
        seats = [(hole, pin) for hole, pin in fits if pin.part == part and hole.part not in kinds]
        shafts = [(hole, pin) for hole, pin in fits if hole.part == part and pin.part not in kinds]
        if seats:
            groups.join([min(seats, key=_play)[0].part, part], "by bearing")
        elif shafts:
            groups.join([min(shafts, key=_play)[1].part, part], "by bearing")


def _join_boards(groups: _Groups, kinds: Mapping[str, str], planes: Sequence[FacingPlanes]) -> None:
    """Join each circuit board, and each component of one, to the part on which it is soldered or lies."""
    for part, kind in kinds.items():
        beneath: dict[str, float] = {}
        for pair in planes:
            if kind == "board" and part in pair.parts and abs(pair.gap) <= _SOLDERED:
                other = pair.parts[pair.parts[0] == part]
                beneath[other] = beneath.get(other, 0.0) + pair.area
        if beneath:
            groups.join([max(beneath, key=lambda other: beneath[other]), part], "by circuit board")


def _play(fit: tuple[CadFace, CadFace]) -> float:
    return abs(fit[0].radius - fit[1].radius)


def _join_fasteners(
    assembly: CadAssembly, groups: _Groups, kinds: Mapping[str, str], fits: Fits, planes: Sequence[FacingPlanes]
) -> list[frozenset[str]]:
    """Join the fasteners on each axis to what they hold, and what fasteners on two axes hold.

    Return the pairs of parts with fasteners on one axis: these may be a pivot.
    """
    touching = [pair.parts for pair in planes if abs(pair.gap) <= _TOUCHING]
    stacks = _Groups(part for part, kind in kinds.items() if kind == "fastener")
    for one, other in [*((hole.part, pin.part) for hole, pin in fits), *touching]:
        if one in stacks.of and other in stacks.of:
            stacks.join([one, other], "")
    axes: dict[frozenset[str], list[CadFace]] = {}
    for stack in {id(each): each for each in stacks.of.values()}.values():
        groups.join(stack, "by fastener")
        own = [fit for fit in fits if (fit[0].part in stack) != (fit[1].part in stack)]
        beside = {face.part for fit in own for face in fit}
        beside |= {part for pair in touching if set(pair) & set(stack) for part in pair}
        held = sorted(part for part in beside if kinds.get(part) != "fastener")
        if not own or not held:
            continue
        tight = [fit for fit in own if fit[0].radius - fit[1].radius <= _TIGHT]
        threaded = sorted({face.part for fit in tight for face in fit} & set(held))
        groups.join([max(threaded or held, key=lambda part: _volume(assembly, part)), *stack], "by fastener")
        for both in combinations(held, 2):
            axes.setdefault(frozenset(both), []).append(own[0][0])
    pivots = []
    for parts, faces in axes.items():
        if any(_apart(faces[0], face) > _ONE_AXIS for face in faces[1:]):
            groups.join(sorted(parts), "by fastener")
        else:
            pivots.append(parts)
    return pivots


def _join_screw_holes(
    groups: _Groups, undrawn: Sequence[UndrawnPin], planes: Sequence[FacingPlanes]
) -> list[frozenset[str]]:
    """Join parts that touch and have equal holes on two axes, for screws that are not drawn; return the other pairs."""
    touching = {frozenset(pair.parts) for pair in planes if abs(pair.gap) <= _TOUCHING}
    counts = Counter(frozenset(pin.parts) for pin in undrawn)
    for pair, count in counts.items():
        if count > 1 and pair in touching:
            groups.join(sorted(pair), "by holes for screws")
    return [pair for pair, count in counts.items() if count == 1 or pair not in touching]


def _volume(assembly: CadAssembly, part: str) -> float:
    return sum(solid.volume for solid in assembly.part(part).solids)


def _apart(first: CadFace, other: CadFace) -> float:
    """Return the distance of a cylinder from the axis of another [mm]."""
    return float(np.linalg.norm(np.cross(other.point - first.point, first.axis)))


def _rigid_subassemblies(parts: Sequence[CadPart], jointed: Sequence[frozenset[str]]) -> list[list[str]]:
    """Return the parts of each subassembly without a joint in it; of one in several places, those of each place."""
    found: dict[tuple[int, ...], list[CadPart]] = {}
    for part in parts:
        for depth in range(2, len(part.branch)):
            found.setdefault(part.branch[:depth], []).append(part)
    return [
        names
        for own in found.values()
        if 1 < len(own) < len(parts) and not any(pair <= {part.name for part in own} for pair in jointed)
        for names in _places(own)
        if len(names) > 1
    ]


def _places(parts: Sequence[CadPart]) -> list[list[str]]:
    """Return the names of parts, those together that are connected by boxes around them that touch."""
    groups = _Groups(part.name for part in parts)
    for one, other in combinations(parts, 2):
        if (np.maximum(one.bounds[0], other.bounds[0]) <= np.minimum(one.bounds[1], other.bounds[1]) + _BESIDE).all():
            groups.join([one.name, other.name], "")
    return list({id(each): each for each in groups.of.values()}.values())


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
