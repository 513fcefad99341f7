"""Profiles as they are written: what is taken, what is refused, and in which words."""

import copy
import math
from typing import Any

import numpy as np
import pytest

from engine.assembly.contacts import profile_pieces
from engine.errors import MechanismError
from engine.mechanism import Mechanism, get_value, mechanism_from, set_values, unit_of
from engine.mechanism.keys.values import settable_numbers
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put

SQUARE: list[dict[str, Any]] = [{"to": [1, 0]}, {"to": [1, 1]}, {"to": [0, 1]}]
CAM: list[dict[str, Any]] = [
    {"to": [3, 1], "centre": [3, 0], "turn": "left"},
    {"to": [0, 1]},
    {"to": [0, -1], "centre": [0, 0], "turn": "left"},
    {"to": [3, -1]},
]


def with_profile(kind: str, start: Any, profile: Any, **others: Any) -> dict[str, Any]:
    """Describe the pendulum with a point against a turned or extruded solid far away."""
    own = {"point": [0, 0, 90], "axis": [0, 0, 1], "start": start, "profile": copy.deepcopy(profile), **others}
    own |= {"along": [1, 0, 0]} if kind == "extruded" else {}
    data = put(pendulum(), "contacts.stop.a", {"body": "ground", kind: own})
    return put(data, "contacts.stop.b", {"body": "link", "point": [0, -8, 0]})


def made(*described: Any, **others: Any) -> Mechanism:
    """Return the pendulum with a profile."""
    return mechanism_from(with_profile(*described, **others), "FILE")


def fault(*described: Any, **others: Any) -> str:
    """Return the one line of the error that a profile causes."""
    with pytest.raises(MechanismError) as caught:
        made(*described, **others)
    (line,) = (line.strip() for line in str(caught.value).split("\n")[1:])
    return line


def curve(mechanism: Mechanism) -> Any:
    """Return the pieces of the stop's profile."""
    return mechanism.contacts["stop"].sides[1].primitive.curve


def test_a_profile_closes_by_itself_and_has_the_material_on_its_left():
    open_one, closed = made("extruded", [0, 0], SQUARE), made("extruded", [0, 0], [*SQUARE, {"to": [0, 0]}])
    other_way = made("extruded", [0, 0], [{"to": [0, 1]}, {"to": [1, 1]}, {"to": [1, 0]}])
    assert curve(open_one) == curve(closed)
    for mechanism in (open_one, closed, other_way):
        assert len(curve(mechanism)) == 4
        assert sum(piece.area for piece in curve(mechanism)) == pytest.approx(1)
        assert {piece.start for piece in curve(mechanism)} == {0, 1, 1 + 1j, 1j}


def test_areas_of_arcs_are_those_of_circles():
    assert sum(p.area for p in curve(made("extruded", [3, -1], CAM))) == pytest.approx(6 + math.pi)
    (circle,) = curve(made("extruded", [2, 0], [{"to": [2, 0], "centre": [0.5, 0], "turn": "right"}]))
    assert circle.area == pytest.approx(math.pi * 1.5**2)
    assert circle.sweep == pytest.approx(2 * math.pi)


def test_an_end_that_almost_meets_the_start_is_the_start():
    almost = [*SQUARE, {"to": [1e-12, -1e-13]}]
    assert len(curve(made("extruded", [0, 0], almost))) == 4


def test_pieces_on_the_axis_are_no_surface():
    pieces = curve(made("turned", [0, 0], [{"to": [2, 0]}, {"to": [2, 1]}, {"to": [1e-13, 1]}]))
    assert [(piece.start, piece.end) for piece in pieces] == [(0, 2), (2, 2 + 1j), (2 + 1j, 1j)]


def test_an_arc_whose_ends_almost_lie_on_the_circle_goes_through_them():
    """Four digits are enough; the centre is put where both ends have the same distance from it."""
    start, end = [0.9659, 0.2588], [0.2588, 0.9659]
    arc = curve(made("extruded", start, [{"to": end, "centre": [0, 1e-5], "turn": "left"}, {"to": [0, 0]}]))[0]
    assert arc.start == complex(*start)
    assert arc.end == complex(*end)
    assert abs(arc.point(1.0) - arc.end) < 1e-15
    assert abs(arc.centre) < 2e-5


def test_rows_of_a_cam():
    """Corners and joints: a tangent arc and line have the direction halfway in common, and no corner."""
    rows = profile_pieces(made("extruded", [3, -1], CAM).contacts["stop"].sides[1])
    assert rows[:, 7].tolist() == [1, 0, 1, 0]
    np.testing.assert_allclose(rows[0, 13:17], [0, -1, 0, 1], atol=1e-15)
    assert np.all(rows[:, 17:19] == 0)
    square = profile_pieces(made("extruded", [0, 0], SQUARE).contacts["stop"].sides[1])
    assert np.all(square[:, 17:19] == 1)
    np.testing.assert_allclose(square[0, 13:17], np.array([-1, -1, 1, -1]) / math.sqrt(2), atol=1e-15)


def test_the_tip_of_a_cone_points_along_the_axis():
    rows = profile_pieces(made("turned", [0, 0], [{"to": [1, -1]}, {"to": [0, -1]}]).contacts["stop"].sides[1])
    tip = next(row for row in rows if row[2] == row[3] == 0 or row[0] == row[1] == 0)
    at = tip[13:15] if tip[0] == tip[1] == 0 else tip[15:17]
    np.testing.assert_allclose(at, [0, 1], atol=1e-15)


ARC = {"to": [0, 1], "centre": [0, 0], "turn": "left"}
REFUSED = [
    ("extruded", [0, 0], [{"to": [1, 0]}], "profile", "turns back along"),
    ("extruded", [0, 0], [SQUARE[0], SQUARE[0], SQUARE[1]], "profile.1.to = [1.0, 0.0]", "where it begins"),
    ("extruded", [1, 0], [{"to": [0, 1], "centre": [0, 0]}], "profile.0.turn", "missing; an arc has a centre"),
    ("extruded", [1, 0], [{"to": [0, 1], "turn": "left"}], "profile.0.centre", "missing; an arc has a centre"),
    ("extruded", [1, 0], [{**ARC, "turn": "up"}], "profile.0.turn = 'up'", "left"),
    ("extruded", [1, 0], [{"to": [0, 1, 2]}], "profile.0.to", "two finite numbers"),
    ("extruded", [1, 0], [], "profile", "0 segments; allowed: 1 to 500"),
    ("extruded", [1, 0], [ARC] * 501, "profile", "501 segments; allowed: 1 to 500"),
    ("extruded", [1, 0], [{**ARC, "to": [0, 1.01]}], "profile.0.centre", "begins 1 and ends 1.01 from its centre"),
    ("extruded", [0, 0], [SQUARE[1], SQUARE[0], SQUARE[2]], "profile", "segment 0 meets segment 2 at [0.5, 0.5]"),
    ("extruded", [0, 0], [{"to": [2, 0]}, {"to": [2, 1]}, {"to": [1, 0]}, {"to": [0, 1]}], "profile", "at [1, 0]"),
    (
        "extruded",
        [-2, 0],
        [{"to": [2, 0]}, {"to": [2, -1]}, {"to": [1, -1]}, {"to": [-1, -1], "centre": [0, -1], "turn": "left"}],
        "profile",
        "segment 0 meets segment 3 at",
    ),
    ("extruded", [1, 0], [{**ARC, "to": [1, 0]}, {"to": [3, 0]}, {"to": [3, 1]}], "profile.0", "a full circle"),
    ("turned", [-0.1, 0], [{"to": [1, 0]}, {"to": [1, 1]}], "profile", "the other side of the axis at [-0.1, 0]"),
    ("turned", [0, 1], [{**ARC, "to": [0, -1]}, {"to": [0.5, -2]}, {"to": [0.5, 2]}], "profile", "r >= 0"),
    ("turned", [0, 0], [{"to": [1, 1], "centre": [1, 0], "turn": "right"}, {"to": [1, 0]}], "profile", "needle"),
]


@each(("kind", "start", "profile", "where", "text"), REFUSED)
def test_a_profile_that_cannot_be_says_where_and_what_to_do(kind, start, profile, where, text):
    line = fault(kind, start, profile)
    assert line.startswith(f"contacts.stop.a.{kind}.{where}"), line
    assert text in line
    assert "allowed" in line or "missing" in line or text.startswith("at ")


def test_an_extruded_profile_lies_across_its_axis():
    data = put(with_profile("extruded", [0, 0], SQUARE), "contacts.stop.a.extruded.along", [1, 0, 1])
    with pytest.raises(MechanismError, match="perpendicular to axis"):
        mechanism_from(data, "FILE")


def test_numbers_of_a_profile_have_keys_and_units():
    rounded = [{"to": [2, 0]}, {"to": [2, 1]}, {"to": [1, 2], "centre": [1, 1], "turn": "left"}, {"to": [0, 2]}]
    mechanism = made("extruded", [0, 0], rounded, half_length=2.0)
    key = "contacts.stop.a.extruded.profile"
    assert len(curve(mechanism)) == 5
    listed = {number.key: number for number in settable_numbers(mechanism, "extruded")}
    assert {f"{key}.0.to.0", f"{key}.2.centre.1", "contacts.stop.a.extruded.start.0"} <= set(listed)
    assert listed[f"{key}.0.to.1"].unit == "mm" == unit_of(mechanism, "contacts.stop.a.extruded.half_length")
    changed = set_values(mechanism, {f"{key}.0.to.0": 2.25})
    assert get_value(changed, f"{key}.0.to.0") == 2.25
    assert curve(changed)[0].end == 2.25
    with pytest.raises(MechanismError, match=r"\b0\.5\b.*1\.11803399"):
        set_values(mechanism, {f"{key}.2.centre.0": 1.5})


def test_a_profile_may_follow_from_parameters():
    """One parameter moves the circle: start, end and centre stay where they fit together."""
    data = with_profile(
        "extruded", ["radius + off", 0], [{"to": ["radius + off", 0], "centre": ["off", 0], "turn": "left"}]
    )
    data["parameters"] = {"radius": 2.0, "off": 0.5}
    changed = set_values(mechanism_from(data, "FILE"), {"parameters.off": 0.75})
    assert curve(changed)[0].centre == 0.75
    assert curve(changed)[0].radius == 2.0
