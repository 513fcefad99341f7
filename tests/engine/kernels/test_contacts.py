"""Contacts as the assembly makes them and as rows of the equations of motion, at random poses."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.friction.arrays import dense_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import relative_velocity, whitened_rows
from engine.mechanism.contacts import PAIRS, Contact
from tests.each import each
from tests.engine.kernels.shapes import Poses, brute_gap, drawn, unit
from tests.engine.small import made, place, small

JOINT = "joint"
KINDS = [JOINT, "point-plane", "sphere-disc", "arc-rectangle", "arc-cylinder", "cylinder-plane", "ring-bore"]
POSES = 40
SEEDS = range(3)


@dataclass
class Pair:
    """Two free bodies with one contact between them."""

    assembly: Assembly
    a: int
    b: int
    contact: Contact
    bodies: dict[str, Any]

    def brute_gap(self) -> float:
        """Return the gap at the present pose, from the description alone."""
        x, R = self.assembly.state.x, self.assembly.state.R
        at, turns = [], []
        for name, i in (("a", self.a), ("b", self.b)):
            at.append((x[i] - R[i] @ self.bodies[name]["center_of_mass"])[None])
            turns.append(R[i][None])
        return float(brute_gap(self.contact, Poses((at[0], at[1]), (turns[0], turns[1])))[0])

    def found(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the engine's gap, point and frame at the present pose; of a profile's nearest part."""
        model, state, work = self.assembly.model, self.assembly.state, self.assembly.work
        find_contacts(model.contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)
        i = int(np.argmin(work.gap))
        return float(work.gap[i]), work.sites.point[i].copy(), work.sites.frame[i].copy()

    def speed(self, twist: np.ndarray) -> np.ndarray:
        """Return the engine's relative velocity (N, T1, T2) at the present pose."""
        self.found()
        state, work = self.assembly.state, self.assembly.work
        relative_velocity(state.x, state.R, self.a, self.b, work.sites.point, work.sites.frame, twist, 0, work.u)
        return work.u[0].copy()


def joint_and_its_contact(rng: np.random.Generator) -> tuple[dict[str, Any], Contact]:
    """Draw a joint with one ring, and the same as a contact of a ring and a cylinder."""
    p, q, n, m = rng.normal(size=(4, 3))
    radius, station = float(rng.uniform(0.3, 1.5)), float(rng.normal())
    joint = {
        "type": "clearance_revolute",
        "bearing": {"body": "a", "point": p.tolist(), "axis": m.tolist()},
        "journal": {"body": "b", "point": q.tolist(), "axis": n.tolist(), "radius": radius},
        "rings": [station],
        "radial_clearance": 0.1,
        "friction": 0.1,
    }
    ring = {"centre": (p + station * unit(m)).tolist(), "radius": radius + 0.1}
    cylinder = {"point": q.tolist(), "axis": n.tolist(), "radius": radius}
    sides = {"a": {"body": "a", "ring": ring}, "b": {"body": "b", "cylinder": cylinder}}
    return joint, Contact.model_validate({**sides, "friction": 0.1})


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
    if kind == JOINT:
        joint, contact = joint_and_its_contact(rng)
        tables: dict[str, Any] = {"joints": {"J": joint}}
    else:
        contact = drawn(kind, rng)
        table = contact.model_dump(exclude_none=True)
        if rng.random() < 0.5:  # the order in the file does not matter
            table["a"], table["b"] = table["b"], table["a"]
        tables = {"contacts": {"C": table}}
    assembly = assemble(made(small(bodies=bodies, simulation={"penetration": 1e3}, **tables)))
    a, b = int(assembly.model.contacts.a[0]), int(assembly.model.contacts.b[0])
    return Pair(assembly, a, b, contact, bodies)


def scatter(pair: Pair, rng: np.random.Generator) -> None:
    """Place both bodies anew."""
    for body in (pair.a, pair.b):
        place(pair.assembly, body, rng.normal(size=3), Rotation.random(random_state=rng))


@each("kind", [JOINT, *PAIRS])
def test_assembly_puts_features_where_the_file_has_them(kind):
    """At the start pose and at others the gap is that of the described features; origin, axis and angle place them."""
    rng = np.random.default_rng(50 + len(kind))
    pair = pair_of(kind, rng)
    state = pair.assembly.state
    for name, i in (("a", pair.a), ("b", pair.b)):
        body = pair.bodies[name]
        turn = Rotation.from_rotvec(body["angle"] * unit(body["axis"]))
        np.testing.assert_allclose(state.R[i], turn.as_matrix(), atol=1e-13)
        np.testing.assert_allclose(state.x[i], body["origin"] + turn.apply(body["center_of_mass"]), atol=1e-13)
    assert pair.found()[0] == pytest.approx(pair.brute_gap(), abs=1e-9)
    for _ in range(5):
        scatter(pair, rng)
        assert pair.found()[0] == pytest.approx(pair.brute_gap(), abs=1e-9)


CASES = [(kind, seed) for kind in KINDS for seed in SEEDS]


def with_generator(case: tuple[str, int]) -> tuple[Pair, np.random.Generator]:
    """Return two bodies with a contact, and the random generator."""
    kind, seed = case
    rng = np.random.default_rng(1000 * KINDS.index(kind) + seed)
    return pair_of(kind, rng), rng


@each("made_pair", CASES, with_generator)
def test_tangential_velocity_is_that_of_the_common_point(made_pair):
    """T . u from rigid-body kinematics at the contact point; a rigid motion of both bodies together gives none."""
    pair, rng = made_pair
    for _ in range(POSES):
        scatter(pair, rng)
        state = pair.assembly.state
        twist = np.vstack([rng.normal(size=(2, 6)), np.zeros(6)])
        _, point, frame = pair.found()
        at = [twist[k, :3] + np.cross(state.R[k] @ twist[k, 3:], point - state.x[k]) for k in (pair.a, pair.b)]
        np.testing.assert_allclose(pair.speed(twist), frame @ (at[0] - at[1]), atol=1e-12)
        v, spin = rng.normal(size=(2, 3))
        for k in (pair.a, pair.b):
            twist[k] = [*(v + np.cross(spin, state.x[k])), *(state.R[k].T @ spin)]
        np.testing.assert_allclose(pair.speed(twist), 0, atol=1e-12)


@each("made_pair", CASES, with_generator)
def test_whitened_rows_give_the_relative_velocity(made_pair):
    """G M^-1/2 applied to M^1/2 v is G v, with M^1/2 = sqrt(m) and L' of the file's inertia."""
    pair, rng = made_pair
    bodies = pair.assembly.model.bodies
    problem = pair.assembly.problem
    for _ in range(10):
        scatter(pair, rng)
        twist = np.vstack([rng.normal(size=(2, 6)), np.zeros(6)])
        u = pair.speed(twist)
        state, work = pair.assembly.state, pair.assembly.work
        whitened_rows(bodies, pair.assembly.model.contacts, state.x, state.R, work.sites, 0, problem.rows, 0)
        white = np.zeros(16)
        for k in (pair.a, pair.b):
            at = 8 * bodies.node[k]
            white[at : at + 3] = np.sqrt(bodies.mass[k]) * twist[k, :3]
            white[at + 3 : at + 6] = np.linalg.cholesky(bodies.inertia[k]).T @ twist[k, 3:]
        rows = dense_rows(problem.rows.node[:1], problem.rows.G[:1], 16)[0]
        np.testing.assert_allclose(rows @ white, u, atol=1e-12)


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
    find_contacts(assembly.model.contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)
    whitened_rows(assembly.model.bodies, assembly.model.contacts, state.x, state.R, work.sites, 0, problem.rows, 0)
    assert problem.rows.node[0].tolist() == [0, -1]
    np.testing.assert_allclose(problem.rows.G[0, 0, :6], [0, 0, 1 / np.sqrt(2), 0, 0, 0], atol=1e-15)
