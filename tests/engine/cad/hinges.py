"""Hinges drawn with OCP: a plate with a hole and a plate with a pin, in the ways that CAD systems export them."""

from math import pi

from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert, BRepBuilderAPI_Transform
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Trsf

from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, moved

THICKNESS, PLAY = 5.0, 0.1
PIN, BORE = 3.0, 3.05


def plate(bore=BORE, centre=(0.0, 0.0)):
    """Return a plate with a hole along z."""
    return cut(box((-15.0, -10.0, 0.0), (30.0, 20.0, THICKNESS)), cylinder((*centre, -1.0), bore, THICKNESS + 2))


def stud(radius=PIN, height=8.0):
    """Return a plate with a pin along z that stands on its face at z = 0."""
    return fused(box((-15.0, -10.0, -4.0), (30.0, 20.0, 4.0)), cylinder((0.0, 0.0, 0.0), radius, height))


def hinge(bearing=None, journal=None, names=("plate", "stud"), **move):
    """Return a drawing of two parts; the bearing lies above the journal's face, or is moved elsewhere."""
    made = Drawing()
    top = made.assembly("hinge")
    for name, shape in zip(names, (moved(bearing or plate(), **{"z": PLAY} | move), journal or stud()), strict=True):
        made.add(top, made.product(name, shape), name=name)
    return made


def cut_in_two(shape):
    """Return a shape whose cylinders are cut along the plane y = 0."""
    turn = gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(), gp_Dir(0, 0, 1)), pi)
    half = box((-100.0, 0.0, -100.0), (200.0, 100.0, 200.0))
    other = BRepBuilderAPI_Transform(half, turn, True).Shape()
    return fused(*(BRepAlgoAPI_Common(shape, each).Shape() for each in (half, other)))


def as_splines(shape):
    """Return a shape with all its faces and edges as splines."""
    return BRepBuilderAPI_NurbsConvert(shape, True).Shape()
