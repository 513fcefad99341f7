"""Gaps and frames against brute-force minimisation over the drawn features, at random poses."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.friction.arrays import friction_arrays
from engine.kernels.contacts import relative_velocity, whitened_rows
from engine.kernels.gaps import find_contacts
from tests.engine.small import made, place, small

KINDS = ["ring-bore", "point-plane", "arc-plane", "cylinder-plane", "arc-cylinder"]
POSES = 40
SEEDS = range(5)


def unit(v: Any) -> np.ndarray:
    """Return the direction of v."""
    return np.asarray(v) / np.linalg.norm(v)


@dataclass
class Pair:
    """Two free bodies with one contact between them, and its features as drawn, in the bodies' own frames."""

    assembly: Assembly
    a: int
    b: int
    centres: tuple[np.ndarray, np.ndarray]
    bodies: dict[str, Any]
    gap: Callable[["Pair"], float]
    """The gap at the present pose, by brute force."""

    def world(self, side: int, point: Any) -> np.ndarray:
        """Return the world position of a point of side 0 (a) or 1 (b)."""
        body = (self.a, self.b)[side]
        return self.assembly.state.x[body] + self.turn(side, np.asarray(point) - self.centres[side])

    def turn(self, side: int, direction: Any) -> np.ndarray:
        """Return the world components of a direction of side 0 (a) or 1 (b)."""
        return self.assembly.state.R[(self.a, self.b)[side]] @ np.asarray(direction)

    def found(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the engine's gap, point and frame at the present pose."""
        model, state, work = self.assembly.model, self.assembly.state, self.assembly.work
        find_contacts(model.contacts, state.x, state.R, work.gap, work.point, work.frame)
        return float(work.gap[0]), work.point[0].copy(), work.frame[0].copy()

    def speed(self, twist: np.ndarray) -> np.ndarray:
        """Return the engine's relative velocity (N, T1, T2) at the present pose."""
        self.found()
        state, work = self.assembly.state, self.assembly.work
        relative_velocity(state.x, state.R, self.a, self.b, work.point, work.frame, twist, 0, work.u)
        return work.u[0].copy()


def lowest(height: Callable[[float], float], half_angle: float) -> float:
    """Minimise over an angle: a fine grid, then Brent around its best."""
    grid = np.linspace(-half_angle, half_angle, 181)
    best = grid[int(np.argmin([height(t) for t in grid]))]
    reach = grid[1] - grid[0]
    bounds = max(best - reach, -half_angle), min(best + reach, half_angle)
    fine = minimize_scalar(height, bounds=bounds, method="bounded", options={"xatol": 1e-12})
    return min(float(fine.fun), height(bounds[0]), height(bounds[1]))


def features(kind: str, rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[Pair], float]]:
    """Draw a pair of features; return the tables that describe it and its gap by brute force."""
    p, q, n, m = rng.normal(size=(4, 3))
    n, m = unit(n), unit(m)
    radius, skin = rng.uniform(0.3, 1.5), rng.uniform(0, 0.05)
    plane = {"point": q.tolist(), "normal": n.tolist()}
    middle = unit(np.cross(m, rng.normal(size=3)))
    half_angle = rng.choice([0.4, 1.2, np.pi / 2, 2.5, np.pi])
    arc = {"centre": p.tolist(), "normal": m.tolist(), "middle": middle.tolist(), "half_angle": float(half_angle)}
    arc["radius"] = radius
    cylinder = {"axis": m.tolist(), "radius": radius, "point": p.tolist()}

    def above(pair: Pair, point: np.ndarray) -> float:
        return float((point - pair.world(1, q)) @ pair.turn(1, n)) - skin

    def on_arc(pair: Pair, t: float) -> np.ndarray:
        way = np.cos(t) * middle + np.sin(t) * np.cross(m, middle)
        return pair.world(0, p + radius * way)

    def off_axis(pair: Pair, point: np.ndarray, through: Any, along: Any) -> float:
        return float(np.linalg.norm(np.cross(point - pair.world(1, through), pair.turn(1, along))))

    if kind == "ring-bore":
        station = rng.normal()
        joint = {
            "type": "clearance_revolute",
            "bearing": {"body": "a", "point": p.tolist(), "axis": m.tolist()},
            "journal": {"body": "b", "point": q.tolist(), "axis": n.tolist(), "radius": radius},
            "rings": [station],
            "radial_clearance": 0.1,
            "friction": 0.1,
        }
        return {"joints": {"J": joint}}, lambda pair: 0.1 - off_axis(pair, pair.world(0, p + station * m), q, n)
    if kind == "point-plane":
        sides, gap = ({"point": p.tolist()}, {"plane": plane}), lambda pair: above(pair, pair.world(0, p))
    elif kind == "arc-plane":
        sides = ({"arc": arc}, {"plane": plane})
        gap = lambda pair: lowest(lambda t: above(pair, on_arc(pair, t)), half_angle)  # noqa: E731
    elif kind == "cylinder-plane":  # the circle at mid-height
        sides = ({"cylinder": cylinder}, {"plane": plane})
        gap = lambda pair: lowest(lambda t: above(pair, on_arc(pair, t)), np.pi)  # noqa: E731
    else:
        thick = rng.uniform(0.3, 1.5)
        sides = ({"arc": arc}, {"cylinder": {"point": q.tolist(), "axis": n.tolist(), "radius": thick}})
        gap = lambda pair: lowest(lambda t: off_axis(pair, on_arc(pair, t), q, n), half_angle) - thick - skin  # noqa: E731
    tables = [{"body": body, **side} for body, side in zip("ab", sides, strict=True)]
    if rng.random() < 0.5:  # the order in the file does not matter
        tables.reverse()
    return {"contacts": {"C": {"a": tables[0], "b": tables[1], "offset": skin, "friction": 0.1}}}, gap


def pair_of(kind: str, rng: np.random.Generator) -> Pair:
    """Make two bodies of random inertia, placed and turned at random in the file, with a pair of features."""
    bodies, centres = {}, rng.normal(size=(2, 3))
    for name, centre in zip("ab", centres, strict=True):
        root = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
        inertia = np.eye(3) * 2 + 0.1 * (root + root.T)
        bodies[name] = {
            "mass": float(rng.uniform(0.5, 3)),
            "inertia": inertia.tolist(),
            "center_of_mass": centre.tolist(),
            "origin": rng.normal(size=3).tolist(),
            "axis": rng.normal(size=3).tolist(),
            "angle": float(rng.uniform(-3, 3)),
        }
    tables, gap = features(kind, rng)
    assembly = assemble(made(small(bodies=bodies, simulation={"penetration": 1e3}, **tables)))
    a, b = int(assembly.model.contacts.a[0]), int(assembly.model.contacts.b[0])
    return Pair(assembly, a, b, (centres[0], centres[1]), bodies, gap)


def scatter(pair: Pair, kind: str, rng: np.random.Generator) -> None:
    """Place both bodies anew. An arc stays outside its cylinder and shows it its rim, as the pair is meant."""
    while True:
        far = [6.0, 0, 0] if kind == "arc-cylinder" else np.zeros(3)
        place(pair.assembly, pair.a, rng.normal(size=3) + far, Rotation.random(random_state=rng))
        place(pair.assembly, pair.b, rng.normal(size=3), Rotation.random(random_state=rng))
        if kind != "arc-cylinder" or shows_its_rim(pair):
            return


def shows_its_rim(pair: Pair) -> bool:
    """Say whether the cylinder's axis is beyond the arc's radius, less than 45 degrees off the arc's plane.

    And less than 2 rad from its middle. Elsewhere the distance may have two minima along the arc.
    """
    a, b = pair.assembly.model.contacts.geometry_a[0], pair.assembly.model.contacts.geometry_b[0]
    centre, axis = pair.world(0, a[:3] + pair.centres[0]), pair.turn(1, b[3:6])
    way = pair.world(1, b[:3] + pair.centres[1]) - centre
    way -= (way @ axis) * axis
    distance = np.linalg.norm(way)
    normal, middle = pair.turn(0, a[3:6]), pair.turn(0, a[6:9])
    angle = np.arctan2(np.cross(normal, middle) @ way, middle @ way)
    return bool(distance > 1.2 * a[9] and abs(normal @ way) < 0.7 * distance and abs(angle) < 2)


@pytest.fixture(params=[(kind, seed) for kind in KINDS for seed in SEEDS], ids=lambda p: f"{p[0]}-{p[1]}")
def drawn(request):
    """Return a pair of features, its kind and its random generator."""
    kind, seed = request.param
    rng = np.random.default_rng(1000 * KINDS.index(kind) + seed)
    return pair_of(kind, rng), kind, rng


def test_gap_is_the_one_found_by_brute_force(drawn):
    """The closed form is the least distance between the features as the file draws them."""
    pair, kind, rng = drawn
    for _ in range(POSES):
        scatter(pair, kind, rng)
        assert pair.found()[0] == pytest.approx(pair.gap(pair), abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS[:-1])  # a random start is not one of an arc outside its cylinder
def test_gap_at_the_start_pose_of_the_file(kind, seed):
    """Assembly places the features where origin, axis and angle of the file put them."""
    rng = np.random.default_rng(50 + seed)
    pair = pair_of(kind, rng)
    for name, side in (("a", 0), ("b", 1)):
        body = pair.bodies[name]
        turn = Rotation.from_rotvec(body["angle"] * unit(body["axis"]))
        centre = np.array(body["origin"]) + turn.apply(body["center_of_mass"])
        np.testing.assert_allclose(pair.world(side, [0, 0, 0]), body["origin"], atol=1e-13)
        np.testing.assert_allclose(pair.assembly.state.x[(pair.a, pair.b)[side]], centre, atol=1e-13)
        np.testing.assert_allclose(pair.turn(side, np.eye(3)), turn.as_matrix(), atol=1e-13)
    assert pair.found()[0] == pytest.approx(pair.gap(pair), abs=1e-9)


def test_frame_is_orthonormal_and_right_handed(drawn):
    """Rows N, T1, T2 with N x T1 = T2."""
    pair, kind, rng = drawn
    for _ in range(POSES):
        scatter(pair, kind, rng)
        frame = pair.found()[2]
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-13)
        np.testing.assert_allclose(np.cross(frame[0], frame[1]), frame[2], atol=1e-13)


def moved(pair: Pair, pose: Any, twist: np.ndarray, dt: float) -> None:
    """Place both bodies where ``twist`` takes them from ``pose`` within dt."""
    for body, (x, rotation) in pose.items():
        spin = Rotation.from_rotvec(dt * twist[body, 3:])
        place(pair.assembly, body, x + dt * twist[body, :3], rotation * spin)


def pose_of(pair: Pair) -> dict[int, tuple[np.ndarray, Rotation]]:
    """Return where both bodies are."""
    state = pair.assembly.state
    return {body: (state.x[body].copy(), Rotation.from_matrix(state.R[body])) for body in (pair.a, pair.b)}


def test_normal_velocity_is_the_rate_of_the_gap(drawn):
    """N . u against the central difference of the engine's own gap along the motion."""
    pair, kind, rng = drawn
    for _ in range(POSES):
        scatter(pair, kind, rng)
        pose, twist, dt = pose_of(pair), np.vstack([rng.normal(size=(2, 6)), np.zeros(6)]), 1e-5
        speed = pair.speed(twist)[0]
        moved(pair, pose, twist, dt)
        after = pair.found()[0]
        moved(pair, pose, twist, -dt)
        before = pair.found()[0]
        assert (after - before) / (2 * dt) == pytest.approx(speed, abs=1e-6)


def test_tangential_velocity_is_that_of_the_common_point(drawn):
    """T . u from rigid-body kinematics at the contact point; a rigid motion of both bodies together gives none."""
    pair, kind, rng = drawn
    for _ in range(POSES):
        scatter(pair, kind, rng)
        state = pair.assembly.state
        twist = np.vstack([rng.normal(size=(2, 6)), np.zeros(6)])
        _, point, frame = pair.found()
        at = [twist[k, :3] + np.cross(state.R[k] @ twist[k, 3:], point - state.x[k]) for k in (pair.a, pair.b)]
        np.testing.assert_allclose(pair.speed(twist), frame @ (at[0] - at[1]), atol=1e-12)
        v, spin = rng.normal(size=(2, 3))
        for k in (pair.a, pair.b):
            twist[k] = [*(v + np.cross(spin, state.x[k])), *(state.R[k].T @ spin)]
        np.testing.assert_allclose(pair.speed(twist), 0, atol=1e-12)


def test_frame_is_continuous(drawn):
    """A motion of 1e-7 turns the frame by as little, scaled by the distance that N is measured over."""
    pair, kind, rng = drawn
    for _ in range(POSES):
        scatter(pair, kind, rng)
        pose, twist = pose_of(pair), np.vstack([rng.normal(size=(2, 6)), np.zeros(6)])
        gap, _, frame = pair.found()
        moved(pair, pose, twist, 1e-7)
        reach = 1 / abs(0.1 - gap) if kind == "ring-bore" else 1.0
        assert np.abs(pair.found()[2] - frame).max() < 1e-6 * (1 + 5 * reach)


def test_whitened_rows_give_the_relative_velocity(drawn):
    """G M^-1/2 applied to M^1/2 v is G v, with M^1/2 = sqrt(m) and L' of the file's inertia."""
    pair, kind, rng = drawn
    bodies = pair.assembly.model.bodies
    problem = friction_arrays(12, 1, 2, 12, 11)
    for _ in range(10):
        scatter(pair, kind, rng)
        twist = np.vstack([rng.normal(size=(2, 6)), np.zeros(6)])
        u = pair.speed(twist)
        state, work = pair.assembly.state, pair.assembly.work
        whitened_rows(bodies, state.x, state.R, pair.a, pair.b, work.point, work.frame, 0, problem.rows, 0)
        white = np.zeros(12)
        for k in (pair.a, pair.b):
            white[6 * k : 6 * k + 3] = np.sqrt(bodies.mass[k]) * twist[k, :3]
            white[6 * k + 3 : 6 * k + 6] = np.linalg.cholesky(bodies.inertia[k]).T @ twist[k, 3:]
        rows = np.zeros((3, 12))
        for run in range(2):
            first, width = problem.rows.start[0, run], problem.rows.width[0, run]
            rows[:, first : first + width] = problem.rows.G[0, :, 6 * run : 6 * run + width]
        np.testing.assert_allclose(rows @ white, u, atol=1e-12)


def test_concentric_journal_still_has_a_frame():
    """Eccentricity 0: the gap is the clearance and the frame is orthonormal, tied to the journal."""
    pair = pair_of("ring-bore", np.random.default_rng(7))
    geometry_a, geometry_b = pair.assembly.model.contacts.geometry_a[0], pair.assembly.model.contacts.geometry_b[0]
    geometry_a[:3] = geometry_b[:3] = 0.0
    place(pair.assembly, pair.a, np.zeros(3), Rotation.identity())
    place(pair.assembly, pair.b, np.zeros(3), Rotation.identity())
    gap, _, frame = pair.found()
    assert gap == pytest.approx(0.1, abs=1e-15)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-13)


def test_ground_has_no_velocities():
    """A contact with the ground has rows of its moving body only."""
    data = small(
        bodies={"ground": {"fixed": True}, "a": {"mass": 2.0, "inertia": [1, 1, 1]}},
        contacts={
            "C": {
                "a": {"body": "a", "point": [0, 0, 0]},
                "b": {"body": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
                "friction": 0.1,
            }
        },
    )
    assembly = assemble(made(data))
    state, work, problem = assembly.state, assembly.work, assembly.problem
    find_contacts(assembly.model.contacts, state.x, state.R, work.gap, work.point, work.frame)
    whitened_rows(assembly.model.bodies, state.x, state.R, 0, 1, work.point, work.frame, 0, problem.rows, 0)
    assert problem.rows.width[0].tolist() == [6, 0]
    np.testing.assert_allclose(problem.rows.G[0, 0, :6], [0, 0, 1 / np.sqrt(2), 0, 0, 0], atol=1e-15)
