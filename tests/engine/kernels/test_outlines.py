"""Two extruded profiles: their gap by brute force, and the points of edges on edges from numbers one can see."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.assembly import assemble
from engine.errors import EngineError, MechanismError
from engine.kernels.contact_geometry.gaps import find_contacts
from tests.counts import many
from tests.each import each
from tests.engine.kernels.profile_shapes import drawn_profile, pieces, profile_gap, spanned
from tests.engine.small import made, small

Array = np.ndarray
FLAT = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0]}
SQUARE = {"start": [-1, -1], "profile": [{"to": [1, -1]}, {"to": [1, 1]}, {"to": [-1, 1]}]}
DISC = {"start": [1, 0], "profile": [{"to": [1, 0], "centre": [0, 0], "turn": "left"}]}
GROOVE = {
    "start": [-3, -2],
    "profile": [{"to": p} for p in ([3, -2], [3, 2], [1.25, 2], [1.25, 0], [-1.25, 0], [-1.25, 2], [-3, 2])],
}


def two(one: Any, other: Any, a: Any = None, b: Any = None, **contact: Any) -> dict[str, Any]:
    """Describe two free bodies with a profile each; ``a`` and ``b`` are more keys of the bodies."""
    return small(
        bodies={
            "ground": {"fixed": True},
            "a": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], **(a or {})},
            "b": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], **(b or {})},
        },
        contacts={
            "touch": {
                "a": {"body": "a", "extruded": {**FLAT, **one}},
                "b": {"body": "b", "extruded": {**FLAT, **other}},
                "friction": 0.1,
                **contact,
            }
        },
    )


def placed(x: float, y: float, angle: float = 0.0) -> dict[str, Any]:
    return {"origin": [x, y, 0.0], "axis": [0, 0, 1], "angle": angle}


def found(data: dict[str, Any], poses: Array) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Return gaps (n, nc), points and frames of the contacts with a at (n, 3) poses x, y, angle; b stays."""
    assembly = assemble(made(data))
    state, contacts = assembly.state, assembly.model.contacts
    moving = int(contacts.a[0])
    x, R, nc = state.x.copy(), state.R.copy(), len(assembly.contact_names)
    gap, point, frame = np.zeros((len(poses), nc)), np.zeros((len(poses), nc, 3)), np.zeros((len(poses), nc, 3, 3))
    for i, (u, v, angle) in enumerate(poses):
        x[moving], R[moving] = [u, v, 0.0], Rotation.from_rotvec([0, 0, angle]).as_matrix()
        find_contacts(contacts, x, R, gap[i], point[i], frame[i])
    return gap, point, frame, assembly.contact_names


def outline_points(profile: Any, count: int) -> Array:
    """Return points along an outline, (m, 2)."""
    share, along = np.linspace(0, 1, count), []
    for start, end, centre, way in pieces(profile["start"], profile["profile"]):
        if centre is None:
            along.append(start + share[:, None] * (end - start))
        else:
            radius, first, span = spanned(start, end, centre, way)
            angle = first + way * span * share
            along.append(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(along)


@settings(max_examples=many(25), deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_smallest_gap_is_the_distance_of_the_outlines(seed):
    """At random poses apart: by the distances of many points of each outline from the other, which are a bit larger."""
    rng = np.random.default_rng(seed)
    one, other = drawn_profile("extruded", rng), drawn_profile("extruded", rng)
    a, b = (outline_points(each, 400) for each in (one, other))
    turns = rng.uniform(-np.pi, np.pi, 40)
    poses = np.column_stack([rng.uniform(-2.5, 2.5, (40, 2)), turns])
    gap, *_ = found(two(one, other, placed(9, 0)), poses)
    checked = 0
    for (x, y, turn), own in zip(poses, gap, strict=True):
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        brute = min(
            profile_gap(pieces(other["start"], other["profile"]), a @ rotation.T + [x, y], axis=False).min(),
            profile_gap(pieces(one["start"], one["profile"]), (b - [x, y]) @ rotation, axis=False).min(),
        )
        if brute > 0:
            checked += 1
            assert brute - 1e-2 <= own.min() <= brute + 1e-12
        else:
            assert own.min() < 0.25, "thin bars that cross have no corner inside each other"
    assert checked > 5


def test_an_edge_on_an_edge_touches_at_both_ends():
    """A square shifted on a square: a corner and the middle of each, all normals along the edges', nothing else."""
    gap, point, frame, names = found(two(SQUARE, SQUARE, placed(9, 0)), np.array([[0.5, 2.0, 0.0]]))
    near = np.flatnonzero(np.abs(gap[0]) < 1e-12)
    np.testing.assert_allclose(sorted(point[0, near, 0]), [-0.5, 0.0, 0.5, 1.0], atol=1e-15)
    up = np.array([1.0 if "_a" in names[i] else -1.0 for i in near])
    np.testing.assert_allclose(frame[0, near, 0] * up[:, None], np.tile([0, 1, 0], (4, 1)), atol=1e-15)


@pytest.mark.parametrize("depth", [1e-9, 0.0, -1e-9])
def test_edges_of_the_same_length_touch_although_their_corners_have_no_normal(depth):
    """Square over square: whatever rounding leaves of the overlap, the middles press apart, no corner sideways."""
    gap, _, frame, names = found(two(SQUARE, SQUARE, placed(9, 0)), np.array([[0.0, 2.0 - depth, 0.0]]))
    pressing = [i for i, N in enumerate(frame[0, :, 0]) if N.any() and gap[0, i] < 1e-6]
    assert {names[i] for i in pressing} >= {"touch.edge_a0", "touch.edge_b2"}
    np.testing.assert_allclose(np.abs(frame[0, pressing, 0, 1]), 1.0, atol=1e-6)
    np.testing.assert_allclose(gap[0, pressing], -depth, atol=1e-12)


@pytest.mark.parametrize("depth", [1e-9, -1e-9])
def test_a_corner_passes_a_corner_while_its_edge_slides(depth):
    """A square beside a square, a hair higher and coming down: no face holds it up, as it has slid past that corner."""
    gap, _, frame, _ = found(two(SQUARE, GROOVE, placed(9, 0)), np.array([[4.0 - depth, 1.0 + 1e-6, 0.0]]))
    pressing = frame[0, gap[0] < 1e-3, 0]
    assert len(pressing)
    assert np.all(np.abs(pressing[:, 1]) < 1e-2)


def test_a_tooth_in_a_gap_touches_on_both_sides():
    """A square 2 wide in a groove of 2.5: its lower corners are as near to both walls as the rims are to its sides."""
    gap, _, frame, names = found(two(SQUARE, GROOVE, placed(9, 0)), np.array([[0.0, 1.5, 0.0]]))
    lower = [names.index(f"touch.corner_a{i}") for i in (0, 1)]
    np.testing.assert_allclose(gap[0, lower], 0.25, atol=1e-15)
    np.testing.assert_allclose(frame[0, lower, 0], [[1, 0, 0], [-1, 0, 0]], atol=1e-15)
    rims = [i for i, name in enumerate(names) if "corner_b" in name and abs(gap[0, i]) < 0.3]
    np.testing.assert_allclose(gap[0, rims], [0.25, 0.25], atol=1e-15)


def test_two_discs_touch_where_their_centres_say():
    poses = np.array([[2.5 * np.cos(t), 2.5 * np.sin(t), 7 * t] for t in np.linspace(0, 6, 13)])
    gap, point, frame, names = found(two(DISC, DISC, placed(9, 0)), poses)
    assert names == ("touch.arc_a0", "touch.arc_b0")
    np.testing.assert_allclose(gap, 0.5, atol=1e-14)
    towards = poses[:, :2] / 2.5
    np.testing.assert_allclose(frame[:, 0, 0, :2], towards, atol=1e-14)
    np.testing.assert_allclose(frame[:, 1, 0, :2], -towards, atol=1e-14)
    np.testing.assert_allclose(point[:, 0, :2], towards, atol=1e-13)


@settings(max_examples=many(25), deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_gaps_change_no_faster_than_the_bodies_move(seed):
    """1-Lipschitz, also past corners, but for the shallow depth that is added to the gap of what passes by."""
    rng = np.random.default_rng(seed)
    data = two(drawn_profile("extruded", rng), drawn_profile("extruded", rng), placed(9, 0))
    poses = np.column_stack([rng.uniform(-2, 2, (20, 2)), rng.uniform(-3, 3, 20)])
    shift = 10 ** rng.uniform(-6, 0, (20, 1)) * rng.normal(size=(20, 2))
    before, after = found(data, poses)[0], found(data, poses + np.column_stack([shift, np.zeros(20)]))[0]
    assert np.all(np.abs(after - before).max(axis=1) <= np.linalg.norm(shift, axis=1) + 1e-4)


def test_the_plane_of_contact_is_in_the_middle_of_the_common_depth():
    """From 1 to 4 and, upside down, from 3 to 7: at 3.5; without ends in the plane of side a."""
    one, other = {**SQUARE, "point": [0, 0, 2.5], "half_length": 1.5}, {**SQUARE, "point": [0, 0, 0], "half_length": 2}
    data = two(one, other, placed(2.5, 0), {"origin": [0, 0, 5], "axis": [1, 0, 0], "angle": np.pi})
    _, point, frame, names = found(data, np.array([[2.5, 0.0, 0.0]]))
    assert len(names) == 16
    np.testing.assert_allclose(point[0, :, 2], 3.5, atol=1e-14)
    assert len(frame[0].any(axis=(1, 2)).nonzero()[0]) >= 2
    del data["contacts"]["touch"]["a"]["extruded"]["half_length"], data["contacts"]["touch"]["b"]["extruded"]
    data["contacts"]["touch"]["b"]["extruded"] = {**FLAT, **SQUARE}
    np.testing.assert_allclose(found(data, np.array([[2.5, 0.0, 0.0]]))[1][0, :, 2], 2.5, atol=1e-14)


@each(
    ("b", "contact", "key"),
    [
        ({"axis": [1, 0, 0], "angle": 0.01}, {}, ("contacts", "touch", "b", "extruded", "axis")),
        ({"origin": [0, 0, 2.5]}, {}, ("contacts", "touch", "b", "extruded", "half_length")),
        ({}, {"stiffness": 5.0}, ("contacts", "touch", "stiffness")),
        ({}, {"hertz_stiffness": 5.0}, ("contacts", "touch", "hertz_stiffness")),
    ],
)
def test_what_cannot_touch_is_refused(b, contact, key):
    """Inclined, beside each other, with a stiffness."""
    profile = {**SQUARE, "half_length": 1.0}
    with pytest.raises(MechanismError) as caught:
        assemble(made(two(profile, profile, {"origin": [3, 0, 0]}, b, **contact)))
    assert [fault.keys for fault in caught.value.faults] == [key]


def test_an_overlap_that_no_pose_nearby_resolves_names_the_contact():
    data = two(SQUARE, SQUARE)
    data["bodies"]["a"] = {"fixed": True, "origin": [1.5, 0, 0]}
    ends = {side: {"body": body, "point": [0, 0, 0]} for side, body in (("a", "ground"), ("b", "b"))}
    data["joints"] = {"weld": {"type": "fixed", **ends}}
    with pytest.raises(EngineError, match=r"(?s)contacts\.touch: .*\(contacts\.touch\)") as caught:
        assemble(made(data))
    assert "touch." not in str(caught.value), "of its points"
    assert "stiffness" not in str(caught.value), "which it cannot have"
