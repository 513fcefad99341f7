"""Springs, gravity and constant loads: forces against the gradient of a potential written here."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.kernels.loads import apply_loads, potential_energy
from tests.each import each
from tests.engine.small import made, place, small

RNG_SEEDS = range(8)
A_POINT, B_POINT = np.array([0.3, -0.2, 0.5]), np.array([-0.4, 0.6, 0.1])
CENTRES = {"a": np.array([0.1, 0.2, -0.1]), "b": np.array([-0.2, 0.05, 0.15])}
MASS = {"a": 2.0, "b": 3.0}
LINEAR = {
    "type": "linear",
    "a": {"body": "a", "point": A_POINT.tolist()},
    "b": {"body": "b", "point": B_POINT.tolist()},
    "stiffness": 7.0,
    "free_length": 1.2,
}
AXIS = np.array([1.0, -2.0, 2.0]) / 3
TORSION = {
    "type": "torsion",
    "a": "a",
    "b": "b",
    "axis": AXIS.tolist(),
    "stiffness": 5.0,
    "free_angle": 0.4,
    "preload": 0.3,
}


def two_bodies(**tables: Any) -> Assembly:
    """Make two free bodies whose centres of mass are not their origins; body axes are the world's at the start."""
    bodies = {
        name: {"mass": MASS[name], "inertia": [1, 1.2, 1.4], "center_of_mass": centre.tolist()}
        for name, centre in CENTRES.items()
    }
    return assemble(made(small(bodies=bodies, **tables)))


def numbers(assembly: Assembly) -> list[int]:
    """Return the numbers of a and b in the arrays, by their mass: assembly orders bodies as it likes."""
    return np.argsort(assembly.model.bodies.mass).tolist()


def pose(assembly: Assembly) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions and rotations of a and b."""
    order = numbers(assembly)
    return assembly.state.x[order], assembly.state.R[order]


def wrench(assembly: Assembly, phase: int = 0, t: float = 0.0) -> np.ndarray:
    """Return force and torque about the centre of mass, of a and of b."""
    model, state, work = assembly.model, assembly.state, assembly.work
    apply_loads(model.bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    return work.wrench[numbers(assembly)]


def scatter(assembly: Assembly, rng: np.random.Generator) -> None:
    """Put both bodies anywhere, at rest."""
    for body in range(2):
        place(assembly, body, 2 * rng.normal(size=3), Rotation.random(random_state=rng))
    assembly.state.v[:] = 0


def gradient(assembly: Assembly, potential: Any, d: float = 1e-5) -> np.ndarray:
    """Differentiate a potential by a shift and a turn (world axes) of each body: shape (2, 6)."""
    slope = np.zeros((2, 6))
    for row, body in enumerate(numbers(assembly)):
        x = assembly.state.x[body].copy()
        rotation = Rotation.from_matrix(assembly.state.R[body])
        for k in range(6):
            values = []
            for way in (d, -d):
                shift, spin = np.zeros(3), np.zeros(3)
                (shift if k < 3 else spin)[k % 3] = way
                place(assembly, body, x + shift, Rotation.from_rotvec(spin) * rotation)
                values.append(potential(assembly))
            slope[row, k] = (values[0] - values[1]) / (2 * d)
        place(assembly, body, x, rotation)
    return slope


def length(assembly: Assembly) -> float:
    """Distance of the linear spring's two points."""
    x, R = pose(assembly)
    a, b = x[0] + R[0] @ (A_POINT - CENTRES["a"]), x[1] + R[1] @ (B_POINT - CENTRES["b"])
    return float(np.linalg.norm(b - a))


def stretched(assembly: Assembly) -> float:
    """Potential of the linear spring."""
    return 0.5 * 7.0 * (length(assembly) - 1.2) ** 2


def wound(assembly: Assembly) -> float:
    """Potential of the torsion spring, by the rotation vector's part along the axis."""
    _, R = pose(assembly)
    turn = Rotation.from_matrix(R[0].T @ R[1])
    w, v = (q := turn.as_quat(canonical=True))[3], q[:3]
    angle = 2 * np.arctan2(v @ AXIS, w)
    return 0.5 * 5.0 * (angle - 0.4 + 0.3) ** 2


def stored(assembly: Assembly) -> float:
    """Potential energy of gravity and springs, by the kernel."""
    return float(
        potential_energy(assembly.model.bodies, assembly.model.loads, assembly.model.time_laws, assembly.state)
    )


def stretched_to(length: float, speed: float = 0.0, **spring: Any) -> tuple[float, float]:
    """Return the push of a linear spring (k = 7, free length 1.2) of some length and speed, and its energy."""
    ends = {"a": {"body": "a", "point": [0, 0, 0]}, "b": {"body": "b", "point": [length, 0, 0]}}
    assembly = two_bodies(springs={"S": {**LINEAR, **ends, **spring}})
    assembly.state.v[numbers(assembly)[1], 0] = speed
    loads = wrench(assembly)
    np.testing.assert_allclose(loads[0, :3], -loads[1, :3])
    return float(loads[1, 0]), stored(assembly)


def check_action_is_reaction(assembly: Assembly) -> None:
    """Assert that forces, and moments about the world's origin, sum to zero."""
    loads, (x, _) = wrench(assembly), pose(assembly)
    np.testing.assert_allclose(loads[:, :3].sum(axis=0), 0, atol=1e-12)
    moment = loads[:, 3:].sum(axis=0) + np.cross(x, loads[:, :3]).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=1e-12)


@each("seed", RNG_SEEDS)
def test_linear_spring_is_the_gradient_of_its_energy(seed):
    """Force and torque on both bodies, stretched or compressed, from 1/2 k (length - free length)^2."""
    assembly = two_bodies(springs={"S": LINEAR})
    scatter(assembly, np.random.default_rng(seed))
    np.testing.assert_allclose(wrench(assembly), -gradient(assembly, stretched), atol=1e-7)
    check_action_is_reaction(assembly)


def test_linear_spring_pushes_when_compressed():
    """The sign, by hand: points 0.5 apart, free length 1.2, k = 7: b is pushed away with 4.9."""
    spring = {**LINEAR, "a": {"body": "a", "point": [0, 0, 0]}, "b": {"body": "b", "point": [0.5, 0, 0]}}
    loads = wrench(two_bodies(springs={"S": spring}))
    np.testing.assert_allclose(loads[:, :3], [[-4.9, 0, 0], [4.9, 0, 0]], atol=1e-12)


SPRINGS = [
    # acts, preload, length, push, energy
    ("both", 0.0, 0.5, 4.9, 4.9**2 / 14),
    ("both", 2.0, 0.5, 6.9, 6.9**2 / 14),
    ("both", 0.0, 2.2, -7.0, 3.5),
    ("push", 0.0, 0.5, 4.9, 4.9**2 / 14),
    ("push", 0.0, 1.3, 0.0, 0.0),
    ("push", 2.0, 1.3, 1.3, 1.3**2 / 14),
    ("push", -2.0, 1.0, 0.0, 0.0),
    ("pull", 0.0, 0.5, 0.0, 0.0),
    ("pull", 0.0, 2.2, -7.0, 3.5),
    ("pull", -2.0, 1.0, -0.6, 0.6**2 / 14),
]


@each(("acts", "preload", "length", "push", "energy"), SPRINGS)
def test_springs_with_preload_and_of_one_way(acts, preload, length, push, energy):
    """Force k (free length - length) + preload where the spring acts that way, by hand; energy force^2 / 2 k."""
    found = stretched_to(length, acts=acts, preload=preload)
    assert found == pytest.approx((push, energy), abs=1e-12)


@each(
    ("acts", "length", "speed", "push"),
    [
        ("push", 1.0, 0.5, 1.4 - 0.4),  # lengthens: the damper pulls, less than the spring pushes
        ("push", 1.0, -0.5, 1.4 + 0.4),
        ("push", 1.0, 3.0, 0.0),  # the damper would pull more: it lifts off
        ("push", 1.4, -3.0, 0.0),  # has lifted off: no damping
        ("pull", 1.4, 0.5, -1.4 - 0.4),
        ("pull", 1.4, -3.0, 0.0),
        ("pull", 1.0, 3.0, 0.0),  # slack
        ("both", 1.0, 3.0, 1.4 - 2.4),
    ],
)
def test_damping_of_a_spring_of_one_way_never_acts_the_other_way(acts, length, speed, push):
    """Damping 0.8 and stiffness 7 at 0.2 from the free length, at some speed of the length."""
    assert stretched_to(length, speed, acts=acts, damping=0.8)[0] == pytest.approx(push, abs=1e-12)


@each("seed", RNG_SEEDS)
@each("acts", ["both", "push", "pull"])
def test_loads_are_the_gradient_of_the_potential_energy(acts, seed):
    """Weight and linear springs with a preload, at any pose."""
    spring = {**LINEAR, "free_length": 3.0, "preload": 2.0, "acts": acts}
    assembly = two_bodies(springs={"S": spring}, gravity=[1.0, 2.0, -3.0])
    scatter(assembly, np.random.default_rng(seed))
    np.testing.assert_allclose(wrench(assembly), -gradient(assembly, stored), atol=1e-7)


def test_potential_energy_by_hand():
    """M g z of a body 5 above the origin, plus a torsion spring 0.7 from its free angle."""
    torsion = {**TORSION, "a": "ground", "b": "c", "free_angle": -0.4, "preload": 0.3}
    data = small(
        bodies={"ground": {"fixed": True}, "c": {"mass": 3.0, "inertia": [1, 1, 1], "origin": [2, 0, 5]}},
        springs={"S": torsion},
        gravity=[0, 0, -2.0],
    )
    assert stored(assemble(made(data))) == pytest.approx(30.0 + 0.5 * 5.0 * 0.7**2, rel=1e-14)


@each("seed", RNG_SEEDS)
def test_torsion_couple_is_the_slope_of_the_potential_energy(seed):
    """Along turns about the spring's axis, for the pair turned anyhow in the world."""
    assembly, rng = two_bodies(springs={"S": TORSION}), np.random.default_rng(seed)
    scatter(assembly, rng)
    (x, R), b, angle, d = pose(assembly), numbers(assembly)[1], rng.uniform(-3, 3), 1e-5

    def energy_at(phi: float) -> float:
        place(assembly, b, x[1], Rotation.from_matrix(R[0]) * Rotation.from_rotvec(phi * AXIS))
        return stored(assembly)

    slope = (energy_at(angle + d) - energy_at(angle - d)) / (2 * d)
    energy_at(angle)
    assert wrench(assembly)[1, 3:] @ R[0] @ AXIS == pytest.approx(-slope, abs=1e-8)


@each("seed", RNG_SEEDS)
@each("spring", [LINEAR, TORSION])
def test_a_damper_is_the_damping_of_a_spring(spring, seed):
    """A spring with damping is a spring and a damper side by side; the damper stores nothing."""
    damper = {key: value for key, value in spring.items() if key in ("type", "a", "b", "axis")}
    one = two_bodies(springs={"S": {**spring, "damping": 0.8}})
    two = two_bodies(springs={"S": spring}, dampers={"D": {**damper, "damping": 0.8}})
    for assembly in (one, two):
        scatter(assembly, np.random.default_rng(seed))
        assembly.state.v[:2] = np.random.default_rng(seed).normal(size=(2, 6))
    assert np.abs(wrench(two_bodies(dampers={"D": {**damper, "damping": 0.8}}))).max() == 0, "at rest"
    np.testing.assert_allclose(wrench(two), wrench(one), atol=1e-13)
    assert stored(two) == stored(one)


@each("seed", RNG_SEEDS)
def test_torsion_spring_is_the_gradient_of_its_energy(seed):
    """Body b turned about the spring's axis by any angle, the pair turned anyhow in the world."""
    assembly, rng = two_bodies(springs={"S": TORSION}), np.random.default_rng(seed)
    scatter(assembly, rng)
    turn = Rotation.from_rotvec(rng.uniform(-3, 3) * AXIS)
    x, R = pose(assembly)
    place(assembly, numbers(assembly)[1], x[1], Rotation.from_matrix(R[0]) * turn)
    np.testing.assert_allclose(wrench(assembly), -gradient(assembly, wound), atol=1e-7)
    check_action_is_reaction(assembly)


@each("seed", RNG_SEEDS)
def test_torsion_spring_is_a_pure_balanced_couple_at_any_pose(seed):
    """Also when the bodies are turned across the axis: no force, opposite torques along a's axis."""
    assembly = two_bodies(springs={"S": TORSION})
    scatter(assembly, np.random.default_rng(seed))
    loads = wrench(assembly)
    assert not loads[:, :3].any()
    check_action_is_reaction(assembly)
    axis = pose(assembly)[1][0] @ AXIS
    np.testing.assert_allclose(np.cross(loads[1, 3:], axis), 0, atol=1e-12)
    assert np.linalg.norm(loads[1, 3:]) > 1e-3


@pytest.mark.parametrize(("start", "angle"), [(0.0, 3.0), (2.9, 3.6), (-2.9, -4.0), (3.0, 0.2), (4.0, 5.5)])
def test_torsion_spring_counts_from_the_start_angle(start, angle):
    """Winding past half a turn goes on winding: the branch is the one nearest to the start."""
    data = small(
        bodies={"a": {"fixed": True}, "b": {"mass": 1.0, "inertia": [1, 1, 1], "axis": AXIS.tolist(), "angle": start}},
        springs={"S": TORSION},
    )
    assembly = assemble(made(data))
    place(assembly, 0, np.zeros(3), Rotation.from_rotvec(angle * AXIS))
    assert wrench(assembly)[0, 3:] @ AXIS == pytest.approx(-5.0 * (angle - 0.4 + 0.3), rel=1e-12)


@each("seed", RNG_SEEDS)
@each("fixed", ["a", "b"])
def test_torsion_spring_to_a_fixed_body_that_is_turned(fixed, seed):
    """The frames as the file places them: b turned by phi about the axis from a; then turned further."""
    rng = np.random.default_rng(seed)
    a, phi, more = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), rng.uniform(-1.5, 1.5), rng.uniform(-1, 1)
    bodies = {}
    for name, attitude in (("a", a), ("b", a * Rotation.from_rotvec(phi * AXIS))):
        vector = attitude.as_rotvec()
        angle = float(np.linalg.norm(vector))
        own = {"fixed": True} if name == fixed else {"mass": 1.0, "inertia": [1, 1, 1]}
        bodies[name] = {**own, "axis": (vector / angle).tolist(), "angle": angle}
    assembly = assemble(made(small(bodies=bodies, springs={"S": TORSION})))
    axis, sign = a.apply(AXIS), 1 if fixed == "a" else -1
    np.testing.assert_allclose(wrench(assembly)[0, 3:], -sign * 5.0 * (phi - 0.1) * axis, atol=1e-13)
    turn = Rotation.from_rotvec(sign * more * axis)
    place(assembly, 0, np.zeros(3), turn * Rotation.from_matrix(assembly.state.R[0]))
    np.testing.assert_allclose(wrench(assembly)[0, 3:], -sign * 5.0 * (phi + more - 0.1) * axis, atol=1e-13)


@each("seed", RNG_SEEDS)
@each("spring", [LINEAR, TORSION])
def test_damping_dissipates_and_rigid_motion_feels_none(spring, seed):
    """The damper's power is - c rate^2, with the rate from finite differences; together as one body: nothing."""
    damped, bare = (two_bodies(springs={"S": {**spring, "damping": c}}) for c in (0.8, 0.0))
    for assembly in (damped, bare):
        scatter(assembly, np.random.default_rng(seed))
    order = numbers(damped)
    twist, dt = np.random.default_rng(100 + seed).normal(size=(2, 6)), 1e-6
    damped.state.v[order] = bare.state.v[order] = twist
    x, R = pose(damped)
    load = wrench(damped) - wrench(bare)
    spin = np.einsum("kij,kj->ki", R, twist[:, 3:])
    power = float((load[:, :3] * twist[:, :3]).sum() + (load[:, 3:] * spin).sum())
    rate = float((spin[1] - spin[0]) @ (R[0] @ AXIS))
    if spring is LINEAR:
        lengths = []
        for way in (dt, -dt):
            for k in range(2):
                turn = Rotation.from_rotvec(way * spin[k]) * Rotation.from_matrix(R[k])
                place(bare, order[k], x[k] + way * twist[k, :3], turn)
            lengths.append(length(bare))
        rate = (lengths[0] - lengths[1]) / (2 * dt)
    assert power == pytest.approx(-0.8 * rate**2, rel=1e-6)


@pytest.mark.parametrize("spring", [LINEAR, TORSION], ids=["linear", "torsion"])
def test_damper_feels_no_rigid_motion(spring):
    """Both bodies moving as one: the same loads as at rest."""
    assembly = two_bodies(springs={"S": {**spring, "damping": 0.8}})
    scatter(assembly, np.random.default_rng(1))
    x, R = pose(assembly)
    at_rest, common = wrench(assembly), np.array([0.3, -0.7, 0.2])
    for k, body in enumerate(numbers(assembly)):
        assembly.state.v[body] = [*np.cross(common, x[k]), *(R[k].T @ common)]
    np.testing.assert_allclose(wrench(assembly), at_rest, atol=1e-12)


def scattered(seed: int, **tables: Any) -> Assembly:
    """Make two bodies, put them anywhere and set them moving; the same for the same seed."""
    assembly, rng = two_bodies(**tables), np.random.default_rng(seed)
    scatter(assembly, rng)
    assembly.state.v[:2] = rng.normal(size=(2, 6))
    return assembly


@each("seed", RNG_SEEDS)
def test_actions_that_say_what_a_torsion_spring_does(seed):
    """A couple on b, as two forces, and the opposite torque on a: with the axis along z of both, the same loads.

    Where the axes are not parallel the torque on b stays in b's axes; on a it is the spring's own.
    """
    spring = {**TORSION, "axis": [0, 0, 1], "damping": 0.8}
    actions = [
        {"body": "a", "torque": [0, 0, -1]},
        {"body": "b", "point": [0.5, 0.3, 0.2], "force": [0, 2.5, 0]},
        {"body": "b", "point": [0.1, 0.3, 0.2], "force": [0, -2.5, 0]},
    ]
    usual, told = (scattered(seed, springs={"S": s}) for s in (spring, {**spring, "actions": actions}))
    np.testing.assert_allclose(wrench(told)[0], wrench(usual)[0], atol=1e-13)
    torque = -wrench(usual)[0, 3:] @ pose(usual)[1][0][:, 2]
    assert abs(torque) > 1e-2
    np.testing.assert_allclose(wrench(told)[1], [0, 0, 0, *(torque * pose(told)[1][1][:, 2])], atol=1e-13)
    assert (stored(usual) > 0, stored(told)) == (True, 0.0)


@each("seed", RNG_SEEDS)
def test_actions_that_say_what_a_linear_spring_does(seed):
    """Between points on the axes of two bodies that keep their attitude: pushed apart along x, as without actions."""
    ends = {name: {"body": name, "point": [x, 0.2, 0.1]} for name, x in (("a", 0.3), ("b", 1.7))}
    spring = {**LINEAR, **ends, "damping": 0.8, "preload": 1.0}
    actions = [{**ends["a"], "force": [-1, 0, 0]}, {**ends["b"], "force": [1, 0, 0]}]
    usual, told = (two_bodies(springs={"S": s}) for s in (spring, {**spring, "actions": actions}))
    for assembly in (usual, told):
        b = numbers(assembly)[1]
        assembly.state.x[b, 0] += np.random.default_rng(seed).uniform(-1, 1)
        assembly.state.v[:2, 0] = np.random.default_rng(seed).normal(size=2)
    assert np.abs(wrench(usual)).max() > 0.1
    np.testing.assert_allclose(wrench(told), wrench(usual), atol=1e-13)


def test_a_spring_with_actions_stands_beside_others():
    """Each spring has its own: linear or torsion, with actions or without, and a damper between them."""
    lean = {**LINEAR, "actions": [{"body": "a", "torque": [0.0, 1.5, 0.0]}]}
    wind = {**TORSION, "actions": [{"body": "b", "point": B_POINT.tolist(), "force": [0.0, 0.2, 0.0]}]}
    damper = {"type": "linear", "a": LINEAR["a"], "b": LINEAR["b"], "damping": 0.8}
    springs = {"one": TORSION, "two": lean, "three": wind, "four": LINEAR}
    alone = [wrench(scattered(0, springs={"S": s})).copy() for s in springs.values()]
    alone.append(wrench(scattered(0, dampers={"D": damper})).copy())
    together = scattered(0, springs=springs, dampers={"D": damper})
    np.testing.assert_allclose(wrench(together), sum(alone), atol=1e-13)
    assert stored(together) == pytest.approx(stored(scattered(0, springs={"one": TORSION, "four": LINEAR})))


def test_gravity_is_the_weight_at_the_centre_of_mass():
    """Each body's m g, no torque."""
    loads = wrench(two_bodies(gravity=[1.0, 2.0, -3.0]))
    np.testing.assert_array_equal(loads[0], [2.0, 4.0, -6.0, 0, 0, 0])
    np.testing.assert_array_equal(loads[1], [3.0, 6.0, -9.0, 0, 0, 0])


@each("seed", RNG_SEEDS)
@each("frame", ["world", "body"])
def test_constant_force_acts_at_its_point(frame, seed):
    """F and (point - centre of mass) x F, the force in world or in body axes."""
    force, torque = [1.0, -2.0, 0.5], [0.3, 0.1, -0.7]
    assembly = two_bodies(
        forces={"F": {"body": "b", "point": B_POINT.tolist(), "force": force, "frame": frame}},
        torques={"T": {"body": "a", "torque": torque, "frame": frame}},
    )
    scatter(assembly, np.random.default_rng(seed))
    (_, R), loads = pose(assembly), wrench(assembly)
    f = R[1] @ force if frame == "body" else np.array(force)
    t = R[0] @ torque if frame == "body" else np.array(torque)
    np.testing.assert_allclose(loads[1, :3], f, atol=1e-14)
    np.testing.assert_allclose(loads[1, 3:], np.cross(R[1] @ (B_POINT - CENTRES["b"]), f), atol=1e-14)
    np.testing.assert_allclose(loads[0], [0, 0, 0, *t], atol=1e-14)


def test_body_frame_is_the_one_of_the_file():
    """A force in body axes turns with the frame as placed by axis and angle."""
    body = {"mass": 1.0, "inertia": [1, 1, 1], "axis": [0, 0, 1], "angle": np.pi / 2}
    data = small(bodies={"b": body}, forces={"F": {"body": "b", "force": [1, 0, 0], "frame": "body"}})
    np.testing.assert_allclose(wrench(assemble(made(data)))[0, :3], [0, 1, 0], atol=1e-15)


def test_loads_act_in_their_phases_only():
    """One load in the first phase, one in the second, one in all."""
    assembly = two_bodies(
        phases=[{"name": "hold", "duration": 0.1}, {"name": "free"}],
        forces={
            "first": {"body": "a", "point": CENTRES["a"].tolist(), "force": [1, 0, 0], "phases": ["hold"]},
            "all": {"body": "a", "point": CENTRES["a"].tolist(), "force": [0, 5, 0]},
        },
        torques={"second": {"body": "a", "torque": [0, 0, 2], "phases": ["free"]}},
    )
    np.testing.assert_allclose(wrench(assembly, 0)[0, [0, 1, 5]], [1, 5, 0], atol=1e-15)
    np.testing.assert_allclose(wrench(assembly, 1)[0, [0, 1, 5]], [0, 5, 2], atol=1e-15)
