"""Rows of prescribed motions: nothing missed at the start, the right coordinate, its exact rate."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.kernels.bilateral import row_targets, row_velocity, row_violations
from tests.each import each
from tests.engine.small import made, place, small

SEEDS = range(6)
AXIS, WAY, POINT = np.array([1.0, -2.0, 2.0]) / 3, np.array([2.0, 3.0, 6.0]) / 7, np.array([0.3, -0.1, 0.7])
ARM, ARM_OF_B = np.sqrt(3.6 / 4.0), np.sqrt(7.5 / 6.0)  # least radius of gyration of the two, that of b
TURN = {"body": "b", "relative_to": "a", "about": {"axis": AXIS.tolist()}, "law": {"speed": 0.5}}
SLIDE = {
    "body": "b",
    "relative_to": "a",
    "along": {"point": POINT.tolist(), "direction": WAY.tolist()},
    "law": {"speed": 0.5},
}


def placed(rng: np.random.Generator, **body: Any) -> dict[str, Any]:
    """Describe a body anywhere."""
    pose = {"origin": rng.normal(size=3).tolist(), "axis": rng.normal(size=3).tolist(), "angle": rng.uniform(-3, 3)}
    return {**pose, **body}


def two_bodies(seed: int, a_fixed: bool = False, **motions: Any) -> Assembly:
    """Make b and a, which moves or not, anywhere and anyhow turned; off-centre frames."""
    rng = np.random.default_rng(seed)
    other = {"fixed": True} if a_fixed else {"mass": 2.0, "inertia": [1, 1.2, 1.4], "center_of_mass": [0.1, 0.2, -0.1]}
    moved = {"mass": 3.0, "inertia": [2.0, 2.5, 3.0], "center_of_mass": [-0.2, 0.05, 0.15]}
    return assemble(made(small(bodies={"a": placed(rng, **other), "b": placed(rng, **moved)}, motions=motions)))


def numbers(assembly: Assembly) -> tuple[int, int]:
    """Return the numbers of a and b; a fixed one is the ground."""
    order = np.argsort(assembly.model.bodies.mass)
    return (int(order[0]), int(order[1])) if len(order) == 2 else (1, 0)


def rows(assembly: Assembly, t: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what is missed by every row at time t, the rows' points and their directions."""
    ties, state = assembly.model.bilateral, assembly.state
    n = ties.kind.size
    target, violation, point, way = np.zeros((3, n)), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
    row_targets(ties, assembly.model.time_laws, t, 0.0, target)
    row_violations(ties, state.x, state.R, target[0], violation, point, way)
    return violation, point, way


def rotation(assembly: Assembly, body: int) -> Rotation:
    """Return a body's rotation."""
    return Rotation.from_matrix(assembly.state.R[body])


def moved(assembly: Assembly, twist: np.ndarray, dt: float) -> None:
    """Displace all moving bodies by dt at their twists (velocity in the world, angular velocity in body axes)."""
    for body in range(len(assembly.state.x) - 1):
        x = assembly.state.x[body] + dt * twist[body, :3]
        place(assembly, body, x, rotation(assembly, body) * Rotation.from_rotvec(dt * twist[body, 3:]))


@each("seed", SEEDS)
@each("against", ["a", "fixed a", "world"])
def test_nothing_is_missed_at_the_start(against, seed):
    """Wherever the bodies are, against a moving body, a fixed one, or the world."""
    motions = {"S": SLIDE, "T": TURN}
    if against == "world":
        motions = {name: {k: v for k, v in m.items() if k != "relative_to"} for name, m in motions.items()}
    violation, _, _ = rows(two_bodies(seed, against == "fixed a", **motions))
    np.testing.assert_allclose(violation, 0, atol=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_translation_counts_the_way_of_the_point_seen_from_the_other_body(seed):
    """B shifted along and across, a and b moved as one: the way along, less the target speed t."""
    assembly, rng = two_bodies(seed, S=SLIDE), np.random.default_rng(100 + seed)
    a, b = numbers(assembly)
    along = assembly.state.R[a] @ WAY
    across = np.cross(along, rng.normal(size=3))
    place(assembly, b, assembly.state.x[b] + 0.8 * along + across, rotation(assembly, b))
    whole, shift = Rotation.random(random_state=rng), rng.normal(size=3)
    for body in (a, b):
        place(assembly, body, whole.apply(assembly.state.x[body]) + shift, whole * rotation(assembly, body))
    assert rows(assembly, 0.0)[0] == pytest.approx([0.8], abs=1e-13)
    assert rows(assembly, 1.6)[0] == pytest.approx([0.0], abs=1e-13)
    assert rows(assembly, 2.0)[0] == pytest.approx([-0.2], abs=1e-13)


def test_translation_leads_its_point_not_the_centre():
    """B turned about the point that is led misses nothing; its centre has moved."""
    assembly = two_bodies(1, S=SLIDE)
    _, b = numbers(assembly)
    arm = POINT - [-0.2, 0.05, 0.15]
    led = assembly.state.x[b] + assembly.state.R[b] @ arm
    turned = Rotation.from_rotvec([0.7, -1.0, 0.4]) * rotation(assembly, b)
    place(assembly, b, led - turned.apply(arm), turned)
    violation, point, _ = rows(assembly)
    assert violation == pytest.approx([0.0], abs=1e-14)
    np.testing.assert_allclose(point[0], led, atol=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_counts_the_angle_about_the_axis_seen_from_the_other_body(seed):
    """B turned, also by several turns, and shifted; a and b moved as one. An angle times the radius of gyration."""
    assembly, rng = two_bodies(seed, T=TURN), np.random.default_rng(100 + seed)
    a, b = numbers(assembly)
    axis = assembly.state.R[a] @ AXIS
    turn = Rotation.from_rotvec(15.0 * axis)
    place(assembly, b, rng.normal(size=3), turn * rotation(assembly, b))
    whole = Rotation.random(random_state=rng)
    for body in (a, b):
        place(assembly, body, rng.normal(size=3), whole * rotation(assembly, body))
    assert rows(assembly, 30.0)[0] == pytest.approx([0.0], abs=1e-13)
    assert rows(assembly, 30.4)[0] == pytest.approx([-0.2 * ARM], abs=1e-12)
    assert rows(assembly, 29.0)[0] == pytest.approx([0.5 * ARM], abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_of_a_translation_is_exact_for_any_motion(seed):
    """The rows' velocity against central differences of what is missed, both bodies moving anyhow."""
    assembly, rng, d = two_bodies(seed, S=SLIDE), np.random.default_rng(200 + seed), 1e-5
    moved(assembly, rng.normal(size=(3, 6)), 1.0)
    check_rate(assembly, rng.normal(size=(3, 6)), d)


@pytest.mark.parametrize("seed", SEEDS)
def test_rate_of_a_rotation_is_exact_where_the_axis_is_kept(seed):
    """Both bodies tumble as one while b turns about the axis and goes anywhere."""
    assembly, rng, d = two_bodies(seed, T=TURN), np.random.default_rng(200 + seed), 1e-5
    a, b = numbers(assembly)
    place(assembly, b, rng.normal(size=3), Rotation.from_rotvec(assembly.state.R[a] @ AXIS) * rotation(assembly, b))
    twist, common = rng.normal(size=(3, 6)), rng.normal(size=3)
    twist[a, 3:] = assembly.state.R[a].T @ common
    twist[b, 3:] = assembly.state.R[b].T @ (common + 0.9 * assembly.state.R[a] @ AXIS)
    assert row_velocity(*row_arguments(assembly), twist, 0) == pytest.approx(0.9 * ARM, rel=1e-12)
    check_rate(assembly, twist, d)


def row_arguments(assembly: Assembly) -> tuple[Any, ...]:
    """Return what row_velocity is told of the pose."""
    _, point, way = rows(assembly)
    return assembly.model.bilateral, assembly.state.x, assembly.state.R, point, way


def check_rate(assembly: Assembly, twist: np.ndarray, d: float) -> None:
    """Compare the first row's velocity with central differences over 2 d."""
    rate = row_velocity(*row_arguments(assembly), twist, 0)
    moved(assembly, twist, d)
    after = rows(assembly)[0][0]
    moved(assembly, twist, -2 * d)
    assert rate == pytest.approx((after - rows(assembly)[0][0]) / (2 * d), abs=1e-8)


def test_directions_are_in_the_frame_of_a_fixed_body_too():
    """The ground's axes are the world's, a fixed body's are not: b led and turned along its directions."""
    attitude = Rotation.from_rotvec([0.4, -0.8, 1.1])
    frame = {"fixed": True, "axis": attitude.as_rotvec().tolist(), "angle": float(attitude.magnitude())}
    bodies = {"a": frame, "b": {"mass": 3.0, "inertia": [2.0, 2.5, 3.0]}}
    assembly = assemble(made(small(bodies=bodies, motions={"S": SLIDE, "T": TURN})))
    place(assembly, 0, 0.8 * attitude.apply(WAY), Rotation.identity())
    assert rows(assembly)[0] == pytest.approx([0.8, 0.0], abs=1e-14)
    place(assembly, 0, np.zeros(3), Rotation.from_rotvec(0.8 * attitude.apply(AXIS)))
    assert rows(assembly)[0][1] == pytest.approx(0.8 * ARM_OF_B, abs=1e-14)


def test_six_motions_drive_a_body_fully():
    """Three ways and three angles, in the order of the file: six rows of rank 6."""
    axes = np.eye(3).tolist()
    motions: dict[str, Any] = {f"S{k}": {**SLIDE, "along": {"direction": axes[k]}} for k in range(3)}
    motions |= {f"T{k}": {**TURN, "about": {"axis": axes[k]}} for k in range(3)}
    assembly = two_bodies(3, a_fixed=True, **motions)
    arguments = row_arguments(assembly)
    jacobian = np.zeros((6, 6))
    for k in range(6):
        twist = np.zeros((2, 6))
        twist[0, k] = 1.0
        jacobian[:, k] = [row_velocity(*arguments, twist, i) for i in range(6)]
    assert np.linalg.matrix_rank(jacobian) == 6
    np.testing.assert_allclose(jacobian[:3, :3] @ jacobian[:3, :3].T, np.eye(3), atol=1e-14)
    assert not jacobian[3:, :3].any(), "an angle is not changed by a way"


def test_the_fixed_body_may_be_the_one_that_is_moved():
    """A motion of the ground against b is b's, backwards, with the radius of gyration of b."""
    assembly = two_bodies(2, a_fixed=True, T={**TURN, "body": "a", "relative_to": "b"})
    _, b = numbers(assembly)
    axis = assembly.state.R[b] @ AXIS
    place(assembly, b, assembly.state.x[b], Rotation.from_rotvec(-0.3 * axis) * rotation(assembly, b))
    assert rows(assembly)[0] == pytest.approx([0.3 * ARM_OF_B], abs=1e-13)
