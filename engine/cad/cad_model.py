"""The content of a STEP file as plain numbers: parts, solids, faces, circular edges, limits of size, triangles.

All positions and directions are in the frame of the assembly, as posed in the file; lengths in mm, angles in rad. The
type of a field determines the power of the unit of length with which its numbers scale, see `in_unit`. A product is
read once, in its own frame, and placed as each of its parts, see `placed_product`; several parts become one rigid part
in `with_joined_parts`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, get_args, get_type_hints

import numpy as np

from engine.arrays import Array, Integers
from engine.errors import some

FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "surface"]

_T = TypeVar("_T")


@dataclass(frozen=True)
class LengthPower:
    """The power of the unit of length with which a number scales."""

    power: int


Millimetres = Annotated[float, LengthPower(1)]
SquareMillimetres = Annotated[float, LengthPower(2)]
CubicMillimetres = Annotated[float, LengthPower(3)]
GramsPerCubicMillimetre = Annotated[float, LengthPower(-3)]
Coordinates = Annotated[Array, LengthPower(1)]
UnitInertia = Annotated[Array, LengthPower(5)]


def _no_direction() -> Array:
    """Return zeros instead of a unit vector."""
    return np.zeros(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement:
    """The pose of a part's own frame in the assembly.

    A point p of the part is at ``rotation @ (p * mirror) + translation``, where ``mirror`` is (1, 1, -1) for a mirrored
    part and (1, 1, 1) otherwise. So ``rotation`` is always a proper rotation.
    """

    rotation: Array  # shape (3, 3); its columns are the axes of the part's frame
    translation: Coordinates  # shape (3,) [mm]
    mirrored: bool = False

    @property
    def matrix(self) -> Array:
        """The linear part including the mirror, shape (3, 3)."""
        return np.asarray(self.rotation * np.array([1.0, 1.0, -1.0 if self.mirrored else 1.0]))

    def to_assembly(self, points: Array) -> Array:
        """Return points in the assembly's frame, given in the part's frame, shape (..., 3)."""
        return np.asarray(np.asarray(points) @ self.matrix.T + self.translation)


@dataclass(frozen=True, kw_only=True)
class CadMaterial:
    """A material named in the file."""

    name: str
    density: GramsPerCubicMillimetre | None = None  # [g/mm3]; None where the file has none


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid:
    """A solid of a part, with uniform density."""

    name: str  # as the file names it; empty where it has no name of its own
    volume: CubicMillimetres  # [mm3]
    centre: Coordinates  # its centre of mass, shape (3,) [mm]
    inertia: UnitInertia  # about its centre for density 1, in axes of the assembly, shape (3, 3) [mm5]
    material: CadMaterial | None = None
    relative_error: float = 0.0  # relative error of the volume, as estimated by OCCT


@dataclass(frozen=True, eq=False, kw_only=True)
class CadPart:
    """One occurrence of a part in the assembly; a product that occurs twice gives two parts."""

    name: str  # unique in the assembly: the name of the product, followed by a number if several parts share it
    product: str  # the product's name in the file; empty if it has none
    path: tuple[str, ...]  # names of the instances from the root of the assembly to this part, as in the file
    branch: tuple[int, ...] = ()  # index of the instance in each assembly around it, from the root
    placement: Placement
    material: CadMaterial | None
    solids: tuple[Solid, ...]
    bounds: Coordinates  # the smallest and the largest coordinates, shape (2, 3) [mm]


@dataclass(frozen=True, eq=False, kw_only=True)
class SplineSurface:
    """A B-spline surface, not periodic in either direction. The product S_u x S_v points out of the material."""

    degrees: tuple[int, int]
    knots: tuple[Array, Array]  # knots in each direction, repeated by multiplicity, shapes (n + degree + 1,)
    points: Coordinates  # control points, shape (n, m, 3) [mm]
    weights: Array  # shape (n, m); all 1 unless the surface is rational

    def turned_over(self) -> "SplineSurface":
        """Return the same surface with its normal reversed: u and v exchanged."""
        points, weights = np.swapaxes(self.points, 0, 1), self.weights.T
        return replace(self, degrees=self.degrees[::-1], knots=self.knots[::-1], points=points, weights=weights)


@dataclass(frozen=True, eq=False, kw_only=True)
class CadFace:
    """A face; pieces of one plane, cylinder, cone, sphere or torus are merged, such as the halves of a bore."""

    number: int  # index in the assembly's faces; another export of the same part may number them differently
    part: str
    solid: int  # index of its solid in the part; -1 if it bounds none
    kind: FaceKind
    point: Coordinates  # on the axis at mid-height (cylinder, cone), the centre (sphere, torus), else as `on`
    # unit vector: the axis (cylinder, torus; a cone widens along it) or the outward normal of a plane; otherwise zeros
    axis: Array = field(default_factory=_no_direction)
    radius: Millimetres = 0.0  # [mm], of a cone at `point`, of a torus that of its centre line; 0: plane or surface
    minor_radius: Millimetres = 0.0  # radius of the tube of a torus [mm]; otherwise 0
    half_angle: float = 0.0  # half angle of a cone [rad]; otherwise 0
    hollow: bool = False  # whether the material lies outside the face, as around a bore
    span: float = 0.0  # angle about the axis that it covers [rad], 2 pi for a full turn; 0 for a plane or a surface
    # unit vector from the axis to the middle of the span; zeros for a full turn or a face without an axis
    middle: Array = field(default_factory=_no_direction)
    # start and end along the axis, measured from `point`, shape (2,) [mm]; zeros for a plane or a surface
    extent: Coordinates = field(default_factory=lambda: np.zeros(2))
    area: SquareMillimetres  # area [mm2]
    on: Coordinates  # a point of the face, shape (3,) [mm]
    normal: Array = field(default_factory=_no_direction)  # the outward normal at `on`
    # largest distance [mm] between a spline in the file and the surface recognised in it; 0 if it was not a spline
    recognition_gap: Millimetres = 0.0
    places: tuple[int, ...] = ()  # indices of the faces in the file that it is made of, among all of the part's product
    # its surface as splines, as in the file, which together cover exactly the face; empty if its edges do not run along
    # parameter lines, or if its surface is not a B-spline, for example the offset of one
    splines: tuple[SplineSurface, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class CadEdge:
    """An edge that is a circle or a circular arc."""

    part: str
    faces: tuple[int, ...]  # numbers of the faces that it bounds
    centre: Coordinates
    axis: Array = field(default_factory=_no_direction)
    radius: Millimetres
    span: float = 0.0  # angle of the arc [rad]; 2 pi for a circle
    middle: Array = field(default_factory=_no_direction)  # unit vector to the middle of the arc; zeros for a circle
    recognition_gap: Millimetres = 0.0  # as of a face
    places: tuple[int, ...] = ()  # as of a face, of edges


@dataclass(frozen=True, kw_only=True)
class SizeLimits:
    """A dimension with limits that the file attaches to faces (semantic PMI of AP242)."""

    kind: str  # for example ``diameter``, ``radius`` or ``linear distance``
    nominal: Millimetres
    lower: Millimetres  # the smallest permitted size [mm]
    upper: Millimetres  # the largest permitted size [mm]
    faces: tuple[int, ...] = ()  # numbers of the faces to which it applies; for a distance, those of both sides
    tolerance_class: str = ""  # of ISO 286, such as ``H7``, if the limits follow from one

    @property
    def words(self) -> str:
        """The dimension as a drawing and a campaign file state it: ``6 H7``, ``6.1 +0.02/-0.01``."""
        if self.tolerance_class:
            return f"{self.nominal:.9g} {self.tolerance_class}"
        deviations = (f"{each - self.nominal + 0.0:+.9f}".rstrip("0").rstrip(".") for each in (self.upper, self.lower))
        return f"{self.nominal:.9g} {'/'.join(deviations)}"


@dataclass(frozen=True, kw_only=True)
class GeometricTolerance:
    """A zone for a place, direction or form that the file attaches to faces (semantic PMI of AP242)."""

    kind: str  # for example ``position``, ``coaxiality``, ``perpendicularity`` or ``flatness``
    zone: Millimetres  # its width [mm]; its diameter if it is `round`
    round: bool = False  # whether it is a cylinder or a sphere
    maximum_material: bool = False  # whether (M) follows the width
    datums: tuple[str, ...] = ()  # their letters in order
    modifiers: tuple[str, ...] = ()  # all others that change what the zone means, in words
    faces: tuple[int, ...] = ()

    @property
    def words(self) -> str:
        """The tolerance as a frame on a drawing, in words: ``position, a cylinder of 0.1 mm (M), to A, B``."""
        shape = f"a cylinder of {self.zone:g} mm" if self.round else f"{self.zone:g} mm"
        shape += " (M)" if self.maximum_material else ""
        return ", ".join(
            [self.kind, shape, *self.modifiers, *([f"to {', '.join(self.datums)}"] if self.datums else [])]
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class TriangleMesh:
    """Triangles of a part for pictures and overlaps, oriented counter-clockwise as seen from outside."""

    part: str
    vertices: Coordinates  # shape (n, 3) [mm]; faces share no vertices
    triangles: Integers = field(default_factory=lambda: np.zeros((0, 3), np.int64))  # rows of `vertices`, shape (m, 3)
    faces: Integers = field(default_factory=lambda: np.zeros(0, np.int64))  # number of each triangle's face, shape (m,)
    # largest distance of a triangle from its face [mm], as requested from OCCT; on spheres it can be twice as large
    deflection: Millimetres = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class CadAssembly:
    """All data that clearcap takes from a STEP file."""

    sha256: str  # SHA-256 of the file's content, 64 hexadecimal digits
    unit: str  # the file's unit of length, for example ``mm`` or ``inch``
    schema: str  # the schema of the file, for example ``AP242``; if it is not a known one, as its header states it
    recognition: Millimetres  # largest permitted recognition gap [mm]
    parts: tuple[CadPart, ...] = ()
    faces: tuple[CadFace, ...] = ()
    edges: tuple[CadEdge, ...] = ()
    limits: tuple[SizeLimits, ...] = ()
    zones: tuple[GeometricTolerance, ...] = ()
    meshes: tuple[TriangleMesh, ...] = ()  # one for each part, in the order of `parts`
    cautions: tuple[str, ...] = ()  # what was left out of the file and where it contradicts itself, each with a remedy
    # number of entities of faces and placements that cannot be read or that refer to missing ones; if it is not 0, the
    # file is damaged
    unreadable: int = 0
    damaged: tuple[str, ...] = ()  # names of the parts that these entities describe

    @property
    def damage(self) -> str:
        """What is damaged in the file and what to do about it; empty if all of it can be read."""
        if not self.unreadable:
            return ""
        return (
            f"is damaged: {self.unreadable} of its entities cannot be read, or refer to others that are missing, so"
            f" that faces or placements of {some(self.damaged)} may be missing too; export or copy it again"
        )

    def part(self, name: str) -> CadPart:
        """Return the part with a given name; raise KeyError if there is none."""
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(name)

    def faces_of(self, part: str) -> tuple[CadFace, ...]:
        """Return the faces of a part."""
        return tuple(face for face in self.faces if face.part == part)


# -- placing a product ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class ProductGeometry:
    """The components of a product in its own frame; faces are numbered from 0."""

    solids: tuple[Solid, ...]
    faces: tuple[CadFace, ...]
    edges: tuple[CadEdge, ...]
    mesh: TriangleMesh


def placed_product(product: ProductGeometry, part: str, placement: Placement, first_face: int) -> ProductGeometry:
    """Return a product as a part placed in the assembly; `first_face` is the number of its first face there."""
    turn = placement.matrix
    return ProductGeometry(
        solids=tuple(
            replace(each, centre=placement.to_assembly(each.centre), inertia=turn @ each.inertia @ turn.T)
            for each in product.solids
        ),
        faces=tuple(replace(_face(f, placement), part=part, number=f.number + first_face) for f in product.faces),
        edges=tuple(_edge(edge, part, placement, first_face) for edge in product.edges),
        mesh=_mesh(product.mesh, part, placement, first_face),
    )


def _face(face: CadFace, placement: Placement) -> CadFace:
    turn = placement.matrix
    return replace(
        face,
        point=placement.to_assembly(face.point),
        axis=turn @ face.axis,
        middle=turn @ face.middle,
        on=placement.to_assembly(face.on),
        normal=turn @ face.normal,
        splines=tuple(_spline(spline, placement) for spline in face.splines),
    )


def _spline(spline: SplineSurface, placement: Placement) -> SplineSurface:
    placed = replace(spline, points=placement.to_assembly(spline.points))
    return placed.turned_over() if placement.mirrored else placed


def _edge(edge: CadEdge, part: str, placement: Placement, first_face: int) -> CadEdge:
    turn = placement.matrix
    return replace(
        edge,
        part=part,
        faces=tuple(number + first_face for number in edge.faces),
        centre=placement.to_assembly(edge.centre),
        axis=turn @ edge.axis,
        middle=turn @ edge.middle,
    )


def _mesh(mesh: TriangleMesh, part: str, placement: Placement, first_face: int) -> TriangleMesh:
    triangles = mesh.triangles[:, ::-1] if placement.mirrored else mesh.triangles  # outward is counter-clockwise
    return replace(
        mesh,
        part=part,
        vertices=placement.to_assembly(mesh.vertices),
        triangles=np.ascontiguousarray(triangles),
        faces=mesh.faces + first_face,
    )


# -- another unit of length -------------------------------------------------------------------------------------------


def in_unit(geometry: _T, millimetres: float) -> _T:
    """Return data in mm from a CAD file, or derived from it, in another unit of length [mm], > 0; masses stay in g."""
    scaled: _T = _scaled(geometry, 0, 1.0 / millimetres)
    return scaled


def _scaled(value: Any, power: int, factor: float) -> Any:
    """Return a value times a power of the factor; in a dataclass, each field with its own power."""
    if is_dataclass(value) and not isinstance(value, type):
        each = _powers(type(value)).items()
        return replace(value, **{name: _scaled(getattr(value, name), own, factor) for name, own in each})
    if isinstance(value, tuple):
        return tuple(_scaled(entry, power, factor) for entry in value)
    if power and isinstance(value, float | np.ndarray):
        return value * factor**power
    return value


@cache
def _powers(kind: type) -> dict[str, int]:
    """Return the power of the unit of length for each field of a dataclass, by name."""
    return {name: _power(hint) for name, hint in get_type_hints(kind, include_extras=True).items()}


def _power(hint: Any) -> int:
    """Return the power annotated on a type or on one of its components; 0 if there is none."""
    if isinstance(hint, LengthPower):
        return hint.power
    return next((power for inner in get_args(hint) if (power := _power(inner))), 0)


# -- several parts as one rigid part ----------------------------------------------------------------------------------


def with_joined_parts(
    assembly: CadAssembly, groups: Mapping[str, Sequence[str]], *, beside: bool = False
) -> CadAssembly:
    """Return an assembly in which each group of parts is one part, at the place of the first part of the group.

    Faces keep their numbers. The frame of such a part is that of the first part in its group. With `beside`, the parts
    stay, and those that are made of them follow at the end.
    """
    wholes = [_joined(assembly, name, parts) for name, parts in groups.items()]
    if beside:
        each = (assembly, *wholes)
        return replace(
            assembly,
            parts=tuple(part for one in each for part in one.parts),
            faces=tuple(face for one in each for face in one.faces),
            edges=tuple(edge for one in each for edge in one.edges),
            meshes=tuple(mesh for one in each for mesh in one.meshes),
        )
    member = {part: name for name, parts in groups.items() for part in parts}
    joined = {parts[0]: whole for parts, whole in zip(groups.values(), wholes, strict=True)}
    rows = [
        (joined[part.name].parts[0], joined[part.name].meshes[0]) if part.name in joined else (part, mesh)
        for part, mesh in zip(assembly.parts, assembly.meshes, strict=True)
        if part.name in joined or part.name not in member
    ]
    moved = {face.number: face for whole in wholes for face in whole.faces}
    return replace(
        assembly,
        parts=tuple(part for part, _ in rows),
        faces=tuple(moved.get(face.number, face) for face in assembly.faces),
        edges=tuple(replace(edge, part=member.get(edge.part, edge.part)) for edge in assembly.edges),
        meshes=tuple(mesh for _, mesh in rows),
    )


def _joined(assembly: CadAssembly, name: str, parts: Sequence[str]) -> CadAssembly:
    """Return an assembly of only the part that a group becomes."""
    members, by_part = [assembly.part(part) for part in parts], {mesh.part: mesh for mesh in assembly.meshes}
    bounds, meshes = np.array([member.bounds for member in members]), [by_part[part] for part in parts]
    common = [names[0] for names in zip(*(member.path for member in members), strict=False) if len(set(names)) == 1]
    solids: list[Solid] = []
    faces: list[CadFace] = []
    for member in members:
        for face in assembly.faces_of(member.name):
            faces.append(replace(face, part=name, solid=face.solid + len(solids) if face.solid >= 0 else -1))
        solids += named_solids(member)
    part = CadPart(
        name=name,
        product=name,
        path=tuple(common),
        placement=members[0].placement,
        material=None,
        solids=tuple(solids),
        bounds=np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)]),
    )
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    mesh = TriangleMesh(
        part=name,
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=False)]),
        faces=np.concatenate([mesh.faces for mesh in meshes]),
        deflection=max(mesh.deflection for mesh in meshes),
    )
    edges = tuple(replace(edge, part=name) for each in parts for edge in assembly.edges if edge.part == each)
    return replace(assembly, parts=(part,), faces=tuple(faces), edges=edges, meshes=(mesh,))


def named_solids(part: CadPart) -> list[Solid]:
    """Return the solids of a part with its material and name, as those of a larger part."""
    several = len(part.solids) > 1
    return [
        replace(
            solid,
            name=f"{part.name}, {solid.name or f'solid {number}'}" if several else part.name,
            material=solid.material or part.material,
        )
        for number, solid in enumerate(part.solids)
    ]
