"""Convert a STEP file to an assembly of plain numbers."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from OCP.XCAFDoc import XCAFDoc_ShapeTool as ShapeTool

from engine.cad.cad_model import (
    CadAssembly,
    CadFace,
    CadMaterial,
    CadPart,
    GeometricTolerance,
    ProductGeometry,
    SizeLimits,
    placed_product,
)
from engine.cad.occt.bounded_work import Budget
from engine.cad.occt.damage import Damage
from engine.cad.occt.geometric_tolerances import geometric_tolerances
from engine.cad.occt.names_and_materials import listed, material_of, name_of
from engine.cad.occt.occt_values import FACE, OCCT_ERRORS, ShapeMap
from engine.cad.occt.product_geometry import product_geometry
from engine.cad.occt.product_tree import Instance, instances, labels_of_solids
from engine.cad.occt.size_limits import size_limits
from engine.cad.occt.step_document import StepDocument, open_step
from engine.drawing_limits import dimension_limits
from engine.errors import some

_UNNAMED = "part"

_SLOW_SECONDS = 20.0  # of the processor, that faces and solids may take in vain
_RADII = {"diameter": 2, "spherical diameter": 2, "radius": 1, "spherical radius": 1}
_BROKEN: tuple[type[Exception], ...] = (
    *OCCT_ERRORS,
    ArithmeticError,
    AttributeError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""What is raised where an entity of a file is not as the standard says."""
_NO_TOLERANCES = (
    "all dimensions and tolerances are left out: OCCT fails when it reads them; give them in the campaign file"
)
_FAR_OFF = 0.1  # share of the drawn size


class _Product:
    """A product of the file: its shape in its own frame, and its components."""

    def __init__(self, instance: Instance, document: StepDocument, recognition: float, budget: Budget) -> None:
        self.name = instance.name
        self.shape = instance.shape
        grams = document.grams or np.nan
        self.material = material_of(instance.label, grams) or _of_first_solid(instance, grams)
        solids: list[tuple[str, CadMaterial | None]] = [
            (name_of(label), material_of(label, grams)) if label is not None else ("", None)
            for label in labels_of_solids(instance)
        ]
        self.geometry, self._numbers, self.losses = product_geometry(self.shape, solids, recognition, budget)
        self.first_faces: list[int] = []  # one per instance
        self._faces = ShapeMap(self.shape, FACE)

    def faces_of(self, shape: Any) -> tuple[int, ...]:
        """Return the numbers within the product of the faces of a sub-shape."""
        places = [self._faces.place(face) for face in ShapeMap(shape, FACE).shapes()]
        return tuple(sorted({int(self._numbers[place]) for place in places if place >= 0} - {-1}))


def read_assembly(path: Path, sha256: str, recognition: float, *, tolerances: bool = True) -> CadAssembly:
    """Read a STEP file with OCCT; raise UnreadableStep if it is not one or contains no shapes.

    A spline is replaced by a simple surface or circle that is no more than `recognition` [mm] away; 0 replaces none.
    Without `tolerances`, dimensions and tolerances are left out, and said to be.
    """
    document = open_step(path, tolerances=tolerances)
    found = instances(document.shapes)
    products: dict[tuple[str, int], _Product] = {}
    budget = Budget(_SLOW_SECONDS)
    for instance in found:
        if instance.entry not in products:
            products[instance.entry] = _Product(instance, document, recognition, budget)
    names = _unique_names([products[instance.entry].name for instance in found])
    parts, placed = [], []
    first_face = 0
    for instance, name in zip(found, names, strict=True):
        product = products[instance.entry]
        here = placed_product(product.geometry, name, instance.placement, first_face)
        product.first_faces.append(first_face)
        first_face += len(here.faces)
        placed.append(here)
        parts.append(_part(instance, name, product, here))
    faces = tuple(face for here in placed for face in here.faces)
    limits, zones, not_read = _tolerances(document, list(products.values()), faces)
    return CadAssembly(
        sha256=sha256,
        unit=document.unit,
        schema=document.schema,
        recognition=recognition,
        parts=tuple(parts),
        faces=faces,
        edges=tuple(edge for here in placed for edge in here.edges),
        limits=limits,
        zones=zones,
        meshes=tuple(here.mesh for here in placed),
        cautions=(
            *_left_out(document, parts),
            *chain.from_iterable(_lost(product) for product in products.values()),
            *not_read,
            *([] if tolerances else [_NO_TOLERANCES]),
        ),
        unreadable=document.damage.entities,
        damaged=_damaged(document.damage, parts),
    )


def _of_first_solid(instance: Instance, grams: float) -> CadMaterial | None:
    """Return the material of a product of several solids, which OCCT gives to the first of them only."""
    found = {material_of(label, grams) for label in listed(ShapeTool.GetSubShapes_s, instance.label)} - {None}
    return found.pop() if len(found) == 1 else None


def _part(instance: Instance, name: str, product: _Product, here: ProductGeometry) -> CadPart:
    """Return a part from its components."""
    points = here.mesh.vertices if len(here.mesh.vertices) else np.zeros((1, 3))
    return CadPart(
        name=name,
        product=product.name,
        path=instance.path,
        branch=instance.branch,
        placement=instance.placement,
        material=product.material,
        solids=here.solids,
        bounds=np.array([points.min(axis=0), points.max(axis=0)]),
    )


def _tolerances(
    document: StepDocument, products: list[_Product], faces: tuple[CadFace, ...]
) -> tuple[tuple[SizeLimits, ...], tuple[GeometricTolerance, ...], list[str]]:
    """Return the limits and zones of a file, and cautions about them; no file is lost because of one that is broken."""
    faces_of, too_large = partial(_faces_on, products), document.dimensions_too_large
    limits: list[SizeLimits] = []
    zones: list[GeometricTolerance] = []
    cautions: list[str] = []
    broken = "{} are left out: OCCT failed to read what the file says of them ({}); give them in the campaign file"
    try:
        limits, cautions = size_limits(document.dimensions, document.signs, document.classes, faces_of)
    except _BROKEN as error:
        cautions.append(broken.format("dimensions with limits", type(error).__name__))
    try:
        zones = geometric_tolerances(document.dimensions, faces_of, too_large)
    except _BROKEN as error:
        cautions.append(broken.format("geometric tolerances", type(error).__name__))
    limits = [_corrected(limit, faces, too_large) for limit in limits]
    contradictions = {limit: _contradictions(limit, faces) for limit in limits}
    kept = tuple(limit for limit, said in contradictions.items() if not said)
    return kept, tuple(zones), [*cautions, *chain.from_iterable(contradictions.values())]


def _faces_on(products: list[_Product], label: Any) -> list[tuple[int, ...]]:
    """Return the numbers of the faces on the label of a sub-shape, for each instance of its product."""
    shape = ShapeTool.GetShape_s(label)
    for product in products:
        if faces := product.faces_of(shape):
            return [tuple(number + first for number in faces) for first in product.first_faces]
    return []


def _corrected(limit: SizeLimits, faces: tuple[CadFace, ...], too_large: float) -> SizeLimits:
    """Return a dimension in mm that may be too large by a factor; it is if only the reduced one matches its faces."""
    sizes = (limit.nominal / too_large, limit.lower / too_large, limit.upper / too_large)
    nominal, lower, upper = (round(size, 12) for size in sizes)
    if limit.tolerance_class:
        lower, upper = dimension_limits(f"{nominal:.9f} {limit.tolerance_class}")
    smaller = replace(limit, nominal=nominal, lower=lower, upper=upper)
    return smaller if _contradictions(limit, faces) and not _contradictions(smaller, faces) else limit


def _contradictions(limit: SizeLimits, faces: tuple[CadFace, ...]) -> list[str]:
    """Return a caution about a dimension that differs from the faces it is attached to."""
    sizes = [(faces[number].part, _RADII.get(limit.kind, 0) * faces[number].radius) for number in limit.faces]
    return [
        f"a {limit.kind} of {limit.nominal:g} mm: the face that it stands on, of {part}, is drawn with {size:g} mm;"
        " check the unit of the file's dimensions, and give these limits in the campaign file"
        for part, size in sizes
        if size and abs(limit.nominal - size) > _FAR_OFF * size
    ]


def _damaged(damage: Damage, parts: list[CadPart]) -> tuple[str, ...]:
    """Return the names of the parts of which something is lost; all, if it is not known of which."""
    lost = damage.products or frozenset()
    found = [part.name for part in parts if lost & {part.product, *part.path}]
    return tuple(found if found or not damage.entities else [part.name for part in parts])


def _left_out(document: StepDocument, parts: list[CadPart]) -> list[str]:
    """Return cautions about what was left out."""
    said = []
    if document.damage.entities:
        said.append(
            f"what {document.damage.entities} of the file's entities describe, in full or in part, of"
            f" {some(_damaged(document.damage, parts))}: they cannot be read, or refer to others that are missing;"
            " export or copy it again"
        )
    if document.damage.limits:
        said.append(
            f"what {document.damage.limits} of the file's entities say of dimensions and tolerances: they cannot be"
            " read, or refer to others that are missing; give these limits in the campaign file"
        )
    if document.damage.odd:
        said.append(
            f"what {document.damage.odd} of the file's entities say beside faces, places and limits: names, styles,"
            " texts, units or tolerances that are not written as the standard says"
        )
    if document.grams is None:
        said.append("densities are left out: their units of mass are not known, or differ; give each body its density")
    if empty := ", ".join(part.name for part in parts if not part.solids):
        said.append(f"without a solid, so without volume: {empty}; export these parts as solids")
    if negative := ", ".join(part.name for part in parts if any(solid.volume <= 0 for solid in part.solids)):
        said.append(f"with a solid whose faces point inwards: {negative}; repair these parts in the CAD system")
    return said


def _lost(product: _Product) -> Iterator[str]:
    """Yield cautions about faces of a product that OCCT cannot convert or mesh, and solids that it cannot integrate."""
    for error in product.losses.solids:
        size = f" to {100 * error:.2g} %" if np.isfinite(error) else ""
        yield (
            f"the exact volume of a solid of {product.name or _UNNAMED}: OCCT needs too long to integrate over it, and"
            f" the time depends on the computer; mass and inertia are near{size}, write them into its body"
        )
    for points, what, why in (
        (product.losses.splines, "the splines of", "OCCT cannot convert them, so that nothing can touch them there"),
        (product.losses.coarse, "fine pictures of", "OCCT needs too long to mesh them; what faces them may be missed"),
        (product.losses.missing, "all of", "OCCT cannot mesh them; what they touch is not found"),
    ):
        if points:
            where = some([f"({', '.join(f'{x:.4g}' for x in point + 0.0)})" for point in points])
            count = f"{len(points)} {'face' if len(points) == 1 else 'faces'}"
            yield f"{what} {count} of {product.name or _UNNAMED}, around {where}: {why}"


def _unique_names(products: list[str]) -> list[str]:
    """Return a unique name for each part: that of its product, or ``part``, with a number if several parts share it."""
    called = [product or _UNNAMED for product in products]
    several = {name for name, count in Counter(called).items() if count > 1}
    taken = set(called) - several
    found, counts = [], Counter[str]()
    for name in called:
        unique = name
        while name in several and (unique == name or unique in taken):
            counts[name] += 1
            unique = f"{name}-{counts[name]}"
        taken.add(unique)
        found.append(unique)
    return found
