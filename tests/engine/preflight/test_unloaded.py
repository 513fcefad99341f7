"""Motions that nothing loads, of bodies that a response measures."""

from tests.engine.preflight.examples import GROUND, SPRING, guided, pin, warned
from tests.engine.small import FLOOR, GRAVITY, block_on_floor

ALONG_Z = "bodies.pin: no force, spring or gravity acts on it along z, the axis of J, and z measures that; load"


def test_a_pin_in_its_axial_play():
    """Gravity across the axis, with friction or without, or none at all: nothing decides where it lies along it."""
    for data in (pin(), pin(friction=0.0), pin(gravity=(0, 0, 0))):
        (text,) = warned(data)
        assert text.startswith(ALONG_Z)


def test_what_loads_it_or_does_not_measure_it_is_fine():
    """A component of gravity, a force, also of one phase, a spring without force at first, or another measure."""
    force = {"f": {"body": "pin", "force": [0, 0, 1.0]}}
    spring = SPRING | {"a": {"body": "ground", "point": [0, 0, -1]}, "b": {"body": "pin", "point": [0, 0, 0]}}
    for data in (
        pin(gravity=(0, -GRAVITY, -0.1)),
        pin(forces=force),
        pin(forces={"f": force["f"] | {"phases": ["press"]}}, phases=[{"name": "press"}, {"name": "free"}]),
        pin(springs={"s": spring}),
        pin(measured="y"),
        pin(phases=[{"name": "run", "duration": 1.0}]),
    ):
        assert warned(data) == []


def test_a_load_that_grows_from_zero_counts():
    """A law of time that begins at 0."""
    law = {"table": [[0.0, 0.0], [0.5, 1.0]]}
    assert warned(pin(forces={"f": {"body": "pin", "force": [0, 0, 1.0], "law": law}})) == []


def test_a_block_on_a_floor():
    """Its weight holds it down and upright; along x and y nothing acts, across a steep slope nothing does."""
    texts = warned(block_on_floor(origin=[0, 0, 0.1]))
    assert [text.split("; ")[0] for text in texts] == [
        "bodies.block: no force, spring or gravity acts on it along x, and x measures that",
        "bodies.block: no force, spring or gravity acts on it along y, and y measures that",
    ]
    data = block_on_floor(origin=[0, 0, 0.1]) | {"gravity": [5, 0, -8]}
    assert len(warned(data)) == 1


def test_a_block_that_is_thrown_is_stopped_by_friction():
    """The start decides where it ends; without friction it slides on for ever."""
    data = block_on_floor(origin=[0, 0, 0.1], velocity=[2, 0, 0])
    assert all("along y" in text for text in warned(data))
    data = block_on_floor(friction=0.0, origin=[0, 0, 0.1], velocity=[2, 0, 0])
    assert any("along x" in text for text in warned(data))


def test_a_body_that_another_one_pushes_is_loaded():
    """A slider that a loaded one presses along x by a contact, with a gap at first."""
    block = {"mass": 2.0, "inertia": [0.1, 0.1, 0.1]}
    data = guided(forces={"f": {"body": "ball", "force": [1, 0, 0]}})
    data["bodies"]["block"] = block | {"origin": [0.2, 0, 0]}
    guide = {"point": [0, 0, 0], "axis": [1, 0, 0]}
    data["joints"]["K"] = {
        "type": "prismatic",
        "guide": {"body": "ground", **guide},
        "slider": {"body": "block", **guide},
    }
    data["joints"]["K"]["guide"] = {"body": "ground", "point": [0.2, 0, 0], "axis": [1, 0, 0]}
    face = {"point": [-0.05, 0, 0], "normal": [-1, 0, 0]}
    data["contacts"] = {"push": {"a": {"body": "ball", "point": [0.1, 0, 0]}, "b": {"body": "block", "plane": face}}}
    data["responses"] = {"x": data["responses"]["x"] | {"to": {"body": "block", "point": [0, 0, 0]}}}
    data["contacts"]["push"]["friction"] = 0.0
    data["simulation"]["rest"]["window"] = 0.5
    assert warned(data) == []
    del data["forces"]
    assert any(text.startswith("bodies.block: no force") for text in warned(data))


def test_a_measured_body_without_anything():
    """A free body without gravity: each direction that is measured."""
    data = block_on_floor(origin=[0, 0, 0.1]) | {"gravity": [0, 0, 0]}
    assert GROUND in data["bodies"].values()
    assert data["contacts"]["corner_0"]["b"]["plane"] == FLOOR
    assert len(warned(data)) >= 3


def unmeasured(data):
    """Return what is said of a mechanism whose responses nobody has thought of yet, without the remedy."""
    return [text.split("; ")[0] for text in warned(data | {"responses": {}})]


def test_without_responses_every_motion_counts():
    """The pin floats in its play, which a spring along the axis ends; in all other ways it hangs by gravity."""
    spring = SPRING | {"a": {"body": "ground", "point": [0, 0, -1]}, "b": {"body": "pin", "point": [0, 0, 0]}}
    assert unmeasured(pin()) == ["bodies.pin: no force, spring or gravity acts on it along z, the axis of J"]
    assert unmeasured(pin(springs={"s": spring})) == []


def test_each_free_motion_is_named_once():
    """A free body without gravity has six: three along the world's axes, three about them."""
    data = block_on_floor(origin=[0, 0, 0.1]) | {"gravity": [0, 0, 0]}
    motions = {text.removeprefix("bodies.block: no force, spring or gravity acts on it ") for text in unmeasured(data)}
    assert motions == {f"{way} {axis}" for way in ("along", "about") for axis in "xyz"}


def test_where_no_body_is_fixed_all_may_move_together():
    """That a part is to be fixed is said elsewhere."""
    data = block_on_floor(origin=[0, 0, 0.1]) | {"gravity": [0, 0, 0], "contacts": {}, "responses": {}}
    data["bodies"] = {"block": data["bodies"]["block"]}
    assert warned(data) == []
