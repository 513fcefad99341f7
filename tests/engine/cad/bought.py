"""Bought parts drawn with OCP, and what they hold together: hexagon bolts and nuts, a bearing, a coil spring."""

from math import cos, hypot, pi, radians, sin

from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeWire as MakeWire
from OCP.BRepLib import BRepLib
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipeShell
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.Geom import Geom_CylindricalSurface
from OCP.Geom2d import Geom2d_Line, Geom2d_TrimmedCurve
from OCP.gp import gp_Ax2, gp_Ax3, gp_Circ, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d, gp_Vec

from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, moved, place

M4 = {"flats": 7.0, "head": 2.8, "nut": 3.2, "radius": 2.0}
BEARING_608 = {"bore": 4.0, "rim": 11.0, "width": 7.0}
COIL = {"radius": 5.0, "wire": 1.0, "pitch": 3.0, "turns": 4}


def hexagon(flats, height):
    """Return a hexagonal prism on z = 0, with its axis along z."""
    polygon = BRepBuilderAPI_MakePolygon()
    for corner in range(6):
        angle = radians(60 * corner)
        polygon.Add(gp_Pnt(flats / 3**0.5 * cos(angle), flats / 3**0.5 * sin(angle), 0.0))
    polygon.Close()
    return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(polygon.Wire()).Face(), gp_Vec(0, 0, height)).Shape()


def bolt(length):
    """Return an M4 bolt whose head stands on z = 0, and whose shank points down."""
    return fused(hexagon(M4["flats"], M4["head"]), cylinder((0, 0, -length), M4["radius"], length))


def nut():
    """Return an M4 nut from z = 0 down."""
    height = M4["nut"]
    whole = cut(hexagon(M4["flats"], height), cylinder((0, 0, -1), M4["radius"], height + 2))
    return moved(whole, z=-height)


def bearing():
    """Return a bearing 608 as one ring, as many catalogues draw it."""
    size = BEARING_608
    return cut(cylinder((0, 0, 0), size["rim"], size["width"]), cylinder((0, 0, -1), size["bore"], size["width"] + 2))


def coil():
    """Return a coil spring about z that begins at z = 0."""
    radius, pitch = COIL["radius"], COIL["pitch"]
    surface = Geom_CylindricalSurface(gp_Ax3(gp_Pnt(), gp_Dir(0, 0, 1)), radius)
    line = Geom2d_Line(gp_Pnt2d(0.0, 0.0), gp_Dir2d(2 * pi, pitch))  # in angle and height
    curve = Geom2d_TrimmedCurve(line, 0.0, COIL["turns"] * hypot(2 * pi, pitch))
    edge = BRepBuilderAPI_MakeEdge(curve, surface).Edge()
    BRepLib.BuildCurves3d_s(edge)
    along = gp_Dir(0.0, 2 * pi * radius / hypot(2 * pi * radius, pitch), pitch / hypot(2 * pi * radius, pitch))
    circle = gp_Circ(gp_Ax2(gp_Pnt(radius, 0, 0), along), COIL["wire"] / 2)
    pipe = BRepOffsetAPI_MakePipeShell(MakeWire(edge).Wire())
    pipe.SetMode(True)
    pipe.Add(MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire())
    pipe.Build()
    pipe.MakeSolid()
    return pipe.Shape()


def gearbox(bolts=2, names=("BOLT", "NUT"), spring=True):
    """Return a base with a block on it, screwed together, a bearing in the block with a shaft, and a spring on a plate.

    The heads of the bolts are on the block, z = 20, the nuts below the base, z = -5.
    """
    made = Drawing()
    top = made.assembly("gearbox")
    at = [(-20.0, 0.0), (20.0, 0.0)][:bolts]
    holes = [cylinder((x, y, -6), 2.15, 30) for x, y in at]
    seat = BEARING_608["rim"]
    block = box((-30.0, -15.0, 0.0), (60.0, 30.0, 20.0))
    block = cut(block, cylinder((0, 0, 5), seat, 30), cylinder((0, 0, -1), 6, 30), *holes)
    made.add(top, made.product("base", cut(box((-40.0, -20.0, -5.0), (80.0, 40.0, 5.0)), *holes)), name="base")
    made.add(top, made.product("block", block), name="block")
    screw, other = made.product(names[0], bolt(29.0)), made.product(names[1], nut())
    for x, y in at:
        made.add(top, screw, place(x, y, 20.0))
        made.add(top, other, place(x, y, -5.0))
    made.add(top, made.product("608", bearing()), place(z=5.0))
    shaft = fused(cylinder((0, 0, 2), 3.95, 30), cylinder((0, 0, 32), 12, 4))
    made.add(top, made.product("shaft", shaft), name="shaft")
    if spring:
        rise = COIL["pitch"] * COIL["turns"] + COIL["wire"]
        made.add(top, made.product("coil", coil()), place(x=60.0, z=COIL["wire"] / 2))
        made.add(top, made.product("lid", box((45.0, -8.0, rise), (30.0, 16.0, 2.0))), name="lid")
        made.add(top, made.product("shelf", box((45.0, -8.0, -2.0), (30.0, 16.0, 2.0))), name="shelf")
    return made
