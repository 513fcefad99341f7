"""Convert a product's shape to numbers, once for all its instances: faces, triangles, circular edges and solids."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepGProp import BRepGProp
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_Shape
from OCP.gp import gp_Circ
from OCP.GProp import GProp_GProps
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideArea, ShapeUpgrade_ShapeDivideContinuity
from OCP.TopoDS import TopoDS

from engine.arrays import Array, Integers
from engine.cad.cad_model import CadEdge, CadMaterial, ProductGeometry, Solid, TriangleMesh
from engine.cad.merged_pieces import ArcPiece, FacePiece, merge_arcs, merge_pieces
from engine.cad.occt.bounded_work import Budget, Work, done_in_time
from engine.cad.occt.face_pieces import COARSEST, face_piece, usual_sag
from engine.cad.occt.occt_values import EDGE, FACE, SOLID, ShapeMap, array3, matrix3, one_way

_POINTS = 17  # along an arc: less than half a turn between neighbours, even for a full circle
_FACE_SECONDS, _SOLID_SECONDS = 1.5, 8.0  # for an attempt to read a face, or to integrate over a solid
_SPLINES = GeomAbs_CurveType.GeomAbs_BSplineCurve, GeomAbs_CurveType.GeomAbs_BezierCurve


@dataclass(frozen=True)
class FaceLosses:
    """Points in the middle of faces of which something is lost [mm], in the frame of the product."""

    splines: list[Array]  # OCCT cannot convert their surfaces
    coarse: list[Array]  # their triangles are coarser than those of other faces
    missing: list[Array]  # have no triangles, and are left out
    solids: list[float]  # relative errors of volumes that OCCT could not integrate in time; NaN if not known


def product_geometry(
    shape: Any, solids: list[tuple[str, CadMaterial | None]], recognition: float, budget: Budget
) -> tuple[ProductGeometry, Integers, FaceLosses]:
    """Return the components of a product, the number of each face of its shape, -1 for one left out, and what is lost.

    `solids` has the name and material of each solid. A spline is replaced by a simple surface or circle that is no more
    than `recognition` [mm] away.
    """
    bodies = ShapeMap(shape, SOLID).shapes()
    faces = ShapeMap(shape, FACE)
    owners = np.full(len(faces), -1)
    for place, body in enumerate(bodies):
        for face in ShapeMap(body, FACE).shapes():
            owners[faces.place(face)] = place
    shapes, sag = faces.shapes(), usual_sag(shape)
    work = [
        *(_face_work(face, int(owners[place]), recognition, sag) for place, face in enumerate(shapes)),
        *(_solid_work(body, *each) for body, each in zip(bodies, solids, strict=True)),
    ]
    done = done_in_time(work, budget)
    tried = [None if each is None else each[1][0] for each in done[: len(shapes)]]
    pieces = [piece for piece in tried if piece is not None]
    merged, number_of_piece = merge_pieces(pieces)
    numbers = np.full(len(tried), -1)
    numbers[[piece is not None for piece in tried]] = number_of_piece
    places: dict[int, list[int]] = defaultdict(list)
    for place, number in enumerate(numbers.tolist()):
        places[number].append(place)
    integrated = done[len(shapes) :]
    found_solids = tuple(
        solid_of_triangles([piece for piece in pieces if piece.face.solid == place], *solids[place])
        if each is None
        else each[1]
        for place, each in enumerate(integrated)
    )
    geometry = ProductGeometry(
        solids=found_solids,
        faces=tuple(replace(face, places=tuple(places[face.number])) for face in merged),
        edges=tuple(merge_arcs(_arc_pieces(shape, shapes, numbers.tolist(), recognition))),
        mesh=_mesh(pieces, number_of_piece, sag),
    )
    ends = list(zip(shapes, done, strict=False))
    losses = FaceLosses(
        splines=[_middle(face) for face, each in ends if each is not None and each[1][1]],
        coarse=[_middle(face) for face, each in ends if each is not None and each[0]],
        missing=[_middle(face) for face, each in ends if each is None],
        solids=[s.relative_error for s, each in zip(found_solids, integrated, strict=True) if not each or each[0]],
    )
    return geometry, numbers, losses


def _face_work(face: Any, solid: int, recognition: float, sag: float) -> Work:
    """Return the work of reading a face, with coarser triangles if it takes too long."""
    levels = range(COARSEST + 1)
    return Work([partial(face_piece, face, solid, recognition, sag, level) for level in levels], _FACE_SECONDS)


def _solid_work(solid: Any, name: str, material: CadMaterial | None) -> Work:
    """Return the work of integrating over a solid, with less accuracy if it takes too long."""
    ways = (True, False)
    return Work([partial(solid_properties, solid, name, material, exact=exact) for exact in ways], _SOLID_SECONDS)


def _middle(face: Any) -> Array:
    """Return the middle of the box around a face."""
    box = Bnd_Box()
    BRepBndLib.Add_s(face, box, False)
    return np.zeros(3) if box.IsVoid() else (array3(box.CornerMin()) + array3(box.CornerMax())) / 2


def _mesh(pieces: list[FacePiece], numbers: Integers, deflection: float) -> TriangleMesh:
    """Return the triangles of all pieces, each with the number of its face."""
    firsts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])[:-1]
    return TriangleMesh(
        part="",
        vertices=np.concatenate([np.zeros((0, 3)), *(piece.vertices for piece in pieces)]),
        triangles=np.concatenate(
            [np.zeros((0, 3), np.int64), *(p.triangles + first for p, first in zip(pieces, firsts, strict=True))]
        ),
        faces=np.repeat(numbers, [len(piece.triangles) for piece in pieces]),
        deflection=deflection,
    )


def _arc_pieces(shape: Any, faces: Sequence[Any], numbers: Sequence[int], recognition: float) -> list[ArcPiece]:
    """Return the circular edges of a product's shape; `numbers` has -1 for each of its faces that was left out."""
    edges = ShapeMap(shape, EDGE)
    bounded: dict[int, set[int]] = defaultdict(set)
    for face, number in zip(faces, numbers, strict=True):
        for edge in ShapeMap(face, EDGE).shapes():
            bounded[edges.place(edge)] |= {number} - {-1}
    found = []
    for place, edge in enumerate(map(TopoDS.Edge, edges.shapes())):
        if not BRep_Tool.Degenerated_s(edge) and (arc := _arc(edge, recognition)):
            faces = tuple(sorted(bounded[place]))
            found.append(replace(arc, edge=replace(arc.edge, faces=faces, places=(place,))))
    return found


def _arc(edge: Any, recognition: float) -> ArcPiece | None:
    """Return the circle of an edge and points along the edge; None for any other curve."""
    curve, gap = BRepAdaptor_Curve(edge), 0.0
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle:
        circle = curve.Circle()
    elif curve.GetType() in _SPLINES and recognition > 0:
        circle, tried = gp_Circ(), ShapeAnalysis_CanonicalRecognition(edge)
        if not tried.IsCircle(recognition, circle) or tried.GetGap() > recognition:
            return None
        gap = tried.GetGap()
    else:
        return None
    parameters = np.linspace(curve.FirstParameter(), curve.LastParameter(), _POINTS)
    points = np.array([array3(curve.Value(float(parameter))) for parameter in parameters])
    centre, axis = array3(circle.Location()), one_way(array3(circle.Axis().Direction()))
    arc = CadEdge(part="", faces=(), centre=centre, axis=axis, radius=circle.Radius(), recognition_gap=gap)
    return ArcPiece(arc, points)


# -- volume, centre and inertia of solids ------------------------------------------------------------------------------

_RELATIVE_ERROR = 1e-10  # of the volume below each face
_AGREEMENT = 1e-10  # of the volumes from two integrations
_LEAST_AGREEMENT = 1e-5  # of the volumes of a solid cut into pieces: edges of a STEP file are not quite on their faces
_PIECES = 3  # per patch and parameter: Gauss points are then sufficient for rational patches, up to rounding
_NO_JUMP = 1e-30  # of derivatives at a knot, so that the surface is cut at every knot


def solid_properties(shape: Any, name: str, material: CadMaterial | None, *, exact: bool = True) -> Solid:
    """Return a solid in the frame of its product, with density 1; `exact` may take minutes with faces of splines."""
    found, relative_error = _integrals(TopoDS.Solid(shape), exact=exact)
    return Solid(
        name=name,
        volume=found.Mass(),
        centre=array3(found.CentreOfMass()),
        inertia=matrix3(found.MatrixOfInertia()),
        material=material,
        relative_error=relative_error,
    )


def solid_of_triangles(pieces: Sequence[FacePiece], name: str, material: CadMaterial | None) -> Solid:
    """Return what the triangles of its faces enclose in place of a solid; its relative error is not known."""
    corners = np.concatenate([np.zeros((0, 3, 3)), *(piece.vertices[piece.triangles] for piece in pieces)])
    volumes = np.linalg.det(corners) / 6  # of tetrahedra with the origin
    volume = float(volumes.sum())
    centre = volumes @ corners.sum(axis=1) / (4 * volume or 1.0)
    corners = corners - centre
    volumes, sums = np.linalg.det(corners) / 6, corners.sum(axis=1)
    moments = (np.einsum("n,nki,nkj", volumes, corners, corners) + np.einsum("n,ni,nj", volumes, sums, sums)) / 20
    return Solid(
        name=name,
        volume=volume,
        centre=centre,
        inertia=np.trace(moments) * np.eye(3) - moments,
        material=material,
        relative_error=np.nan,
    )


def _integrals(solid: Any, *, exact: bool) -> tuple[Any, float]:
    """Return volume, centre and inertia of a solid, and the relative error of its volume.

    Gauss integration takes a millisecond, and is exact up to rounding on planes and quadrics. It ignores the knots
    inside a B-spline face: the volume of an elliptic cam was off by 0.9 %, with a stated error of 4e-16. Kronrod
    integration takes them into account. Its volume is as fast, so it checks the other. Its inertia takes a minute for a
    sphere of splines, so if the volumes differ, the faces are cut at their knots and into pieces, which Gauss
    integrates in 0.03 s. If that does not help either, and if it is not to be `exact`, those that differ less
    remain, with the difference as their error.
    """
    _, volume = _by_kronrod(solid, inertia=False)
    tried = []
    for cut, agreement in ((False, _AGREEMENT), (True, _LEAST_AGREEMENT)):
        found = GProp_GProps()
        shape = _in_pieces(solid) if cut else solid
        relative_error = BRepGProp.VolumeProperties_s(shape, found, _RELATIVE_ERROR, False, False)
        difference = abs(found.Mass() - volume.Mass()) / abs(volume.Mass()) if volume.Mass() else 0.0
        tried.append((difference, max(relative_error, difference), found))
        if difference <= agreement:
            break
    else:
        if exact:
            relative_error, found = _by_kronrod(solid, inertia=True)
            return found, relative_error
    _, relative_error, found = min(tried, key=lambda each: each[0])
    return found, relative_error


def _in_pieces(solid: Any) -> Any:
    """Return a solid with its faces cut at their knots and into pieces of a patch; uncuttable faces are kept."""
    at_knots = ShapeUpgrade_ShapeDivideContinuity(solid)
    at_knots.SetBoundaryCriterion(GeomAbs_Shape.GeomAbs_CN)
    at_knots.SetPCurveCriterion(GeomAbs_Shape.GeomAbs_CN)
    at_knots.SetSurfaceCriterion(GeomAbs_Shape.GeomAbs_CN)
    at_knots.SetTolerance(_NO_JUMP)
    at_knots.SetTolerance2d(_NO_JUMP)
    at_knots.Perform(True)
    pieces = ShapeUpgrade_ShapeDivideArea(at_knots.Result())
    pieces.SetSplittingByNumber(True)
    pieces.SetNumbersUVSplits(_PIECES, _PIECES)
    pieces.Perform(True)
    return pieces.Result()


def _by_kronrod(solid: Any, inertia: bool) -> tuple[float, Any]:
    """Return the relative error of the volume, and the integrals: only the volume, or also centre and inertia."""
    found = GProp_GProps()
    return BRepGProp.VolumePropertiesGK_s(solid, found, _RELATIVE_ERROR, False, True, inertia, inertia, False), found
