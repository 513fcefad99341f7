"""Replace references to CAD geometry by plain numbers in the tables of a mechanism file; measure pairs of sides."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from engine.arrays import Array
from engine.cad import CadAssembly, CadEdge, CadFace
from engine.cad.step_reader import MeasuredShape, ShapePair, drawn_distances
from engine.errors import CadError
from engine.faults.fault import Fault
from engine.mechanism.base import is_number
from engine.mechanism.faults import as_table, faults_of
from engine.mechanism.geometry.cad_table import (
    AS_DRAWN,
    SELECTORS,
    DrawnBody,
    DrawnFace,
    DrawnGap,
    DrawnJoint,
    FeatureKind,
    selector_of,
)
from engine.mechanism.geometry.drawn_features import (
    DrawnPin,
    NotAsDrawn,
    NotASurface,
    drawn_faces,
    drawn_outline,
    joint_of_pin,
    spline_faces,
    surface_table,
    viewing_direction,
)
from engine.mechanism.geometry.face_search import (
    NotOneFace,
    PartSearch,
    axis_of,
    contact_side,
    feature_of,
    length,
    line_side,
)
from engine.mechanism.geometry.part_bodies import (
    POSE,
    DensityRules,
    NoDensity,
    NoPart,
    body_of_part,
    mass_properties,
    part_of_body,
    parts_of_body,
)
from engine.mechanism.quantities import UnitSystem

TOUCHING = 1e-7
"""Distance [mm] below which OCCT considers shapes to touch."""

Keys = tuple[str, ...]
WEIGHS = {"mass", "center_of_mass", "inertia"}
_JOINT_SIDES: dict[str, FeatureKind] = {"bearing": "hole", "journal": "pin"}


@dataclass(frozen=True)
class DrawnTables:
    """Converts tables to plain numbers and collects their faults and the entries of the certificate."""

    assembly: CadAssembly  # in the mechanism's unit of length
    units: UnitSystem
    joined: frozenset[str] = frozenset()  # names of the parts that several parts of one body become
    density: float | str | None = None  # of solids of which neither a body nor the CAD file has one
    parts: dict[str, str] = field(default_factory=dict)  # body -> part, for each body that is a part
    moved: set[str] = field(default_factory=set)  # bodies whose pose is not that in the CAD file
    faults: list[Fault] = field(default_factory=list)
    bodies: dict[str, DrawnBody] = field(default_factory=dict)
    faces: dict[str, DrawnFace] = field(default_factory=dict)
    features: dict[str, CadFace | CadEdge] = field(default_factory=dict)
    joints: dict[str, DrawnJoint] = field(default_factory=dict)
    pairs: dict[str, ShapePair] = field(default_factory=dict)  # of joints and contacts with a distance in the CAD file

    @cached_property
    def direction(self) -> Array:
        """The viewing direction for the outlines of bodies."""
        return viewing_direction(self.assembly)

    @property
    def millimetre(self) -> float:
        """The length of a millimetre in the mechanism's unit of length."""
        return 1.0 if self.units == "mm-g-ms" else 1e-3

    def body(self, keys: Keys, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the table of a body with plain numbers."""
        if not body.keys() & {"part", "parts"}:
            return dict(body)
        try:
            name = part_of_body(body, [part.name for part in self.assembly.parts if part.name not in self.joined])
        except NoPart as error:
            self.faults.append(Fault((*keys, error.key), str(error), error.value))
            return {}
        part = self.assembly.part(name)
        self.parts[keys[-1]] = name
        if body.keys() & POSE:
            self.moved.add(keys[-1])
        masses = None
        if body.get("fixed") is not True and not body.keys() >= WEIGHS:
            try:
                rules = DensityRules(1.0 if self.units == "mm-g-ms" else 1000.0, self.millimetre, self.density)
                members = [self.assembly.part(each) for each in parts_of_body(body)]
                masses = mass_properties(members, body, rules)
            except NoDensity as error:
                self.faults.append(Fault((*keys, "density"), str(error), body.get("density")))
                return {}
        plain = body_of_part(part, body, masses, self.millimetre)
        if "outline" not in plain and (corners := drawn_outline(self.assembly, name, self.direction, self.millimetre)):
            plain["outline"] = corners
        own = body.get("mass")
        self.bodies[".".join(keys)] = DrawnBody(
            part=name,
            volume=sum(solid.volume for solid in part.solids),
            drawn_mass=masses.mass if masses else None,
            mass=float(own) if isinstance(own, int | float) else None,
            density_from=masses.source if masses else "",
        )
        return plain

    def joint(self, keys: Keys, joint: Mapping[str, Any]) -> dict[str, Any]:
        """Return the table of a joint with plain numbers."""
        sides = {side: as_table(joint[side]) for side in (*_JOINT_SIDES, "a", "b") if selector_of(joint.get(side))}
        if not sides:
            return self._without_words(keys, joint)
        if not self._are_allowed(keys, sides):
            return {}
        found = {side: self._feature((*keys, side), table) for side, table in sides.items()}
        if None in found.values():
            return {}
        plain = {**joint, **{side: _without_selector(as_table(joint[side])) for side in sides}}
        searches = {side: self._search(as_table(joint[side])["body"]) for side in sides}
        if set(found) == set(_JOINT_SIDES):
            return self._pin_in_hole(keys, plain, found, searches)
        for side, feature in found.items():
            if isinstance(feature, CadFace) and side in _JOINT_SIDES:
                radius = {"radius": feature.radius} if side == "journal" else {}
                table = radius | plain[side]
                plain[side] = line_side(searches[side], table, feature.point, axis_of(feature))
            elif isinstance(feature, CadFace):
                at, normal = searches[side].to_body(feature.on), searches[side].turned_to_body(feature.normal)
                plain[side] = {"point": at, "normal": normal, **plain[side]}
        return self._without_words(keys, plain)

    def _are_allowed(self, keys: Keys, sides: Mapping[str, Any]) -> bool:
        """Return whether the sides of a joint name faces of the right kinds; add a fault for each that does not."""
        allowed = True
        for side, table in sides.items():
            kind, right = selector_of(table), _JOINT_SIDES.get(side, "plane")
            if kind != right:
                self.faults.append(Fault((*keys, side, str(kind)), f"not for {side}; allowed: {right}; name one"))
                allowed = False
        return allowed

    def _pin_in_hole(self, keys: Keys, joint: dict[str, Any], found: Any, searches: Any) -> dict[str, Any]:
        """Return the table of a joint with a face on both sides."""
        drawn = DrawnPin(found["bearing"], found["journal"])
        try:
            plain = joint_of_pin(drawn, joint, (searches["bearing"], searches["journal"]))
        except NotAsDrawn as error:
            value = AS_DRAWN if error.key in joint else None
            self.faults.append(Fault((*keys, *error.key.split(".")), str(error), value))
            return {}
        self.joints[keys[-1]] = drawn.certificate()
        if "radial_clearance" in joint:
            self._measure(keys, joint, ("bearing", "journal"))
        return plain

    def _without_words(self, keys: Keys, joint: Mapping[str, Any]) -> dict[str, Any]:
        """Return a joint that requests nothing as drawn; add a fault for each key that does."""
        for key in ("radial_clearance", "rings"):
            if joint.get(key) == AS_DRAWN:
                text = (
                    "only between faces; allowed: where the bearing is a hole and the journal a pin of the CAD file;"
                    " name both faces, or write a number"
                )
                self.faults.append(Fault((*keys, key), text, AS_DRAWN))
        return dict(joint)

    def contact(self, keys: Keys, contact: Mapping[str, Any]) -> dict[str, Any]:
        """Return the table of a contact with plain numbers."""
        plain = dict(contact)
        for side, other in (("a", "b"), ("b", "a")):
            kind = selector_of(contact.get(side))
            if kind is None:
                continue
            table = as_table(contact[side])
            if kind == "surface":
                surface = self._surface((*keys, side), table)
                if surface is None:
                    return {}
                plain[side] = _without_selector(table) | {"surface": surface}
                continue
            feature = self._feature((*keys, side), table)
            if feature is None:
                return {}
            primitive = contact_side(self._search(table["body"]), kind, feature, _primitive(contact.get(other)))
            plain[side] = _without_selector(table) | primitive
        self._measure(keys, contact, ("a", "b"))
        return plain

    def _measure(self, keys: Keys, entry: Mapping[str, Any], sides: tuple[str, str]) -> None:
        """Record two sides whose distance OCCT can measure too: faces, edges and points of bodies posed as drawn."""
        ends = []
        for side in sides:
            table = as_table(entry.get(side))
            body = table.get("body")
            if not isinstance(body, str) or body not in self.parts or body in self.moved:
                return
            ends.append(self._measured((*keys, side), table))
        first, second = ends
        if first is not None and second is not None and not (first.point and second.point):
            self.pairs[".".join(keys)] = first, second

    def _measured(self, keys: Keys, side: Mapping[str, Any]) -> MeasuredShape | None:
        """Return a side as one end of a distance; None if the CAD file does not show it."""
        search, where = self._search(side["body"]), ".".join(keys)
        if feature := self.features.get(where):
            return measured_feature(search, feature)
        named = [each for key, each in self.features.items() if key.startswith(f"{where}.surface.")]
        if faces := [each for each in named if isinstance(each, CadFace)]:
            return measured_surface(search, faces)
        return measured_point(search, side)

    def _surface(self, keys: Keys, side: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the table of the surface whose faces a side names; None, after adding faults, if there is none."""
        wanted = self._wanted(keys, side)
        if wanted is None:
            return None
        search, faces, splines = self._search(side["body"]), [], []
        for i, near in enumerate(wanted.faces):
            try:
                faces.append(search.face(near))
                if faces[-1] in faces[:-1]:
                    raise NotASurface("is a face that is named already; allowed: each face once; remove it")
                splines.append(spline_faces(search, faces[-1]))
            except (NotOneFace, NotASurface) as error:
                self.faults.append(Fault((*keys, "surface", "faces", str(i)), str(error)))
        if len(splines) < len(wanted.faces):
            return None
        table = surface_table(wanted, splines)
        drawn = drawn_faces(table, faces)
        names = [".".join((*keys, "surface", "faces", str(i))) for i in range(len(faces))]
        self.features.update(zip(names, faces, strict=True))
        self.faces.update(zip(names, drawn, strict=False))
        return table

    def _wanted(self, keys: Keys, side: Mapping[str, Any]) -> Any:
        """Return the checked selector of a side; None, after adding faults, if it is wrong."""
        kind = selector_of(side)
        assert kind is not None
        body = side.get("body")
        if not isinstance(body, str) or body not in self.parts:
            text = "no body that is a part of the CAD file; allowed: " + (
                f"{', '.join(self.parts) or 'none is one'}; name one of them, or give that body a part"
            )
            self.faults.append(Fault((*keys, "body"), text, body))
            return None
        try:
            return getattr(SELECTORS[kind].model_validate({kind: side[kind]}), kind)
        except ValidationError as error:
            found = faults_of(error, SELECTORS[kind], self.units)
            self.faults.extend(replace(fault, keys=(*keys, *fault.keys)) for fault in found)
            return None

    def _feature(self, keys: Keys, side: Mapping[str, Any]) -> CadFace | CadEdge | None:
        """Return the face or edge that a side names; None, after adding a fault, if there is none."""
        wanted, kind = self._wanted(keys, side), selector_of(side)
        if wanted is None or kind is None:
            return None
        try:
            feature = feature_of(self._search(side["body"]), kind, wanted)
        except NotOneFace as error:
            self.faults.append(Fault((*keys, kind), str(error)))
            return None
        where = ".".join(keys)
        self.features[where] = feature
        gap = feature.recognition_gap if isinstance(feature, CadFace) else 0.0
        radius = None if kind == "plane" else feature.radius
        self.faces[where] = DrawnFace(kind=kind, radius=radius, recognition_gap=gap)
        return feature

    def _search(self, body: str) -> PartSearch:
        """Return the search in the part of a body."""
        return PartSearch(self.assembly, self.parts[body], self.millimetre)


def _without_selector(side: Mapping[str, Any]) -> dict[str, Any]:
    """Return a side without its selector."""
    kind = selector_of(side)
    return {key: value for key, value in side.items() if key != kind}


def _primitive(side: Any) -> str:
    """Return the primitive of a side, or the one that its selector becomes."""
    kind = selector_of(side)
    if kind is not None:
        return {"hole": "bore", "pin": "cylinder"}.get(kind, kind)
    return next((key for key in as_table(side) if key not in ("body", "within")), "")


def measured_feature(search: PartSearch, feature: CadFace | CadEdge) -> MeasuredShape | None:
    """Return a face or an edge of a part as one end of a distance; a flat face includes all faces coplanar with it."""
    if isinstance(feature, CadEdge):
        return MeasuredShape(_place(search, feature.faces[0]), edges=feature.places)
    return measured_surface(search, search.pieces(feature))


def measured_surface(search: PartSearch, faces: Sequence[CadFace]) -> MeasuredShape | None:
    """Return faces of a part as one end of a distance, without other faces on their planes.

    None if they are of several parts of one body: the distance is measured from one part.
    """
    places = {_place(search, face.number) for face in faces}
    if len(places) > 1:
        return None
    return MeasuredShape(places.pop(), faces=tuple(place for face in faces for place in face.places))


def measured_point(search: PartSearch, side: Mapping[str, Any]) -> MeasuredShape | None:
    """Return a side as one end of a distance if it is a point given in plain numbers; otherwise None."""
    point = side.get("point")
    if not isinstance(point, list | tuple) or len(point) != 3 or not all(is_number(x) for x in point):
        return None
    return MeasuredShape(point=tuple(float(x) / search.millimetre for x in search.to_assembly(point)))


def _place(search: PartSearch, face: int) -> int:
    """Return the index in the assembly of the part, as drawn, that a face belongs to."""
    part = next(each.part for each in search.assembly.faces if each.number == face)  # parts as drawn come first
    return [each.name for each in search.assembly.parts].index(part)


def drawn_gaps(
    path: Path, sha256: str, pairs: Mapping[str, ShapePair], millimetre: float
) -> tuple[dict[str, DrawnGap], str]:
    """Return the distance of each pair that has one, by joint or contact, and the reason if none was measured.

    OCCT may fail to measure a file that it can read; this is no reason to refuse the mechanism. ``sha256`` is the hash
    of the CAD file, and ``millimetre`` the length of one in the mechanism's unit.
    """
    if not pairs:
        return {}, ""
    try:
        distances = drawn_distances(path, sha256, list(pairs.values()))
    except CadError as error:
        return {}, str(error)
    found = zip(pairs, distances, strict=True)
    return {key: DrawnGap(drawn=length(far * millimetre, millimetre)) for key, far in found if far > TOUCHING}, ""
