"""Gaps, points and frames of every pair of primitives against brute force, at thousands of random poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly.contacts import rows
from engine.kernels.vectors import BACK
from engine.mechanism.contacts import PAIRS, Contact
from tests.counts import many
from tests.each import each
from tests.engine.kernels.shapes import OWN, Poses, brute_gap, distance, drawn, found, scattered, twists

CONTACTS = 5  # drawn of each pair
POSES = many(400)  # of each of them


def cases_of(pair: str) -> tuple[list[tuple[Contact, Poses]], np.random.Generator]:
    """Return contacts of a pair of primitives, with random poses each, and the random generator."""
    rng = np.random.default_rng(PAIRS.index(pair))
    return [(drawn(pair, rng), scattered(POSES, rng, 0.7)) for _ in range(CONTACTS)], rng


def reach(contact: Contact) -> float:
    """Return how far from the origin of its body side a reaches."""
    shape = contact.sides[0].primitive
    at = getattr(shape, "centre", getattr(shape, "point", shape))
    return float(np.linalg.norm(at) + (shape.radius if contact.sides[0].kind in ("arc", "cylinder") else 0.0))


def outside(contact: Contact, gap: np.ndarray) -> np.ndarray:
    """Say where side a's arc, without its skin, is not inside b. Inside, it may be deepest between two faces."""
    if contact.sides[0].kind not in ("arc", "cylinder") or contact.sides[1].kind in ("plane", "sphere", "socket"):
        return np.ones(gap.shape, bool)
    return gap + getattr(contact.sides[0].primitive, "edge_radius", 0.0) + contact.offset > 0


def point_speed(poses: Poses, point: np.ndarray, twist: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the velocity of body a relative to body b at points of the world, shape (n, 3)."""
    at = [
        v[:, :3] + np.cross(np.einsum("nij,nj->ni", R, v[:, 3:]), point - x)
        for x, R, v in zip(poses.x, poses.R, twist, strict=True)
    ]
    return at[0] - at[1]


@each("cases", PAIRS, cases_of)
def test_gap_is_the_least_distance(cases):
    """The engine's gap is that found by searching the drawn features, whatever the pose: at every second one."""
    for contact, every in cases[0]:
        poses = Poses(tuple(x[::2] for x in every.x), tuple(R[::2] for R in every.R))
        np.testing.assert_allclose(found(contact, poses)[0], brute_gap(contact, poses), atol=1e-9, rtol=0)


@each("cases", PAIRS, cases_of)
def test_point_lies_on_b_and_the_gap_is_measured_from_it(cases):
    """The common point is on the surface of b, and one gap further along N that is the distance from b."""
    for contact, poses in cases[0]:
        gap, point, frame = found(contact, poses)
        if contact.kind == "ring-cylinder":
            continue  # the ring's own surface is not a distance from b

        skin = getattr(contact.sides[0].primitive, "edge_radius", 0.0)
        skin += contact.sides[0].primitive.radius if contact.sides[0].kind in ("sphere", "ring") else 0.0
        counts, height = outside(contact, gap), gap + skin + contact.offset
        for over in (np.zeros(POSES), height):
            world = point + over[:, None] * frame[:, 0] - poses.x[1]
            above = distance(contact, np.einsum("nji,nj->ni", poses.R[1], world))
            np.testing.assert_allclose(above[counts], over[counts], atol=1e-9)


@each("cases", PAIRS, cases_of)
def test_normal_velocity_is_the_rate_of_the_gap(cases):
    """N . u at the common point against the central difference, but where the gap has a kink."""
    dt, kinks, total = 1e-6, 0, 0
    for contact, poses in cases[0]:
        twist = twists(POSES, cases[1])
        gap, point, frame = found(contact, poses)
        after, before = found(contact, poses.moved(twist, dt))[0], found(contact, poses.moved(twist, -dt))[0]
        smooth = (np.abs(after - 2 * gap + before) < 1e-3 * dt) & outside(contact, gap)
        rate = np.einsum("ni,ni->n", frame[:, 0], point_speed(poses, point, twist))
        np.testing.assert_allclose(((after - before) / (2 * dt))[smooth], rate[smooth], atol=1e-6)
        kinks, total = kinks + np.sum(~smooth & outside(contact, gap)), total + POSES
    assert kinks <= 0.02 * total


@each("cases", PAIRS, cases_of)
def test_gap_changes_no_faster_than_the_features_move(cases):
    """However far: shifting b and turning a about its origin changes the gap by at most their longest way."""
    for contact, poses in cases[0]:
        size = 10 ** cases[1].uniform(-6, 0.5, POSES)
        shift = size[:, None] * cases[1].normal(size=(POSES, 3))
        vector = size[:, None] * cases[1].normal(size=(POSES, 3))
        turn = Rotation.from_rotvec(vector).as_matrix()
        there = Poses((poses.x[0], poses.x[1] + shift), (turn @ poses.R[0], poses.R[1]))
        way = np.linalg.norm(shift, axis=1)
        way += 2 * np.abs(np.sin(np.minimum(np.linalg.norm(vector, axis=1), np.pi) / 2)) * reach(contact)
        assert np.all(np.abs(found(contact, there)[0] - found(contact, poses)[0]) <= way + 1e-12)


@each("cases", PAIRS, cases_of)
def test_frame_is_orthonormal_and_right_handed(cases):
    """Rows N, T1, T2 with N x T1 = T2."""
    for contact, poses in cases[0]:
        frame = found(contact, poses)[2]
        np.testing.assert_allclose(
            frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-11
        )
        np.testing.assert_allclose(np.cross(frame[:, 0], frame[:, 1]), frame[:, 2], atol=1e-11)


def seen_from_b(poses: Poses, point: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 3) and frames (n, 3, 3) in the axes of body b."""
    x, R = poses.x[1], poses.R[1]
    return np.einsum("nji,nj->ni", R, point - x), np.einsum("nkj,nji->nki", frame, R)


def most_turned(contact: Contact, p: np.ndarray, n: np.ndarray, dp: np.ndarray, dn: np.ndarray) -> np.ndarray:
    """Return the largest angle, (n,), by which a frame may turn in b's axes, from places, normals and their changes.

    On what is round about an axis it turns with N in the plane through the axis, and with this plane about the axis. On
    planes and around a ring it turns with N. Elsewhere the shortest rotation from a pole to N carries it. Where N is at
    an angle of theta from the pole, and moves around it, this rotation adds a turn about N of tan(theta / 2) times the
    change of N. With the turn of N itself, that is 1 / cos(theta / 2) times the change, and 2 cos(theta / 2) is the
    length of pole + N. At the pole's opposite this has no bound: no tangent field is continuous all over a ball. So
    nearer to it than `BACK` tells, the tangent is not carried, and leans from the plane across N by less than 1e-3.
    """
    kind, shape = contact.sides[1].kind, contact.sides[1].primitive
    change = np.linalg.norm(dn, axis=1) * (1.0 + 1e-8)  # an arc over its chord
    if kind in ("cylinder", "bore", "turned", "capsule"):
        rho, n_rho = (np.linalg.norm(np.cross(v, shape.axis), axis=1) for v in (p - shape.point, n))
        on_axis = rho < 1e-9  # the tip of a cone: only N says where the plane is
        about = np.where(on_axis, change, np.linalg.norm(dp, axis=1)) / np.where(on_axis, n_rho, rho)
        return change + about
    pole = rows(contact, OWN, OWN)[1][3:6]
    length = np.linalg.norm(pole + n, axis=1)
    return change * np.where(length**2 > BACK, 2.0 / np.maximum(length - change, 1e-300), 1.01)


@each("cases", PAIRS, cases_of)
def test_tangents_turn_no_more_than_normal_and_body(cases):
    """Along a smooth motion T1 does not flip: it turns with body b, with N, and on what is round with the radius.

    Left out are jumps of the nearest point or of N from one place to another.
    """
    dt = 1e-7
    for contact, poses in cases[0]:
        moved = poses.moved(twists(POSES, cases[1]), dt)
        p0, f0 = seen_from_b(poses, *found(contact, poses)[1:])
        p1, f1 = seen_from_b(moved, *found(contact, moved)[1:])
        dp, dn = p1 - p0, f1[:, 0] - f0[:, 0]
        counts = (np.linalg.norm(dp, axis=1) < 1e-4) & (np.linalg.norm(dn, axis=1) < 1e-4)
        turned = np.linalg.norm(f1 - f0, axis=(1, 2), ord=2)
        assert np.all((turned <= most_turned(contact, p0, f0[:, 0], dp, dn) * (1.0 + 1e-6) + 1e-12)[counts])
        assert counts.mean() > 0.5


def made(a: dict, b: dict) -> Contact:
    """Return a contact of two primitives."""
    return Contact.model_validate({"a": {"body": "a", **a}, "b": {"body": "b", **b}, "friction": 0.1})


def placed(*at: tuple[float, float, float], turn: Rotation | None = None) -> Poses:
    """Place body a at points of the world, turned or not; body b stays at the origin."""
    n, R = len(at), np.eye(3) if turn is None else turn.as_matrix()
    return Poses((np.array(at, float), np.zeros((n, 3))), (np.tile(R, (n, 1, 1)), np.tile(np.eye(3), (n, 1, 1))))


def elsewhere(poses: Poses, rng: np.random.Generator) -> Poses:
    """Return both bodies moved and turned together."""
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    x, R = [x @ turn.T + shift for x in poses.x], [turn @ R for R in poses.R]
    return Poses((x[0], x[1]), (R[0], R[1]))


POINT = {"point": [0, 0, 0]}
CIRCLE = {"arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.5}}
FACE = {"centre": [0, 0, 0], "normal": [0, 0, 1]}
DISC = {"disc": {**FACE, "radius": 2, "depth": 0.5}}
RECTANGLE = {"rectangle": {**FACE, "along": [1, 0, 0], "half_lengths": [2, 1], "depth": 0.5}}
PIN = {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 1}
BALL = {"centre": [0, 0, 0], "radius": 1}

HEIGHTS = [
    (DISC, (0.5, 0.2, 0.3), 0.3, (0, 0, 1)),  # over the face
    (DISC, (0.5, 0.2, -0.1), -0.1, (0, 0, 1)),  # in it: its height
    (DISC, (0.5, 0.2, -0.4), -0.1, (0, 0, -1)),  # beyond half its depth: out at the back
    (DISC, (0.5, 0.2, -0.7), 0.2, (0, 0, -1)),  # behind it
    (DISC, (2.3, 0.0, 0.4), 0.5, (0.6, 0, 0.8)),  # beside and above: from the rim
    (DISC, (0.0, 2.3, -0.2), 0.3, (0, 1, 0)),  # beside
    (DISC, (0.0, 0.0, -0.2), -0.2, (0, 0, 1)),  # on its axis
    (RECTANGLE, (1.9, 0.8, 0.1), 0.1, (0, 0, 1)),
    (RECTANGLE, (2.3, 0.8, 0.4), 0.5, (0.6, 0, 0.8)),  # over the edge
    (RECTANGLE, (2.1, -1.2, 0.2), 0.3, (1 / 3, -2 / 3, 2 / 3)),  # over the corner
    (RECTANGLE, (1.9, 0.95, -0.2), -0.05, (0, 1, 0)),  # deeper than far from the edge: out at the side
    ({"cylinder": {**PIN, "half_length": 2}}, (1.3, 0, 2.4), 0.5, (0.6, 0, 0.8)),
    ({"cylinder": {**PIN, "half_length": 2}}, (0, 0, 2.4), 0.4, (0, 0, 1)),
    ({"cylinder": PIN}, (0, 0, 7.0), -1, None),  # on the axis: any direction
    ({"bore": PIN}, (0, 0, 7.0), 1, None),
    ({"bore": PIN}, (0.9, 0, 7.0), 0.1, (-1, 0, 0)),
    ({"bore": {**PIN, "half_length": 2}}, (0.7, 0, 2.4), 0.5, (-0.6, 0, 0.8)),  # before the mouth: from the rim
    ({"bore": {**PIN, "half_length": 2}}, (1.5, 0, 2.4), 0.4, (0, 0, 1)),  # over the plate
    ({"sphere": BALL}, (0, 0, 0), -1, None),
    ({"socket": BALL}, (0, 0, 0), 1, None),
    ({"socket": BALL}, (0, 0.75, 0), 0.25, (0, -1, 0)),
]


@each(("b", "at", "gap", "normal"), HEIGHTS)
def test_a_point_round_every_edge(b, at, gap, normal):
    """Faces, edges, corners, backs and axes of the solids, from numbers one can see."""
    g, _, frame = found(made(POINT, b), placed(at))
    assert g[0] == pytest.approx(gap, abs=1e-15)
    np.testing.assert_allclose(frame[0] @ frame[0].T, np.eye(3), atol=1e-15)
    if normal is not None:
        np.testing.assert_allclose(frame[0, 0], normal, atol=1e-15)


UPRIGHT = Rotation.identity()
LYING = Rotation.from_euler("x", 90, degrees=True)
SYMMETRIC = [
    (CIRCLE, DISC, (0, 0, 0.3), UPRIGHT, 0.3),  # flat over the face
    (CIRCLE, RECTANGLE, (0, 0, -0.1), UPRIGHT, -0.1),
    (CIRCLE, {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, (0, 0, 0.3), UPRIGHT, 0.3),
    (CIRCLE, {"bore": PIN}, (0, 0, 3), UPRIGHT, 0.5),  # concentric
    (CIRCLE, {"cylinder": PIN}, (0, 0, 3), UPRIGHT, -0.5),
    (CIRCLE, {"cylinder": PIN}, (3, 0, 0), LYING, 1.5),
    (CIRCLE, {"cylinder": PIN}, (0, 3, 0), LYING, 2.0),  # its flat to the axis: two nearest points, no, all of a line
    (CIRCLE, {"cylinder": PIN}, (0, 0, 0), LYING, -1.0),  # through the axis
    (CIRCLE, {"socket": BALL}, (0, 0, 0), UPRIGHT, 0.5),
    (CIRCLE, {"sphere": BALL}, (0, 0, 0), UPRIGHT, -0.5),
    ({"cylinder": PIN}, {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, (0, 0, 0.7), UPRIGHT, 0.7),
    ({"cylinder": PIN}, {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}, (0, 0, 0.7), LYING, -0.3),
    ({"cylinder": PIN}, RECTANGLE, (0, 0, 1.25), LYING, 0.25),
    ({"ring": {"centre": [0, 0, 0], "radius": 1.5}}, {"cylinder": PIN}, (0, 0, 3), UPRIGHT, 0.5),
    ({"ring": {"centre": [0, 0, 0], "radius": 0.5}}, {"bore": PIN}, (0, 0, 3), UPRIGHT, 0.5),
    ({"sphere": {"centre": [0, 0, 0], "radius": 0.5}}, {"sphere": BALL}, (0, 0, 0), UPRIGHT, -1.5),
    ({"sphere": {"centre": [0, 0, 0], "radius": 0.9}}, {"socket": BALL}, (0.05, 0, 0), UPRIGHT, 0.05),
]


@each(("a", "b", "at", "turn", "gap"), SYMMETRIC)
def test_concentric_parallel_and_on_the_axis(a, b, at, turn, gap):
    """Where many points are nearest: the right gap, a whole frame, and the same a hair away from it, anyhow turned."""
    rng = np.random.default_rng(3)
    contact = made(a, b)
    assert found(contact, placed(at, turn=turn))[0] == pytest.approx(gap, abs=1e-15)
    for size in (0.0, 1e-300, 1e-160, 1e-17, 1e-12, 1e-9, 1e-6):
        shift, vector = size * rng.normal(size=(2, 3))
        poses = placed(np.array(at) + shift, turn=Rotation.from_rotvec(vector) * turn)
        for view in (poses, elsewhere(poses, rng)):
            g, point, frame = found(contact, view)
            assert g[0] == pytest.approx(gap, abs=10 * size + 1e-14)
            assert np.all(np.isfinite(point))
            np.testing.assert_allclose(frame[0] @ frame[0].T, np.eye(3), atol=1e-11)


HOLE = {"start": [2, -1], "profile": [{"to": [2, 1]}, {"to": [1, 1]}, {"to": [1, -1]}, {"to": [2, -1]}]}
UNDECIDED = [case for case in SYMMETRIC if (case[1].keys(), case[3]) != ({"cylinder"}, LYING)]  # these have two
UNDECIDED.append((POINT, {"turned": {"point": [0, 0, 0], "axis": [0, 0, 1], **HOLE}}, (0, 0, 0), UPRIGHT, 1))


@each(("a", "b", "at", "turn", "gap"), UNDECIDED)
def test_rounding_chooses_no_direction(a, b, at, turn, gap):
    """Where many points are nearest, anywhere in the world: point and frame that are tied to the bodies."""
    rng, contact, poses = np.random.default_rng(5), made(a, b), placed(at, turn=turn)
    _, point, frame = found(contact, poses)
    for size in (0.0, 1e-17, 1e-14):
        away, tilt = size * rng.normal(size=(2, 3))
        moved = placed(np.array(at) + away, turn=Rotation.from_rotvec(tilt) * turn)
        whole, shift = Rotation.random(random_state=rng).as_matrix(), 10 * rng.normal(size=3)
        view = Poses(tuple(x @ whole.T + shift for x in moved.x), tuple(whole @ R for R in moved.R))
        _, there, turned = found(contact, view)
        np.testing.assert_allclose(turned[0], frame[0] @ whole.T, rtol=0, atol=1e-9)
        np.testing.assert_allclose(there[0], whole @ point[0] + shift, rtol=0, atol=1e-9)


def test_frame_behind_a_plate_is_whole():
    """Where its tangent cannot be carried to: N almost or exactly against the face's normal."""
    rng, contact = np.random.default_rng(4), made(POINT, DISC)
    for beyond in (0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2):
        frame = found(contact, elsewhere(placed((2 + beyond, beyond, -1.5)), rng))[2][0]
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)


def test_an_arc_that_looks_away_ends_at_its_nearer_end():
    """A quarter circle whose middle points away from the cylinder: its two ends are nearest, the one not in between."""
    arc = {"centre": [0, 0, 0], "normal": [0, 0, 1], "middle": [1, 0.1, 0], "radius": 1, "half_angle": np.pi / 4}
    contact = made({"arc": arc}, {"cylinder": {**PIN, "radius": 0.5}})
    middle = np.arctan2(0.1, 1)
    ends = [np.array([3 + np.cos(t), np.sin(t)]) for t in (middle - np.pi / 4, middle + np.pi / 4)]
    gap, point, _ = found(contact, placed((3, 0, 0)))
    nearest = min(ends, key=np.linalg.norm)
    assert gap[0] == pytest.approx(np.linalg.norm(nearest) - 0.5, abs=1e-14)
    np.testing.assert_allclose(point[0, :2], 0.5 * nearest / np.linalg.norm(nearest), atol=1e-14)


def test_a_rounded_edge_is_an_arc_with_a_skin():
    """A torus over a plane, upright: its lowest point is both radii below the centre."""
    edge = {"centre": [0, 0, 0], "normal": [1, 0, 0], "radius": 0.5, "edge_radius": 0.2}
    contact = made({"arc": edge}, {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}})
    assert found(contact, placed((0, 0, 1)))[0] == pytest.approx(0.3, abs=1e-15)


ENDED = {"cylinder": {**PIN, "half_length": 0.8}}
MOUTH = {"bore": {**PIN, "half_length": 0.8}}


@pytest.mark.parametrize("b", [DISC, RECTANGLE, ENDED, MOUTH], ids=lambda b: next(iter(b)))
def test_normal_across_an_edge_is_the_same_just_outside_and_just_inside(b):
    """A circle on an edge: N is across the edge and across the circle, and does not jump to a face when it sinks in."""
    rng, sink = np.random.default_rng(11), 1e-6
    contact, poses = made(CIRCLE, b), scattered(4000, rng)
    gap, _, frame = found(contact, poses)
    seen = np.abs(np.einsum("nji,nj->ni", poses.R[1], frame[:, 0]))
    faces = np.sum(seen > 0.1, axis=1) if b is RECTANGLE else 1 + (seen[:, 2] > 0.1)
    edge = (gap > 0.01) & (faces == 2) & (seen.max(axis=1) < 0.99) & ((seen < 1e-9).any(axis=1) | (b is not RECTANGLE))
    touch = Poses((poses.x[0] - (gap + sink)[:, None] * frame[:, 0], poses.x[1]), poses.R)
    depth, _, inside = found(contact, touch)
    assert edge.sum() > 100
    assert np.mean((np.abs(inside[:, 0] - frame[:, 0]).max(axis=1) < 1e-3)[edge]) > 0.99
    assert np.mean(((-1.001 * sink <= depth) & (depth <= -0.7 * sink))[edge]) > 0.99
