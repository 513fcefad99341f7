"""Rounds in notches touch both faces: the parts of a divided profile, and statics in closed form."""

import cmath
import math
from cmath import rect
from collections.abc import Sequence
from itertools import pairwise, starmap
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine import simulate
from engine.assembly import assemble
from engine.mechanism.closed_profiles import Piece
from engine.mechanism.divided_profiles import Curve, divided
from tests.engine.small import GRAVITY, coordinates, made, small

PEN = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0]}
NOTCH = [(-3, -2), (3, -2), (3, 1), (1, 1), (0, 0), (-1, 1), (-3, 1)]  # right-angled, its faces sqrt(2) long
MASS = 2.0


def bar(points: Any = NOTCH) -> dict[str, Any]:
    """Describe a fixed bar with a polygon as its section."""
    first, *rest = points
    return {"body": "ground", "extruded": {**PEN, "start": list(first), "profile": [{"to": list(p)} for p in rest]}}


def side_of(body: str) -> dict[str, Any]:
    """Return the side of a joint in the plane of the section."""
    return {"body": body, "point": [0, 0, 0], "normal": [0, 0, 1]}


def roller(radius: float, aside: float = 0.0, points: Any = NOTCH, **side: Any) -> dict[str, Any]:
    """Describe a roller without friction in a notch; a force of ``aside`` times its weight pushes it along."""
    a = {"body": "roller", **(side or {"sphere": {"centre": [0, 0, 0], "radius": radius}})}
    return small(
        bodies={
            "ground": {"fixed": True},
            "roller": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 2.5 * radius, 0]},
        },
        joints={"plane": {"type": "planar", "a": side_of("ground"), "b": side_of("roller")}},
        gravity=[aside * GRAVITY, -GRAVITY, 0],
        contacts={"notch": {"friction": 0.0, "a": a, "b": bar(points)}},
        responses={**coordinates("roller"), "force": {"type": "contact_force", "contact": "notch"}},
        phases=[{"name": "run", "duration": 0.9}],
    )


SIDES = {
    "sphere": {},
    "profile": {"extruded": {**PEN, "start": [1, 0], "profile": [{"to": [1, 0], "centre": [0, 0], "turn": "left"}]}},
    "arc": {"arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.9, "edge_radius": 0.1}},
    "in a groove": {},
}


def names(data: dict[str, Any]) -> list[str]:
    """Return the contacts of a run."""
    return list(assemble(made(data)).contact_names)


def test_a_ball_and_an_arc_have_a_contact_with_each_part():
    """Of a bar with a notch; a bar without one is a single contact, as are a point and a corner in a notch."""
    assert names(roller(1.0)) == ["notch.part0", "notch.part1"]
    assert names(roller(1.0, points=[(-3, -2), (3, -2), (3, 1), (-3, 1)])) == ["notch"]
    assert names(roller(1.0, point=[0, 0, 0])) == ["notch"]
    found = set(names(roller(1.0, **SIDES["profile"])))
    assert {"notch.arc_a0.part0", "notch.arc_a0.part1", "notch.corner_b0"} < found


@pytest.mark.parametrize("shape", SIDES)
def test_a_roller_rests_on_both_faces(shape):
    """With a share f of the weight W as a force aside, the faces carry (1 - f) W / sqrt(2) and (1 + f) W / sqrt(2)."""
    radius, share = 1.0, 0.4
    data = roller(radius, share, **SIDES[shape])
    if shape == "in a groove":  # the same notch, turned about an axis below it
        section = [[0, -3], [3, -3], [3, -1], [2, 0], [3, 1], [3, 3], [0, 3]]
        shaft = {
            "point": [0, -2, 0],
            "axis": [1, 0, 0],
            "start": section[0],
            "profile": [{"to": p} for p in section[1:]],
        }
        data["contacts"]["notch"]["b"] = {"body": "ground", "turned": shaft}
    data["bodies"]["roller"]["origin"] = [0, math.sqrt(2) * radius, 0]
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.responses["x"] == pytest.approx(0.0, abs=1e-6)
    assert run.responses["y"] == pytest.approx(math.sqrt(2) * radius, abs=1e-6)
    assert run.responses["force"] == pytest.approx(math.sqrt(2) * MASS * GRAVITY, rel=1e-6)  # of both faces


def test_a_ball_too_large_for_a_notch_rests_on_its_edges():
    """They are 2 apart, so that their forces are inclined to its weight W by sin(phi) = 1/r; W / cos(phi) in sum."""
    radius = 2.0
    data = roller(radius)
    height = math.sqrt(radius**2 - 1)
    data["bodies"]["roller"]["origin"] = [0, 1 + height, 0]
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.responses["y"] == pytest.approx(1 + height, abs=1e-6)
    assert run.responses["force"] == pytest.approx(MASS * GRAVITY * radius / height, rel=1e-6)


def test_a_detent_lets_go_beyond_its_force():
    """The faces are inclined by 45 degrees: more than the weight, and the roller climbs out."""
    for share, leaves in ((0.9, False), (1.1, True)):
        data = roller(1.0, share)
        data["bodies"]["roller"]["origin"] = [0, math.sqrt(2), 0]
        assert (abs(simulate(made(data)).responses["x"]) > 0.1) == leaves


def polygon(points: Sequence[complex]) -> Curve:
    """Return the curve of a polygon."""
    return tuple(starmap(Piece, pairwise([*points, points[0]])))


def distance(curve: Curve, at: complex) -> float:
    """Return the distance of a point from a solid, 0 inside."""
    ends = [p for piece in curve for p in piece.point(np.linspace(0.0, 1.0, 33))] + [curve[0].start]
    if (
        any(at == p for p in ends)
        or abs(sum(cmath.phase((b - at) / (a - at)) for a, b in pairwise(ends) if a != b)) > 3
    ):
        return 0.0
    feet = [piece.start for piece in curve]
    for piece in curve:
        if piece.centre is None:
            way = piece.direction(0.0)
            foot = piece.start + way * (way.conjugate() * (at - piece.start)).real
        else:
            foot = piece.centre + piece.radius * (at - piece.centre) / (abs(at - piece.centre) or 1.0)
        feet += [foot] if piece.has(foot, 1e-12) else []
    return min(abs(at - foot) for foot in feet)


def is_divided_well(curve: Curve, places: Sequence[tuple[float, float]]) -> bool:
    """Assert that areas add up, that the nearest part is as near as the whole, and that no part has a notch."""
    parts = divided(curve)
    assert sum(p.area for part in parts for p in part) == pytest.approx(sum(p.area for p in curve), rel=1e-9)
    assert all(one.end == other.start for part in parts for one, other in pairwise([*part, part[0]]))
    for at in starmap(complex, places):
        if (far := distance(curve, at)) > 1e-3:
            assert min(distance(each, at) for each in parts) == pytest.approx(far, abs=1e-9)
    assert all(divided(part) == [part] for part in parts)
    return len(parts) > 1


PLACES = st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=5, max_size=5)


@given(st.lists(st.floats(0.4, 2.0), min_size=5, max_size=12), PLACES)
def test_parts_of_stars_are_the_whole(radii, places):
    """Polygons with a corner in each of some directions, many of them hollow."""
    is_divided_well(polygon([rect(r, 2 * math.pi * i / len(radii)) for i, r in enumerate(radii)]), places)


@given(st.floats(0.2, 0.9), PLACES)
def test_parts_of_cams_are_the_whole(nose, places):
    """Two round noses on a round base meet it in four hollow corners of arcs and lines; a disc has none."""
    foot, tip = cmath.sqrt(1 - nose**2 / 4), 2.0
    side = nose / 2
    half = [Piece(foot - 1j * side, tip - 1j * side), Piece(tip - 1j * side, tip + 1j * side, complex(tip))]
    half += [Piece(tip + 1j * side, foot + 1j * side), Piece(foot + 1j * side, -foot + 1j * side, 0j)]
    turned = [Piece(-p.start, -p.end, None if p.centre is None else -p.centre) for p in half]
    assert is_divided_well((*half, *turned), places)
    assert not is_divided_well((Piece(1 + 0j, 1 + 0j, 0j),), places)
