"""A crane drawn with OCP: a foot with a glued cover, and an arm of two parts that turns on a pin of the foot.

Beside it, what has parts of other kinds: a lever with a torsion spring, a circuit board, two pedals on one rod.
"""

from OCP.BRep import BRep_Builder
from OCP.BRepPrimAPI import BRepPrimAPI_MakeTorus
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.TopoDS import TopoDS_Compound

from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, moved, place

STEEL, ALUMINIUM = ("steel", 7.85), ("aluminium", 2.7)
FOOT, COVER, WEIGHT = (60.0, 20.0, 4.0), (20.0, 20.0, 3.0), (10.0, 10.0, 6.0)
PIN, BORE, PLAY = 3.0, 3.05, 0.05
ARM = (40.0, 12.0, 5.0)


def foot():
    """Return a plate with a pin along z, and a cap on the pin."""
    plate = box((-10.0, -10.0, -FOOT[2]), FOOT)
    length = ARM[2] + 2 * PLAY
    return fused(plate, cylinder((0, 0, 0), PIN, length), cylinder((0, 0, length), PIN + 2, 1.5))


def arm():
    """Return a bar along x with a hole at its start."""
    return cut(box((-6.0, -6.0, 0.0), ARM), cylinder((0, 0, -1), BORE, ARM[2] + 2))


def crane(cover="cover", more=None, material=ALUMINIUM):
    """Return the crane; `more` is the name of another cover, below the first."""
    made = Drawing()
    top, boom = made.assembly("crane"), made.assembly("boom")
    made.add(top, made.product("foot", foot(), STEEL), name="foot")
    made.add(top, made.product(cover, box((0.0, 0.0, 0.0), COVER), material), place(30.0, -10.0, -FOOT[2] - 3), cover)
    if more is not None:
        made.add(top, made.product(more, moved(box((0.0, 0.0, 0.0), COVER)), STEEL), place(5.0, -10.0, -7.0), more)
    made.add(boom, made.product("arm", arm(), STEEL), name="arm")
    made.add(boom, made.product("weight", box((0.0, 0.0, 0.0), WEIGHT), STEEL), place(20.0, -5.0, ARM[2]), "weight")
    made.add(top, boom, place(z=PLAY), "boom")
    return made


def torsion_spring():
    """Return a base with a lever on it, and a torsion spring about y: a turn, and a leg in a hole of each."""
    made = Drawing()
    top = made.assembly("brake")
    base = fused(box((-20.0, 2.0, -10.0), (40.0, 4.0, 40.0)), cylinder((0, -8, 0), 2.0, 10, (0, 1, 0)))
    lever = cut(box((-4.0, -6.0, -4.0), (30.0, 6.0, 8.0)), cylinder((0, -7, 0), 2.05, 9, (0, 1, 0)))
    ring = BRepPrimAPI_MakeTorus(gp_Ax2(gp_Pnt(0, -7, 0), gp_Dir(0, 1, 0)), 3.0, 0.25).Shape()
    legs = cylinder((3, -7, 0), 0.25, 11, (0, 1, 0)), cylinder((-3, -7, 0), 0.25, 4, (0, 1, 0))
    spring, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(spring)
    for each in (ring, *legs):
        builder.Add(spring, each)
    holes = [cylinder((x, -9, 0), 0.3, 18, (0, 1, 0)) for x in (3, -3)]
    made.add(top, made.product("base", cut(base, holes[0]), STEEL), name="base")
    made.add(top, made.product("lever", cut(lever, holes[1]), STEEL), name="lever")
    made.add(top, made.product("Schenkelfeder", spring, STEEL), name="Schenkelfeder")
    return made


def board():
    """Return a board on which two components are soldered, and a lid beside it that nothing touches."""
    made = Drawing()
    top = made.assembly("sensor")
    made.add(top, made.product("carrier", box((0, 0, 0), (20.0, 30.0, 1.6))), name="carrier")
    chip = made.product("R_0805_2012Metric", box((0, 0, 0), (2.0, 1.25, 0.5)))
    made.add(top, chip, place(3.0, 5.0, 1.65))
    made.add(top, chip, place(3.0, 9.0, 1.65))
    made.add(top, made.product("lid", box((0, 0, 0), (20.0, 30.0, 1.0))), place(z=9.0), "lid")
    return made


def pedals():
    """Return a rod in a stand, and a subassembly of two pedals on it, each of an arm and a plate."""
    made = Drawing()
    top, both = made.assembly("car"), made.assembly("pedals")
    stand = cut(box((-2.0, -10.0, -10.0), (4.0, 20.0, 20.0)), cylinder((-3, 0, 0), 4.05, 6, (1, 0, 0)))
    made.add(top, made.product("stand", stand, STEEL), name="stand")
    made.add(top, made.product("rod", cylinder((-2, 0, 0), 4.0, 100, (1, 0, 0)), STEEL), name="rod")
    lever = cut(box((0.0, -8.0, -50.0), (6.0, 16.0, 60.0)), cylinder((-1, 0, 0), 4.05, 8, (1, 0, 0)))
    arm, plate = made.product("arm", lever, STEEL), made.product("plate", box((-5, 8, -50), (16.0, 3.0, 20.0)), STEEL)
    for x in (20.0, 60.0):
        made.add(both, arm, place(x))
        made.add(both, plate, place(x))
    made.add(top, both, name="pedals")
    return made


def gears():
    """Return a frame with two pins, and on them two gears, without teeth but with their numbers in their names."""
    made = Drawing()
    top = made.assembly("gears")
    frame = box((-20.0, -20.0, -4.0), (80.0, 40.0, 4.0))
    frame = fused(frame, *(cylinder((x, 0, 0), 3.0, 8) for x in (0.0, 30.0)))
    made.add(top, made.product("frame", frame, STEEL), name="frame")
    for name, radius, x in (("Spur gear (24 teeth)", 13.0, 0.0), ("Ritzel z36", 19.0, 30.0)):
        shape = cut(cylinder((0, 0, 0), radius - 2.0, 5.0), cylinder((0, 0, -1), 3.05, 8))
        made.add(top, made.product(name, shape, STEEL), place(x, z=0.05), name)
    return made
