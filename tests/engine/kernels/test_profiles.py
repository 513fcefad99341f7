"""Turned and extruded solids: corners and axes from numbers one can see, and what holds whatever the profile."""

import hashlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.mechanism.contacts import Contact
from tests.counts import many
from tests.each import each
from tests.engine.kernels.shapes import Poses, brute_gap, distance, drawn, found, scattered
from tests.engine.test_determinism import fresh

KINDS = ("turned", "extruded")
ROUND = {"point": [0, 0, 0], "axis": [0, 0, 1]}
FLAT = {**ROUND, "along": [1, 0, 0]}
CONE = {"turned": {**ROUND, "start": [0, 0], "profile": [{"to": [3, -4]}, {"to": [0, -4]}]}}
BALL = {"turned": {**ROUND, "start": [0, -2], "profile": [{"to": [0, 2], "centre": [0, 0], "turn": "left"}]}}
TORUS = {"turned": {**ROUND, "start": [5, 0], "profile": [{"to": [5, 0], "centre": [4, 0], "turn": "left"}]}}
GROOVE = [{"to": [6, 1]}, {"to": [4, 1]}, {"to": [4, 2]}, {"to": [6, 2]}, {"to": [6, 3]}, {"to": [0, 3]}]
SHAFT = {"turned": {**ROUND, "start": [0, 0], "profile": [{"to": [6, 0]}, *GROOVE]}}
HOOK = {
    "extruded": {
        **FLAT,
        **{"half_length": 1, "start": [0, 0]},
        "profile": [{"to": [4, 0]}, {"to": [4, 3]}, {"to": [3, 3]}, {"to": [3, 1]}, {"to": [0, 1]}],
    }
}
WEDGE = {"extruded": {**FLAT, "start": [0, 0], "profile": [{"to": [-4, 0.1]}, {"to": [-4, -0.1]}]}}
LENS = {
    "extruded": {
        **FLAT,
        **{"start": [0, -3]},
        "profile": [
            {"to": [0, 3], "centre": [-4, 0], "turn": "left"},
            {"to": [0, -3], "centre": [4, 0], "turn": "left"},
        ],
    }
}
ROOT = np.sqrt(0.5)


def against(a: Any, b: Any) -> Contact:
    """Return a contact of two primitives."""
    return Contact.model_validate({"a": {"body": "a", **a}, "b": {"body": "b", **b}, "friction": 0.1})


def at(*places: Any) -> Poses:
    """Place body a at points of the world; both bodies stand upright, b at the origin."""
    n = len(places)
    return Poses((np.array(places, float), np.zeros((n, 3))), (np.tile(np.eye(3), (n, 1, 1)),) * 2)


POINT = {"point": [0, 0, 0]}
HEIGHTS = [
    (CONE, (0, 0, 1), 1, (0, 0, 1)),  # over the tip
    (CONE, (0.3, 0, 0.4), 0.5, (0.6, 0, 0.8)),  # from the tip
    (CONE, (4, 0, -2), 2, (0.8, 0, 0.6)),  # from the flank
    (CONE, (0, 0, -3.75), -0.25, (0, 0, -1)),  # on the axis, nearer to the base than to the flank
    (CONE, (0, 3.3, -4.4), 0.5, (0, 0.6, -0.8)),  # from the rim
    (BALL, (0, 0, 3), 1, (0, 0, 1)),
    (BALL, (1.2, 0, 1.6), 0, (0.6, 0, 0.8)),
    (BALL, (0.3, 0.4, 0), -1.5, (0.6, 0.8, 0)),
    (TORUS, (0, 0, 0), 3, None),
    (TORUS, (4, 0, 3), 2, (0, 0, 1)),
    (TORUS, (1, 0, 0), 2, (-1, 0, 0)),
    (SHAFT, (5, 0, 1.25), 0.25, (0, 0, 1)),  # in the groove
    (SHAFT, (4.25, 0, 1.5), 0.25, (1, 0, 0)),
    (SHAFT, (6.5, 0, 1.5), ROOT, (ROOT, 0, None)),  # before its mouth, as far from both edges
    (HOOK, (1, 1.5, 0), 0.5, (0, 1, 0)),
    (HOOK, (2.75, 2, 0.5), 0.25, (-1, 0, 0)),
    (HOOK, (3.5, 2, 1.5), 0.5, (0, 0, 1)),
    (HOOK, (-0.3, 0.5, -1.4), 0.5, (-0.6, 0, -0.8)),
    (HOOK, (2, 0.5, 0.75), -0.25, (0, 0, 1)),  # out at the nearer end
    (HOOK, (3.1, 0.9, 0), -np.hypot(0.1, 0.1), (-ROOT, ROOT, 0)),  # from the inner corner
    (WEDGE, (0.3, 0.4, 7), 0.5, (0.6, 0.8, 0)),  # round a sharp tip, on every side
    (WEDGE, (0.5, 0, 0), 0.5, (1, 0, 0)),
    (WEDGE, (0.3, -0.4, 7), 0.5, (0.6, -0.8, 0)),
    (LENS, (2, 0, 0), 1, (1, 0, 0)),
    (LENS, (0, 4, 0), 1, (0, 1, 0)),
    (LENS, (0, 0, 0), -1, None),
]


@each(("b", "place", "gap", "normal"), HEIGHTS)
def test_a_point_round_every_corner(b, place, gap, normal):
    g, point, frame = found(against(POINT, b), at(place))
    assert g[0] == pytest.approx(gap, abs=1e-15)
    np.testing.assert_allclose(frame[0] @ frame[0].T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(point[0], place - gap * frame[0, 0], atol=1e-15)
    for mine, theirs in zip(frame[0, 0], normal or (), strict=bool(normal)):
        assert theirs is None or mine == pytest.approx(theirs, abs=1e-15)


def test_a_ring_centred_in_a_groove_has_one_gap_all_along():
    """Two walls as near as each other, all round: the least distance at once, and the same a hair away."""
    ring = {"arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 5.0}}
    for off in (0.0, 1e-12, 1e-6):
        gap, _, frame = found(against(ring, SHAFT), at((0, 0, 1.5 + off), (off, 0, 1.5)))
        np.testing.assert_allclose(gap, [0.5 - off, 0.5 - off * (off > 1e-6)], atol=1e-12)
        np.testing.assert_allclose(np.abs(frame[:, 0, 2]), 1, atol=1e-12)


def test_teeth_finer_than_any_cell_are_found():
    """A circle in a ring of 60 teeth, of which one is 1e-6 higher: the distance from that tooth."""
    angles = np.arange(120) * np.pi / 60
    radii = np.where(np.arange(120) % 2, 2.0, 1.9)
    radii[77] += 1e-6
    points = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1).tolist()
    wheel = {"extruded": {**FLAT, "start": points[0], "profile": [{"to": p} for p in points[1:]]}}
    ring = {"arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 2.5}}
    gap, point, frame = found(against(ring, wheel), at((0, 0, 0)))
    assert gap[0] == pytest.approx(0.5 - 1e-6, abs=1e-12)
    np.testing.assert_allclose(point[0], [*points[77], 0], atol=1e-12)
    np.testing.assert_allclose(frame[0, 0, :2], np.array(points[77]) / radii[77], atol=1e-6)


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=many(60), deadline=None)
@given(seeds, st.sampled_from(KINDS), st.sampled_from(["point", "arc"]), st.floats(-9, 0.5))
def test_a_gap_changes_no_faster_than_the_point_moves(seed, kind, first, size):
    """A shift of side a changes the gap by at most its length: 1-Lipschitz, inside and outside, far and near."""
    rng = np.random.default_rng(seed)
    contact, poses = drawn(f"{first}-{kind}", rng), scattered(20, rng, 0.7)
    shift = 10**size * rng.normal(size=(20, 3))
    there = Poses((poses.x[0] + shift, poses.x[1]), poses.R)
    change = np.abs(found(contact, there)[0] - found(contact, poses)[0])
    assert np.all(change <= np.linalg.norm(shift, axis=1) + 1e-12)


@settings(max_examples=many(60), deadline=None)
@given(seeds, st.sampled_from(KINDS))
def test_the_sign_changes_where_the_surface_is_passed(seed, kind):
    """From outside towards the nearest point the gap is the height, down to 1e-9; on the surface 0; beyond it negative.

    Beyond a corner sharper than a right angle the way may lead out again through the other face.
    """
    rng = np.random.default_rng(seed)
    contact, every = drawn(f"point-{kind}", rng), scattered(20, rng, 0.7)
    outside = found(contact, every)[0] + contact.offset > 1e-3
    poses = Poses(tuple(x[outside] for x in every.x), tuple(R[outside] for R in every.R))
    gap, _, frame = found(contact, poses)
    for height in (1e-3, 1e-6, 1e-9, 0.0, -1e-9, -1e-6):
        shift = (height - gap - contact.offset)[:, None] * frame[:, 0]
        there = Poses((poses.x[0] + shift, poses.x[1]), poses.R)
        now, _, normal = found(contact, there)
        now += contact.offset
        assert np.all(np.abs(now) <= abs(height) + 1e-14)
        if height > 0:
            np.testing.assert_allclose(now, height, rtol=0, atol=1e-14)
            np.testing.assert_allclose(normal[:, 0], frame[:, 0], atol=1e-13 / height)
        elif height < 0:
            on_face = np.einsum("ni,ni->n", normal[:, 0], frame[:, 0]) > 1 - 1e-9
            np.testing.assert_allclose(now[on_face], height, rtol=0, atol=1e-14)


@settings(max_examples=many(30), deadline=None)
@given(seeds, st.sampled_from(KINDS))
def test_the_sign_is_what_counting_says(seed, kind):
    """Inside is where a ray leaves the profile an odd number of times, also close to corners and joints."""
    rng = np.random.default_rng(seed)
    contact = drawn(f"point-{kind}", rng)
    corners = [p for piece in contact.sides[1].primitive.curve for p in (piece.start, piece.point(0.5))]
    shape = contact.sides[1].primitive
    z = np.array(shape.axis)
    x = np.array(getattr(shape, "along", None) or np.cross(z, np.eye(3)[np.argmin(np.abs(z))]))
    x = x / np.linalg.norm(x)
    up = z if kind == "turned" else np.cross(z, x)
    place = np.array([shape.point + p.real * x + p.imag * up for p in corners])
    spread = 10 ** rng.uniform(-7, -1, (len(place), 1)) * rng.normal(size=place.shape)
    poses = at(*(place + spread - np.asarray(contact.sides[0].primitive)))
    ours, theirs = found(contact, poses)[0] + contact.offset, distance(contact, place + spread)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def digest() -> str:
    """Hash gaps, points and frames of many poses, bit for bit."""
    rng, words = np.random.default_rng(5), hashlib.sha256()
    for first in ("point", "arc"):
        for kind in KINDS:
            for array in found(drawn(f"{first}-{kind}", rng), scattered(50, rng, 0.7)):
                words.update(array.tobytes())
    return words.hexdigest()


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.bits
def test_same_bits_in_other_processes():
    here = digest()
    code = "from tests.engine.kernels.test_profiles import digest; print(digest())"
    assert [fresh(code), fresh(code, PYTHONHASHSEED="7", OPENBLAS_NUM_THREADS="2")] == [here, here]


def test_arcs_across_profiles_by_brute_force():
    """More profiles than the pairs' own test draws, where an arc is nearest at corners, joints and ends."""
    rng = np.random.default_rng(8)
    for kind in KINDS:
        for _ in range(4):
            contact, poses = drawn(f"arc-{kind}", rng), scattered(20, rng, 0.4)
            np.testing.assert_allclose(found(contact, poses)[0], brute_gap(contact, poses), atol=1e-9, rtol=0)
