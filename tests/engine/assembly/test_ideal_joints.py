"""Rows of ideal joints: what they hold and leave free, at poses and velocities composed by hand."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.errors import MechanismError
from engine.kernels.bilateral import row_velocity, row_violations, whitened_bilateral_rows
from engine.kernels.model import SLIDE, TURN
from engine.mechanism import set_values
from tests.each import each
from tests.engine.assembly.pairs_of_bodies import WORD, joined, seen_from
from tests.engine.small import made, place, small

FREEDOM = {"revolute": 1, "cylindrical": 2, "prismatic": 1, "spherical": 3, "fixed": 0, "planar": 3}
CASES = [(kind, ground, seed) for kind in FREEDOM for ground in (False, True) for seed in range(2)]


class Pair:
    """Two bodies with one ideal joint: its rows, and its point and axes in the world."""

    def __init__(self, kind: str, ground: bool, seed: int) -> None:
        self.kind, self.ground, self.rng = kind, ground, np.random.default_rng(seed)
        self.data = joined(kind, self.rng, ground=ground)
        self.assembly: Assembly = assemble(made(self.data))
        ties, state = self.assembly.model.bilateral, self.assembly.state
        self.a, self.b = int(ties.a[0]), int(ties.b[0])
        self.n = len(ties.kind)
        self.start = {k: (state.x[k].copy(), Rotation.from_matrix(state.R[k])) for k in range(len(state.x))}
        slides = ties.geometry[ties.kind == SLIDE]
        self.point = state.x[self.b] + state.R[self.b] @ slides[0, 6:9]
        turns = ties.geometry[ties.kind == TURN]
        self.axis = state.R[self.a] @ turns[0, 0:3] if len(turns) else np.array([0.0, 0.0, 1.0])
        self.tilt = state.R[self.a] @ turns[0, 3:6] if len(turns) else self.axis
        self.across = np.cross(self.axis, self.rng.normal(size=3))
        self.across /= np.linalg.norm(self.across)

    def move(self, body: int, shift: Any = (0, 0, 0), turn: Any = (0, 0, 0)) -> None:
        """Move a body from where it is: turn it about the joint's point, then shift it."""
        state, spin = self.assembly.state, Rotation.from_rotvec(turn)
        x = self.point + spin.apply(state.x[body] - self.point) + shift
        place(self.assembly, body, x, spin * Rotation.from_matrix(state.R[body]))

    def restart(self) -> None:
        """Put both bodies back to the start."""
        for k, (x, rotation) in self.start.items():
            place(self.assembly, k, x, rotation)

    def violations(self) -> np.ndarray:
        """Return the violations at the present pose; keep points and directions."""
        state = self.assembly.state
        out, self.at, self.way = np.zeros(self.n), np.zeros((self.n, 3)), np.zeros((self.n, 3))
        row_violations(self.assembly.model.bilateral, state.x, state.R, np.zeros(self.n), out, self.at, self.way)
        return out

    def off(self) -> tuple[float, float]:
        """Return how far the joint is off: a length, and an angle."""
        found, ties = self.violations(), self.assembly.model.bilateral
        slide = np.linalg.norm(found[ties.kind == SLIDE])
        return float(slide), float(np.linalg.norm((found / ties.arm)[ties.kind == TURN]))


def free_motions(pair: Pair) -> list[tuple[Any, Any]]:
    """Return finite motions (shift, rotation) of the second body that its joint allows, one for each freedom."""
    n, t = pair.axis, pair.across
    return {
        "revolute": [(0 * n, 0.7 * n)],
        "cylindrical": [(0.4 * n, 0 * n), (0 * n, 0.7 * n)],
        "prismatic": [(0.4 * n, 0 * n)],
        "spherical": [(0 * n, 0.7 * d) for d in np.eye(3)],
        "fixed": [],
        "planar": [(0.4 * t, 0 * n), (0.3 * np.cross(n, t), 0 * n), (0 * n, 0.7 * n)],
    }[pair.kind]


def locked_motions(pair: Pair) -> list[tuple[Any, Any]]:
    """Return motions of the second body along and about directions that its joint holds.

    About one row's direction each: an angle about a direction between two is theirs together to third order only.
    """
    n, e, t = pair.axis, pair.tilt, pair.across
    return {
        "revolute": [(0.1 * n, 0 * n), (0.1 * t, 0 * n), (0 * n, 0.2 * e)],
        "cylindrical": [(0.1 * t, 0 * n), (0 * n, 0.2 * e)],
        "prismatic": [(0.1 * t, 0 * n), (0 * n, 0.2 * e), (0 * n, 0.2 * n)],
        "spherical": [(0.1 * d, 0 * n) for d in np.eye(3)],
        "fixed": [(0.1 * n, 0 * n), (0.1 * t, 0 * n), (0 * n, 0.2 * n)],
        "planar": [(0.1 * n, 0 * n), (0 * n, 0.2 * e)],
    }[pair.kind]


@each("pair", CASES, lambda case: Pair(*case))
def test_rows_are_six_less_the_freedom_and_independent(pair):
    """The rank of the whitened rows is their number, and well clear of being less."""
    state = pair.assembly.state
    assert pair.n == 6 - FREEDOM[pair.kind]
    pair.violations()
    J = np.zeros((pair.n, 16))
    model = pair.assembly.model
    whitened_bilateral_rows(model.bodies, model.bilateral, state.x, state.R, pair.at, pair.way, J)
    singular = np.linalg.svd(J, compute_uv=False)
    assert singular[-1] > 0.05 * singular[0]


@each("pair", CASES, lambda case: Pair(*case))
def test_joint_holds_at_the_start_and_wherever_both_go_together(pair):
    """A rigid motion of everything violates nothing."""
    assert max(pair.off()) < 1e-13
    for body in {pair.a, pair.b} if not pair.ground else ():
        pair.move(body, [0.3, -0.2, 0.5], [0.4, 1.1, -0.7])
    assert max(pair.off()) < 1e-13


@each("pair", CASES, lambda case: Pair(*case))
def test_free_motions_violate_nothing(pair):
    """Finite motions along what is free, one after the other."""
    for shift, turn in free_motions(pair):
        pair.move(pair.b, shift, turn)
        assert max(pair.off()) < 1e-13
        pair.restart()


@each("pair", CASES, lambda case: Pair(*case))
def test_locked_motions_are_seen_with_their_length_and_angle(pair):
    """The rows together measure exactly how far the second body was moved or turned."""
    for shift, turn in locked_motions(pair):
        pair.move(pair.b, shift, turn)
        assert pair.off() == pytest.approx((np.linalg.norm(shift), np.linalg.norm(turn)), abs=1e-13)
        pair.restart()


@each("pair", CASES, lambda case: Pair(*case))
def test_rate_of_the_rows_is_the_difference_of_their_violations(pair):
    """At a pose the joint allows, with random twists of both bodies, against central differences."""
    state = pair.assembly.state
    for shift, turn in free_motions(pair):
        pair.move(pair.b, shift, turn)
    twist = pair.rng.normal(size=(len(state.x), 6))
    twist[-1] = 0.0
    pair.violations()
    rate = [
        row_velocity(pair.assembly.model.bilateral, state.x, state.R, pair.at, pair.way, twist, i)
        for i in range(pair.n)
    ]
    here = {k: (state.x[k].copy(), Rotation.from_matrix(state.R[k])) for k in {pair.a, pair.b}}
    found, dt = {}, 1e-5
    for sign in (1, -1):
        for k, (x, rotation) in here.items():
            spin = Rotation.from_rotvec(sign * dt * twist[k, 3:])
            place(pair.assembly, k, x + sign * dt * twist[k, :3], rotation * spin)
        found[sign] = pair.violations()
    np.testing.assert_allclose((found[1] - found[-1]) / (2 * dt), rate, atol=1e-8)


@each("pair", CASES, lambda case: Pair(*case))
def test_whitened_rows_give_the_rates(pair):
    """J M^-1/2 on M^1/2 v is the rate of the rows."""
    state, bodies = pair.assembly.state, pair.assembly.model.bodies
    ties = pair.assembly.model.bilateral
    twist = pair.rng.normal(size=(len(state.x), 6))
    twist[-1] = 0.0
    pair.violations()
    J = np.zeros((pair.n, 16))
    whitened_bilateral_rows(bodies, ties, state.x, state.R, pair.at, pair.way, J)
    white = np.zeros((2, 8))
    for side, k in enumerate((pair.a, pair.b)):
        if k < len(bodies.mass):
            white[side, :3] = np.sqrt(bodies.mass[k]) * twist[k, :3]
            white[side, 3:6] = np.linalg.cholesky(bodies.inertia[k]).T @ twist[k, 3:]
    rate = [row_velocity(ties, state.x, state.R, pair.at, pair.way, twist, i) for i in range(pair.n)]
    np.testing.assert_allclose(J @ white.ravel(), rate, atol=1e-12)


def test_arm_is_the_least_radius_of_gyration_of_the_bodies_that_move():
    """A rod of mass 3 and a small cube: sqrt(trace(I) / 2m) of the cube; of the rod when the cube is fixed."""
    data = joined("fixed", np.random.default_rng(3))
    data["bodies"]["one"] |= {"mass": 3.0, "inertia": [4.0, 4.0, 0.1]}
    data["bodies"]["two"] |= {"mass": 2.0, "inertia": [0.01, 0.01, 0.01]}
    ties = assemble(made(data)).model.bilateral
    np.testing.assert_allclose(ties.arm[ties.kind == TURN], np.sqrt(0.03 / 4))
    np.testing.assert_array_equal(ties.arm[ties.kind == SLIDE], 1.0)
    small = data["bodies"]["two"]
    data["bodies"]["two"] = {"fixed": True, **{key: small[key] for key in ("origin", "axis", "angle")}}
    ties = assemble(made(data)).model.bilateral
    np.testing.assert_allclose(ties.arm[ties.kind == TURN], np.sqrt(8.1 / 6))


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "prismatic", "planar"])
def test_an_axis_may_point_either_way(kind):
    """The same joint with the second axis reversed is closed, and has the same rows."""
    data = joined(kind, np.random.default_rng(5))
    key, side = ("normal" if kind == "planar" else "axis"), data["joints"]["J"][WORD[kind][1]]
    straight = assemble(made(data)).model.bilateral
    side[key] = [-x for x in side[key]]
    np.testing.assert_allclose(assemble(made(data)).model.bilateral.geometry, straight.geometry, atol=1e-15)


def message(data: dict[str, Any]) -> str:
    """Return what is said when ``data`` is assembled and no body may be moved from its drawn place."""
    data["simulation"]["assembly_travel"] = 0.0
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    return str(caught.value)


@pytest.mark.parametrize("kind", FREEDOM)
def test_points_apart_at_the_start_are_refused_with_their_distance(kind):
    """Moved by 1e-3 along what the joint holds: distance, bound and remedy."""
    pair = Pair(kind, False, 11)
    way = pair.axis if kind in ("revolute", "planar", "spherical", "fixed") else pair.across
    pair.data["bodies"]["two"]["origin"] = (np.array(pair.data["bodies"]["two"]["origin"]) + 1e-3 * way).tolist()
    said = message(pair.data)
    assert said.startswith("small: joints are open at the start pose\n  joints.J: the points of ")
    assert "are 0.001 m apart along what the joint holds; allowed: up to " in said
    assert said.endswith("move a body, or correct one of the two points; where they vary, let one parameter give both")


def test_the_points_of_an_ideal_joint_vary_together_by_a_parameter():
    """One side alone opens the joint; a parameter that gives point and origin keeps it closed, and moves the pin."""
    bodies = {"ground": {"fixed": True}, "bar": {"mass": 1.0, "inertia": [1, 1, 1], "origin": ["arm", 0, 0]}}
    sides = {"bearing": ("bar", ["-arm", 0, 0]), "journal": ("ground", [0, 0, 0])}
    joint = {side: {"body": body, "point": point, "axis": [0, 0, 1]} for side, (body, point) in sides.items()}
    mechanism = made(small(bodies=bodies, joints={"J": {"type": "revolute", **joint}}, parameters={"arm": 2.0}))
    assert assemble(set_values(mechanism, {"parameters.arm": 3.0})).state.x[0].tolist() == [3.0, 0.0, 0.0]
    with pytest.raises(MechanismError, match=r"joints\.J\b.* 1 m\b"):
        assemble(set_values(mechanism, {"joints.J.bearing.point.x": -3.0}))


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "prismatic", "planar"])
def test_axes_inclined_at_the_start_are_refused_with_their_angle(kind):
    """An axis of the second body turned by 0.02 rad."""
    pair = Pair(kind, False, 12)
    key, side = ("normal" if kind == "planar" else "axis"), pair.data["joints"]["J"][WORD[kind][1]]
    axis = Rotation.from_rotvec(0.02 * pair.tilt).apply(pair.axis)
    point = np.array(pair.point)
    _, side[key] = seen_from(pair.data["bodies"]["two"], point, axis)
    side.pop("normal" if key == "axis" else "", None)
    said = message(pair.data)
    assert f"joints.J: the axes of {' and '.join(WORD[kind])} are 0.02 rad apart; allowed: up to 1e-05 rad" in said


def test_a_joint_may_be_off_by_the_rounding_of_a_drawing():
    """1e-5 of the arm is let pass, and so is the file's own penetration if that is more."""
    pair = Pair("revolute", False, 13)
    arm = float(pair.assembly.model.bilateral.arm[-1])
    origin = np.array(pair.data["bodies"]["two"]["origin"])
    pair.data["bodies"]["two"]["origin"] = (origin + 0.9e-5 * arm * pair.axis).tolist()
    assemble(made(pair.data))
    pair.data["bodies"]["two"]["origin"] = (origin + 1.1e-5 * arm * pair.axis).tolist()
    message(pair.data)
    pair.data["simulation"]["penetration"] = 1.2e-5 * arm
    assemble(made(pair.data))


def test_all_open_joints_are_said_at_once():
    """Two joints, both open: a line for each."""
    data = joined("spherical", np.random.default_rng(14))
    data["joints"]["K"] = {
        "type": "fixed",
        "a": {"body": "one", "point": [0, 0, 0]},
        "b": {"body": "two", "point": [0, 0, 0]},
    }
    data["joints"]["J"]["ball"]["point"][0] += 0.1
    assert [line.split(":")[0] for line in message(data).split("\n")[1:]] == ["  joints.J", "  joints.K"]
