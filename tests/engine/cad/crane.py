"""A crane drawn with OCP: a foot with a glued cover, and an arm of two parts that turns on a pin of the foot."""

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
