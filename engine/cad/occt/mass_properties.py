"""Volume, centre and inertia of solids, area of faces."""

from typing import Any

from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.TopoDS import TopoDS

from engine.cad.cad_model import CadMaterial, Solid
from engine.cad.occt.occt_arrays import array3, matrix3

_RELATIVE_ERROR = 1e-10  # of the volume below each face


def solid_properties(shape: Any, name: str, material: CadMaterial | None) -> Solid:
    """Return a solid in the frame of its product, for density 1."""
    found = GProp_GProps()
    relative_error = BRepGProp.VolumeProperties_s(TopoDS.Solid(shape), found, _RELATIVE_ERROR, False, False)
    return Solid(
        name=name,
        volume=found.Mass(),
        centre=array3(found.CentreOfMass()),
        inertia=matrix3(found.MatrixOfInertia()),
        material=material,
        relative_error=relative_error,
    )


def area(face: Any) -> float:
    """Return the area of a face [mm2]."""
    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, found, _RELATIVE_ERROR, False)
    return float(found.Mass())
