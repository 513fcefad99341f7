"""The table `surface` of a file: what is taken, what is refused and in which words, and that it stays the same."""

import copy
import json
from typing import Any

import numpy as np
import pytest

from engine.errors import MechanismError
from engine.mechanism import load_mechanism_text, mechanism_from, mechanism_schema, set_values, unit_of
from engine.mechanism.keys.values import settable_numbers
from engine.mechanism.surfaces.surface import FreeFormSurface
from tests.each import each
from tests.engine.kernels.surface_shapes import graded_rectangle, knots, sphere_octant
from tests.engine.mechanism.plain import pendulum, put

FLAT = {"patches": graded_rectangle(2.0, 1.0).tolist(), "depth": 0.5}
SHEET = {
    "degree": [3, 2],
    "knots_u": knots(5, 3),
    "knots_v": knots(3, 2),
    "control": [[[x, y, 0.0] for y in (0.0, 1.0, 2.0)] for x in (0.0, 1.0, 2.0, 3.0, 4.0)],
}


def with_surface(surface: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Describe the pendulum with a point over a surface, and changed keys of it; ``...`` removes one."""
    data = put(pendulum(), "contacts.stop.b", {"body": "link", "point": [0, -8, 0]})
    own = copy.deepcopy(surface) | changes
    side = {"body": "ground", "surface": {key: value for key, value in own.items() if value is not ...}}
    return put(data, "contacts.stop.a", side)


def fault(data: dict[str, Any]) -> str:
    """Return the line of the one error that ``data`` causes."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    (line,) = str(caught.value).split("\n")[1:]
    return line.strip()


BEND = np.array(FLAT["patches"])
BEND[..., 2] = -0.5 * BEND[..., 0] ** 2
TURNED = np.array(FLAT["patches"])
TURNED[1] = TURNED[1].transpose(1, 0, 2)
LINE = np.array(FLAT["patches"])
LINE[1, :, :, 1] = 0.0
REFUSED = [
    (FLAT, {"patches": ...}, "surface: has no form, or more than one", "write one of them"),
    (FLAT, {"degree": [3, 3]}, "surface: has no form, or more than one", "allowed: patches, or degree"),
    (FLAT, {"weights": [[1.0]]}, "surface.weights", "belongs to a B-spline"),
    (FLAT, {"patches": [[[0, 0, 0]]]}, "surface.patches", "[0] has 1 entries and not 4"),
    (FLAT, {"patches": []}, "surface.patches", "0 entries and not 1 to 1000"),
    (FLAT, {"patches": "x"}, "surface.patches", "it is not a list; allowed: a list of patches"),
    (FLAT, {"patches": [[[[0, 0, "a"]] * 4] * 4]}, "surface.patches", "[0][0][0][2] is not a finite number"),
    (FLAT, {"patches": TURNED.tolist()}, "surface.patches", "patches 0 and 1 share an edge"),
    (FLAT, {"patches": LINE.tolist()}, "surface.patches", "a line or a point"),
    (FLAT, {"patches": BEND.tolist(), "depth": 1.2}, "surface.depth = 1.2 mm", "would fold; allowed: up to 1.0"),
    (FLAT, {"depth": 0}, "surface.depth = 0 mm", "allowed: > 0"),
    (SHEET, {"knots_v": ...}, "surface.knots_v", "missing; a B-spline surface has degree"),
    (SHEET, {"knots_v": [0, 0, 0, 1, 1]}, "surface.knots_v", "5 knots; allowed: 6, for 3 control points of degree 2"),
    (SHEET, {"knots_v": [0, 0, 1, 0, 1, 1]}, "surface.knots_v", "does not increase"),
    (SHEET, {"knots_v": [0, 0, 0, 0, 0, 0]}, "surface.knots_v", "not all equal"),
    (SHEET, {"degree": [3, 16]}, "surface.degree = [3, 16]", "allowed: 1 to 15"),
    (SHEET, {"degree": [5, 2]}, "surface.control", "5 control points for degree 5"),
    (SHEET, {"weights": [[1.0, 1.0]]}, "surface.weights", "a weight > 0 for each control point"),
    (SHEET, {"control": [[[0, 0, 0]], [[0, 0, 0], [1, 1, 1]]]}, "surface.control", "rows of different lengths"),
    (sphere_octant(5.0), {"conversion": 1e-11}, "surface.conversion", "needs more than 10000 bicubic patches"),
]


@each(("surface", "changes", "where", "remedy"), REFUSED)
def test_a_surface_that_cannot_be_says_where_and_what_to_do(surface, changes, where, remedy):
    line = fault(with_surface(surface, **changes))
    assert line.startswith(f"contacts.stop.a.{where}")
    assert remedy in line
    assert len(line) < 800


def test_a_closed_surface_has_no_depth():
    """The six faces of a plate are closed: nothing has to be put behind them."""
    whole = FreeFormSurface.model_validate(FLAT).boundary
    closed = FreeFormSurface.model_validate({"patches": whole.tolist()})
    np.testing.assert_array_equal(closed.boundary, whole)
    assert "a closed surface has no plate behind it" in fault(with_surface({"patches": whole.tolist(), "depth": 0.5}))


def test_a_depth_can_be_set_and_control_points_have_no_keys():
    mechanism = mechanism_from(with_surface(FLAT), "FILE")
    assert [n.key for n in settable_numbers(mechanism, "surface")] == ["contacts.stop.a.surface.depth"]
    assert unit_of(mechanism, "contacts.stop.a.surface.depth") == "mm"
    thinner = set_values(mechanism, {"contacts.stop.a.surface.depth": 0.25}).contacts["stop"].a.surface
    heights = thinner.boundary[..., 2]
    assert (heights.min(), heights.max()) == (-0.25, 0.0)


@pytest.mark.parametrize("surface", [FLAT, SHEET])
def test_a_surface_survives_being_written(surface):
    """As JSON, as a plan has it, it is the same to the last bit, and equal."""
    mechanism = mechanism_from(with_surface(surface), "FILE")
    text = mechanism.model_dump_json(by_alias=True, exclude_none=True)
    again = mechanism_from(json.loads(text), "FILE")
    assert again.contacts["stop"] == mechanism.contacts["stop"]
    assert hash(again.contacts["stop"].a.surface) == hash(mechanism.contacts["stop"].a.surface)
    one, other = (m.contacts["stop"].a.surface.boundary for m in (mechanism, again))
    assert one.tobytes() == other.tobytes()


def test_a_file_may_hold_many_patches():
    """Two hundred patches with all digits are a fifth of what a file may have."""
    rng = np.random.default_rng(0)
    patches = graded_rectangle(20.0, 10.0, (20, 10))
    patches[..., 2] += 0.01 * rng.normal(size=()) + patches[..., 0] * np.pi
    lines = ",\n".join(json.dumps(patch) for patch in patches.tolist())
    text = f"""
format = 1
name = "sheet"
units = "SI"
[bodies.ground]
fixed = true
[bodies.ball]
mass = 1.0
inertia = [1.0, 1.0, 1.0]
origin = [0.0, 0.0, 100.0]
[contacts.c]
friction = 0.0
a = {{ body = "ball", point = [0.0, 0.0, 0.0] }}
[contacts.c.b]
body = "ground"
[contacts.c.b.surface]
patches = [
{lines}
]
[simulation]
step = 1e-3
horizon = 1.0
penetration = 1e-8
rest = {{ window = 0.1, drift = 1e-6 }}
[responses.load]
type = "contact_force"
contact = "c"
"""
    loaded = load_mechanism_text(text).contacts["c"].b.surface
    np.testing.assert_array_equal(loaded.top, patches)


def test_the_schema_describes_the_lists():
    table = mechanism_schema()["$defs"]["FreeFormSurface"]["properties"]
    (lists,) = [part for part in table["patches"]["anyOf"] if part.get("type") == "array"]
    inner = lists["items"]["items"]["items"]
    assert (lists["maxItems"], inner["minItems"], inner["maxItems"]) == (1000, 3, 3)
