"""Two solids that touch at several points at once: their distance between two bounds, and where they touch."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.assembly.solids import SHALLOW
from engine.errors import MechanismError
from engine.kernels.contact_geometry.rounds import ALIGNED
from tests.counts import many
from tests.each import each
from tests.engine.kernels.convex import bounds, found, scattered, two
from tests.engine.kernels.shapes import across, unit
from tests.engine.small import made

Array = np.ndarray
KINDS = ("capsule-capsule", "capsule-cylinder", "cylinder-cylinder", "box-box", "capsule-box", "cylinder-box")
UPRIGHT = {"point": [0, 0, 0], "axis": [0, 0, 1]}


def drawn(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a solid near the origin of its body."""
    size, half = rng.uniform(0.2, 1.0, 2).tolist()
    place = (0.3 * rng.normal(size=3)).tolist()
    if kind == "box":
        n = unit(rng.normal(size=3))
        sides = {"half_lengths": rng.uniform(0.2, 1.0, 3).tolist()}
        return {kind: {"centre": place, "normal": n.tolist(), "along": across(n, rng).tolist(), **sides}}
    return {
        kind: {"point": place, "axis": unit(rng.normal(size=3)).tolist(), "radius": 0.6 * size, "half_length": half}
    }


def posed(kind: str, seed: int, poses: int) -> tuple[dict[str, Any], dict[str, Any], Array, Array]:
    """Draw two solids, such as "box-box", and poses of their bodies."""
    rng = np.random.default_rng(seed)
    a, b = (drawn(each_kind, rng) for each_kind in kind.split("-"))
    return a, b, *scattered(poses, rng)


any_solids = each("kind", KINDS)
any_seed = given(st.integers(0, 2**32 - 1))
some_draws = settings(max_examples=many(16), deadline=None)


@any_solids
@some_draws
@any_seed
@example(2011)  # two cylinders, as the next: an end that is wider beside the other than its axis is long there
@example(2021)
@example(2032)  # a flat end with its rim just in the side of a disc that is tilted
@example(279)  # of a cylinder and a box, as the next: the perpendicular of an edge that cannot press meets the side
@example(1077)  # a rim almost along an edge
@example(1078)  # bounds that are not close yet, of solids that overlap
def test_the_smallest_gap_is_the_distance(kind, seed):
    """Apart: between two bounds that are close to each other. Then pushed into each other: no less, and seen.

    Pushed along n they overlap by no more than depth + gap - lower along n, and so anywhere; and by depth + gap - upper
    or more, as that is how far the two nearest points found are beyond each other. Where the bounds are not close, n is
    no normal, and it is not known whether the solids are apart.

    But for two discs, whose ends meet at their rims: a gap there is one along the normal of an end, and so up to
    1 / 0.95 times as deep, as the ends of 0.95 are those that count as almost parallel. And a rim almost along an edge
    may pass by while it is shallow: its normal turns between the two faces faster than it sinks in.
    """
    longest = 1.0 / ALIGNED if kind == "cylinder-cylinder" else 1.0
    a, b, x, R = posed(kind, seed, 100)
    lower, upper, n = bounds(a, b, x, R)
    apart = lower > 1e-3
    x, R, lower, upper, n = x[apart], R[apart], lower[apart], upper[apart], n[apart]
    gap = found(two(a, b), x, R)[0].min(axis=1)
    assert np.all((lower - 1e-12 <= gap) & (gap <= upper + 1e-12))
    assert np.median(upper - lower) < 1e-6
    rim = 0.0 if "capsule" in kind else SHALLOW * max(side.get("cylinder", {}).get("radius", 0.0) for side in (a, b))
    for depth in (1e-3, 1e-6):
        x[:, 0] -= (gap[:, None] + depth) * n
        pushed = found(two(a, b), x, R)[0].min(axis=1)
        assert np.all(pushed >= -longest * (depth + gap - lower) - 1e-12)
        seen = pushed < (0.0 if depth > rim else 2.0 * rim)  # what passes by is its depth and the largest away
        assert np.all(seen | (depth + gap <= upper))
        x[:, 0] += (gap[:, None] + depth) * n


@any_solids
@some_draws
@any_seed
def test_gaps_change_no_faster_than_the_bodies_move(kind, seed):
    """1-Lipschitz, apart and just overlapping, however the bodies turn."""
    a, b, x, R = posed(kind, seed, 60)
    rng = np.random.default_rng(seed + 1)
    data, size = two(a, b), 10 ** rng.uniform(-6, -1, (60, 1))
    turn = size * rng.normal(size=(60, 3))
    shift = size * rng.normal(size=(60, 3))
    before = found(data, x, R)[0].min(axis=1)
    x[:, 0] += shift
    R[:, 0] = R[:, 0] @ Rotation.from_rotvec(turn).as_matrix()
    after = found(data, x, R)[0].min(axis=1)
    ((_, shape),) = a.items()
    if "half_lengths" in shape:
        reach = np.linalg.norm(shape["centre"]) + np.linalg.norm(shape["half_lengths"])
    else:
        reach = np.linalg.norm(shape["point"]) + shape["half_length"] + shape["radius"]
    moved = np.linalg.norm(shift, axis=1) + reach * np.linalg.norm(turn, axis=1)
    counts = np.minimum(before, after) > -0.02
    assert np.all((np.abs(after - before) <= moved + 1e-12)[counts])


@any_solids
def test_gaps_do_not_depend_on_the_world_or_on_which_body_is_first(kind):
    """Moved together, the gaps stay, and points and normals move along; exchanged, the smallest gap stays."""
    a, b, x, R = posed(kind, len(kind), 100)
    rng = np.random.default_rng(1)
    gap, point, frame, _ = found(two(a, b), x, R)
    there, turn = rng.normal(size=3), Rotation.random(random_state=rng).as_matrix()
    gap_there, point_there, frame_there, _ = found(two(a, b), x @ turn.T + there, turn @ R)
    np.testing.assert_allclose(gap_there, gap, atol=1e-12)
    near = frame[:, :, 0].any(axis=2)
    np.testing.assert_array_equal(frame_there[:, :, 0].any(axis=2), near)
    np.testing.assert_allclose(point_there[near], point[near] @ turn.T + there, atol=1e-8)
    np.testing.assert_allclose(frame_there[near], frame[near] @ turn.T, atol=1e-7)
    swapped = found(two(b, a), x[:, ::-1], R[:, ::-1])[0]
    apart = gap.min(axis=1) > -0.02
    np.testing.assert_allclose(swapped.min(axis=1)[apart], gap.min(axis=1)[apart], atol=1e-12)


def at(*place: float) -> tuple[Array, Array]:
    """Return one pose: the first body here, the second at the origin."""
    return np.array([[place, [0.0, 0.0, 0.0]]]), np.eye(3)[None, None].repeat(2, axis=1)


def touching(a: dict[str, Any], b: dict[str, Any], *place: float) -> tuple[Array, Array]:
    """Return the different points in which two bodies touch, sorted, and the normals towards a."""
    gap, point, frame, names = found(two(a, b), *at(*place))
    near = np.flatnonzero((gap[0] < 1e-6) & frame[0, :, 0].any(axis=1))
    up = np.array([-1.0 if "_b" in names[i] else 1.0 for i in near])
    normals = frame[0, near, 0] * up[:, None]
    points, first = np.unique(point[0, near].round(6) + 0.0, axis=0, return_index=True)
    return points, normals[first]


@pytest.mark.parametrize("depth", [0.0, 1e-9, -1e-9])
@each(("half", "ends"), [(0.3, 0.3), (0.5, 0.5), (2.0, 0.5)])
def test_parallel_rollers_touch_at_both_ends_of_what_they_have_in_common(half, ends, depth):
    """Also where their ends are in one plane, and a hair apart or in each other: never sideways."""
    a, b = ({"cylinder": {**UPRIGHT, "radius": 0.1, "half_length": h}} for h in (half, 0.5))
    points, normals = touching(a, b, 0.2 - depth, 0.0, 0.0)
    np.testing.assert_allclose(points, [[0.1, 0, -ends], [0.1, 0, ends]], atol=1e-6)
    np.testing.assert_allclose(normals, [[1, 0, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize("depth", [0.0, 1e-9, -1e-9])
@each(("radius", "offset"), [(0.2, 0.0), (0.1, 0.0), (0.4, 0.0), (0.2, 0.1)])
def test_discs_on_each_other_touch_around_what_they_have_in_common(radius, offset, depth):
    """Also of equal size: the centre of mass is between points that press upwards only."""
    a, b = ({"cylinder": {**UPRIGHT, "radius": r, "half_length": 0.05}} for r in (radius, 0.2))
    points, normals = touching(a, b, offset, 0.0, 0.1 - depth)
    np.testing.assert_allclose(points[:, 2], 0.05, atol=1e-6)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * len(points), atol=1e-6)
    reach = min(radius, 0.2)
    assert np.all(np.linalg.norm(points[:, :2] - [offset, 0], axis=1) <= radius + 1e-5)
    assert np.ptp(points[:, 1]) > 1.9 * np.sqrt(reach**2 - (offset / 2) ** 2)
    assert np.ptp(points[:, 0]) > 1.9 * reach - offset - 1e-5


def test_parallel_capsules_touch_at_both_ends_of_what_they_have_in_common():
    a, b = ({"capsule": {**UPRIGHT, "radius": 0.1, "half_length": h}} for h in (0.3, 0.5))
    points, normals = touching(a, b, 0.2, 0.0, 0.4)
    np.testing.assert_allclose(points, [[0.1, 0, 0.1], [0.1, 0, 0.5]], atol=1e-6)
    np.testing.assert_allclose(normals, [[1, 0, 0]] * 2, atol=1e-12)


def corners(x: Any, y: Any, z: float) -> Array:
    """Return the corners of a rectangle, sorted."""
    return np.array([[i, j, z] for i in sorted(x) for j in sorted(y)])


@pytest.mark.parametrize("depth", [0.0, 1e-9, -1e-9])
@each(
    ("half", "place", "expected"),
    [
        ([0.3, 0.2, 0.1], (0, 0, 0.2), corners((-0.3, 0.3), (-0.2, 0.2), 0.1)),
        ([0.2, 0.1, 0.1], (0.05, 0, 0.2), corners((-0.15, 0.25), (-0.1, 0.1), 0.1)),
        ([0.1, 0.5, 0.1], (0, 0, 0.2), corners((-0.1, 0.1), (-0.2, 0.2), 0.1)),
        ([0.3, 0.2, 0.1], (0.3, 0.2, 0.2), corners((0, 0.3), (0, 0.2), 0.1)),
    ],
)
def test_a_box_lies_on_a_box_at_the_corners_of_what_both_have_in_common(half, place, expected, depth):
    """Of the same size, smaller, a beam across it, and beyond its edges; whatever rounding leaves of the overlap."""
    a, b = ({"box": {"centre": [0, 0, 0], "half_lengths": h}} for h in (half, [0.3, 0.2, 0.1]))
    points, normals = touching(a, b, *(np.array(place) - [0, 0, depth]))
    np.testing.assert_allclose(points, expected, atol=1e-6)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 4, atol=1e-12)


def test_a_box_stands_on_its_edge_or_corner_on_another():
    """At 45 degrees on two points of an edge; on its corner at one; two edges across each other at one."""
    b = {"box": {"centre": [0, 0, 0], "half_lengths": [1, 1, 1]}}
    edge = {"box": {"centre": [0, 0, 0], "half_lengths": [0.1, 0.2, 0.1], "normal": [1, 0, 1], "along": [1, 0, -1]}}
    gap, point, frame, _ = found(two(edge, b), *at(0, 0, 1 + 0.1 * np.sqrt(2)))
    near = (gap[0] < 1e-9) & frame[0, :, 0].any(axis=1)
    assert near.any()
    np.testing.assert_allclose(point[0, near][:, [0, 2]], [[0, 1]] * near.sum(), atol=1e-9)
    tip = {"box": {"centre": [0, 0, 0], "half_lengths": [0.1] * 3, "normal": [1, 1, 1], "along": [1, -1, 0]}}
    gap, point, frame, _ = found(two(tip, b), *at(0, 0, 1.2))
    assert gap.min() > 0.0
    ridge = {"box": {"centre": [0, 0, 0], "half_lengths": [1, 1, 1], "normal": [0, 1, 1], "along": [1, 0, 0]}}
    roof = {"box": {"centre": [0, 0, 0], "half_lengths": [1, 1, 1], "normal": [1, 0, 1], "along": [0, 1, 0]}}
    gap, point, frame, names = found(two(ridge, roof), *at(0.3, 0.2, 2 * np.sqrt(2) + 0.01))
    first = names.index("touch.nearest")
    assert gap[0, first] == pytest.approx(0.01, abs=1e-12)
    np.testing.assert_allclose(point[0, first], [0, 0.2, np.sqrt(2)], atol=1e-12)
    np.testing.assert_allclose(frame[0, first, 0], [0, 0, 1], atol=1e-12)


@each("kind", ("capsule", "cylinder"))
def test_a_round_solid_lies_across_the_edges_of_a_box(kind):
    a = {kind: {"point": [0, 0, 0], "axis": [1, 0, 0], "radius": 0.1, "half_length": 1.0}}
    points, normals = touching(a, {"box": {"centre": [0, 0, 0], "half_lengths": [0.3, 0.2, 0.1]}}, 0.0, 0.0, 0.2)
    np.testing.assert_allclose(points, [[-0.3, 0, 0.1], [0.3, 0, 0.1]], atol=1e-12)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 2, atol=1e-12)


@pytest.mark.parametrize("depth", [0.0, 1e-9, 1e-6])
@each("offset", [0.02, 0.06, 0.09])
def test_a_cylinder_stands_on_a_ridge_with_its_rim(offset, depth):
    """Wherever it is on the ridge, its side is not pushed away."""
    roof = {"centre": [0, 0, -np.sqrt(2.0)], "half_lengths": [1, 1, 1], "normal": [1, 0, 1], "along": [0, 1, 0]}
    gap, _, frame, names = found(
        two({"cylinder": {**UPRIGHT, "radius": 0.1, "half_length": 0.25}}, {"box": roof}), *at(offset, 0, 0.25 - depth)
    )
    near = (gap[0] < 1e-7) & frame[0, :, 0].any(axis=1)
    assert {name.split(".")[1][:3] for name in np.array(names)[near]} == {"rim"}
    assert gap.min() == pytest.approx(-depth * np.sqrt(0.5), abs=1e-9)
    np.testing.assert_allclose(frame[0, near, 0], [[0, 0, 1]] * near.sum(), atol=1e-3)


def test_an_edge_presses_a_cylinder_from_the_side_that_its_faces_look_to():
    """No deeper than it is in the side or in the flat end, whichever is nearer; a capsule has no such end."""
    wall = {"centre": [-np.sqrt(2.0), 0, 0], "half_lengths": [1, 1, 1], "normal": [1, 1, 0], "along": [0, 0, 1]}
    for kind, depths in (("cylinder", (1e-3, 1e-3, 4e-4)), ("capsule", (1e-3, 1e-3, 1e-3))):
        for beyond, depth in zip((0.0, 0.2, 0.2496), depths, strict=True):
            shape = {kind: {"point": [0, 0, 0], "axis": [0, 1, 0], "radius": 0.1, "half_length": 0.25}}
            gap, _, frame, names = found(two(shape, {"box": wall}), *at(0.099, beyond, 0))
            edges = [i for i, name in enumerate(names) if ".edge" in name and frame[0, i, 0].any() and gap[0, i] < 0]
            assert len(edges) == 1
            assert gap[0, edges[0]] == pytest.approx(-depth, abs=1e-12)
            np.testing.assert_allclose(frame[0, edges[0], 0], [-1, 0, 0], atol=1e-12)


def test_a_cylinder_lies_and_stands_on_a_box():
    """At both ends; on three points of its rim."""
    b = {"box": {"centre": [0, 0, 0], "half_lengths": [0.3, 0.2, 0.1]}}
    lying = {"cylinder": {"point": [0, 0, 0], "axis": [1, 0, 0], "radius": 0.1, "half_length": 0.25}}
    points, normals = touching(lying, b, 0.0, 0.0, 0.2)
    np.testing.assert_allclose(points, [[-0.25, 0, 0.1], [0.25, 0, 0.1]], atol=1e-9)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 2, atol=1e-9)
    points, normals = touching({"cylinder": {**UPRIGHT, "radius": 0.1, "half_length": 0.25}}, b, 0.0, 0.0, 0.35)
    assert len(points) == 3
    np.testing.assert_allclose(points.mean(axis=0), [0, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 3, atol=1e-9)


def test_a_box_lies_on_a_plane_with_four_corners():
    box, plane = {"centre": [0, 0, 0], "half_lengths": [0.3, 0.2, 0.1]}, {"point": [0, 0, 0], "normal": [0, 0, 1]}
    points, normals = touching({"box": box}, {"plane": plane}, 0.0, 0.0, 0.1)
    np.testing.assert_allclose(points, corners((-0.3, 0.3), (-0.2, 0.2), 0.0), atol=1e-12)
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 4, atol=1e-12)


def test_a_capsule_lies_on_a_plane_with_both_ends():
    a, plane = {"capsule": {**UPRIGHT, "radius": 0.1, "half_length": 0.3}}, {"point": [0, 0, 0], "normal": [1, 0, 0]}
    points, normals = touching(a, {"plane": plane}, 0.1, 0.0, 0.0)
    np.testing.assert_allclose(points, [[0, 0, -0.3], [0, 0, 0.3]], atol=1e-12)
    np.testing.assert_allclose(normals, [[1, 0, 0]] * 2, atol=1e-12)


@each(
    ("a", "b", "contact", "key"),
    [
        ({"half_length": None}, {"half_length": None}, {}, ("contacts", "touch", "a", "cylinder", "half_length")),
        ({}, {}, {"stiffness": 5.0}, ("contacts", "touch", "stiffness")),
        ({"radius": 0.0}, {}, {}, ("contacts", "touch", "a", "cylinder", "radius")),
    ],
)
def test_what_two_cylinders_cannot_be_is_refused(a, b, contact, key):
    sides = [{**UPRIGHT, "radius": 0.1, "half_length": 0.3, **each_side} for each_side in (a, b)]
    sides = [{"cylinder": {k: v for k, v in each_side.items() if v is not None}} for each_side in sides]
    with pytest.raises(MechanismError) as caught:
        made(two(*sides, **contact))
    assert [fault.keys for fault in caught.value.faults] == [key]
