"""Convert a mechanism file that names geometry of a CAD file to one with plain numbers and a certificate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from shlex import quote
from typing import Any

from pydantic import ValidationError

from engine.arrays import Array
from engine.cad import CadAssembly, CadEdge, CadFace, in_unit, read_step
from engine.cad.cad_model import with_joined_parts
from engine.cad.step_reader import MeasuredShape, ShapePair, drawn_distances
from engine.errors import CadError, Fault
from engine.mechanism.base import is_number
from engine.mechanism.faults import as_table, faults_of, named_tables, sub_table
from engine.mechanism.geometry.cad_table import (
    AS_DRAWN,
    SELECTORS,
    CadTable,
    DrawnBody,
    DrawnFace,
    DrawnGap,
    DrawnJoint,
    FeatureKind,
    GeometryCertificate,
    selector_of,
)
from engine.mechanism.geometry.drawn_features import (
    DrawnPin,
    NotAsDrawn,
    NotASurface,
    NotOneFace,
    PartSearch,
    axis_of,
    contact_side,
    drawn_faces,
    drawn_outline,
    feature_of,
    joint_of_pin,
    length,
    line_side,
    spline_faces,
    surface_table,
    viewing_direction,
)
from engine.mechanism.geometry.part_bodies import (
    POSE,
    DensityRules,
    NoDensity,
    NoPart,
    body_of_part,
    joined_name,
    mass_properties,
    part_of_body,
    parts_of_body,
)
from engine.mechanism.quantities import UnitSystem

TOUCHING = 1e-7  # distance [mm] below which OCCT considers shapes to touch
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
            known = ", ".join(self.parts) or "none is one"
            text = (
                f"no body that is a part of the CAD file; allowed: {known}; name one of them, or give that body a part"
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
    if kind := selector_of(side):
        return {"hole": "bore", "pin": "cylinder"}.get(kind, kind)
    return next((key for key in as_table(side) if key not in ("body", "within")), "")


def measured_feature(search: PartSearch, feature: CadFace | CadEdge) -> MeasuredShape | None:
    """Return a face or an edge of a part as one end of a distance; a flat face includes all faces coplanar with it."""
    if isinstance(feature, CadEdge):
        return MeasuredShape(_place(search, feature.faces[0]), edges=feature.places)
    return measured_surface(search, search.pieces(feature))


def measured_surface(search: PartSearch, faces: Sequence[CadFace]) -> MeasuredShape | None:
    """Return faces of a part, without others on their planes, as one end of a distance; None if of several parts."""
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
    """Return the distance of each pair that has one, by joint or contact, and the reason if none was measured."""
    if not pairs:
        return {}, ""
    try:
        distances = drawn_distances(path, sha256, list(pairs.values()))
    except CadError as error:  # OCCT may fail to measure a file that it can read: no reason to refuse the mechanism
        return {}, str(error)
    found = zip(pairs, distances, strict=True)
    return {key: DrawnGap(drawn=length(far * millimetre, millimetre)) for key, far in found if far > TOUCHING}, ""


# A file as a whole.


class UnresolvedGeometry(Exception):
    """One fault for each feature named by a mechanism file that the CAD file lacks or has in several places."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__(f"{len(faults)} faults")
        self.faults = faults


def with_geometry(data: Mapping[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """Return a mechanism file with the geometry that it names replaced by numbers, and its certificate in ``geometry``.

    The path in its ``cad`` table, which is removed, is relative to ``folder``. Raise UnresolvedGeometry.
    """
    units: UnitSystem = "SI" if data.get("units") == "SI" else "mm-g-ms"
    try:
        table = CadTable.model_validate(data["cad"])
    except ValidationError as error:
        faults = faults_of(error, CadTable, units)
        keyed = [Fault(("cad", *f.keys), f.text, f.value, f.unit) for f in faults]
        raise UnresolvedGeometry(keyed) from None
    try:
        assembly = read_step(folder / table.file, table.recognition)
    except CadError as error:
        raise UnresolvedGeometry([Fault(("cad", "file"), str(error), table.file)]) from None
    if assembly.sha256 != table.sha256:
        text = (
            f"{table.file} has another content, with the SHA-256 {assembly.sha256}; allowed: the content that this file"
            f" was written for; see what changed, and bring the file to it, with clearcap mechanism import"
            f" {quote(str(folder / table.file))} --update {quote(source)}"
        )
        raise UnresolvedGeometry([Fault(("cad", "sha256"), text, table.sha256)])
    used = [part for body in named_tables(data, "bodies").values() for part in parts_of_body(body)]
    damaged = [part for part in assembly.damaged if part in used]
    if damaged and not table.accept_damage:
        text = f"{assembly.damage}, or take what is left with accept_damage = true beside it"
        raise UnresolvedGeometry([Fault(("cad", "file"), text, table.file)])
    plain, tables = without_selectors(data, assembly)
    gaps, not_measured = drawn_gaps(folder / table.file, assembly.sha256, tables.pairs, tables.millimetre)
    certificate = GeometryCertificate(
        file=table.file,
        sha256=table.sha256,
        recognition=table.recognition,
        unreadable=assembly.unreadable if damaged else None,
        damaged=damaged,
        bodies=tables.bodies,
        faces=tables.faces,
        joints=tables.joints,
        gaps=gaps,
        not_measured=not_measured,
    )
    return {**plain, "geometry": certificate.model_dump(exclude_none=True)}


def without_selectors(data: Mapping[str, Any], assembly: CadAssembly) -> tuple[dict[str, Any], DrawnTables]:
    """Return a mechanism file without ``cad`` and with numbers for the features it names, and what was found for them.

    The assembly is in mm. Raise UnresolvedGeometry.
    """
    units: UnitSystem = "SI" if data.get("units") == "SI" else "mm-g-ms"
    joined = _joined_parts(data, assembly)
    assembly = with_joined_parts(assembly, joined, beside=True)
    drawn = assembly if units == "mm-g-ms" else in_unit(assembly, 1000.0)
    tables = DrawnTables(drawn, units, frozenset(joined), sub_table(data, "cad").get("density"))
    tables.faults.extend(_group_faults(data))
    plain = _plain({key: value for key, value in data.items() if key not in ("cad", "groups")}, (), tables)
    if "benches" in plain:
        benches = named_tables(data, "benches")
        plain["benches"] = {name: _plain(bench, ("benches", name), tables) for name, bench in benches.items()}
    if tables.faults:
        raise UnresolvedGeometry(tables.faults)
    return plain, tables


def _joined_parts(data: Mapping[str, Any], assembly: CadAssembly) -> dict[str, list[str]]:
    """Return the parts of each body that is made of several, by the name of the part that they become."""
    known = [part.name for part in assembly.parts]
    tables = [data, *named_tables(data, "benches").values()]
    bodies = [body for table in tables for body in named_tables(table, "bodies").values() if "parts" in body]
    joined = {}
    for body in bodies:
        parts = parts_of_body(body)
        if len(parts) > 1 and len(set(parts)) == len(parts) and set(parts) <= set(known):
            joined[joined_name(parts)] = parts
    return joined


def _group_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Return a fault for each group with other parts than the body of its parts."""
    bodies = {name: parts_of_body(body) for name, body in named_tables(data, "bodies").items()}
    faults = []
    for group, parts in as_table(data.get("groups", {})).items():
        if not isinstance(parts, list) or not all(isinstance(part, str) for part in parts):
            faults.append(Fault(("groups", group), "no list of parts; allowed: names of parts; correct it", parts))
            continue
        other = [name for name, own in bodies.items() if set(own) & set(parts) and set(own) != set(parts)]
        if other:
            text = (
                f"not the parts of {', '.join(f'bodies.{name}' for name in other)}; allowed: the parts of one body; if"
                " this group is right, clearcap mechanism import with the STEP file and --update with this file brings"
                " bodies and joints to it"
            )
            faults.append(Fault(("groups", group), text, parts))
    return faults


def _plain(data: Mapping[str, Any], keys: tuple[str, ...], tables: DrawnTables) -> dict[str, Any]:
    """Return the file, or one of its benches, with plain numbers in its bodies, joints and contacts."""
    plain = dict(data)
    for table, made in (("bodies", tables.body), ("joints", tables.joint), ("contacts", tables.contact)):
        if isinstance(data.get(table), Mapping):
            plain[table] = {
                name: made((*keys, table, name), as_table(entry)) if isinstance(entry, Mapping) else entry
                for name, entry in sub_table(data, table).items()
            }
    return plain
