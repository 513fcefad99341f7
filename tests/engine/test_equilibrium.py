"""Contact forces at rest: they balance the loads, lie in Coulomb's cones, and follow from the pose alone."""

import numpy as np
import pytest

from engine import load_mechanism, simulate
from engine.assembly import Assembly, assemble
from engine.equilibrium import forces_at_rest
from engine.execution import execute
from engine.friction.arrays import CONVERGED
from engine.friction.problem import FrictionProblem, solver_arrays
from engine.friction.solver import solve_friction
from engine.kernels.loads import apply_loads
from engine.kernels.statics import COMPLIANCE, HELD, REFINEMENTS, effect_on_bodies, hold_loads
from engine.mechanism import Mechanism
from tests.engine.small import FLOOR, GRAVITY, made, small


def settled(mechanism: Mechanism) -> Assembly:
    """Run a mechanism to rest and return its arrays."""
    assembly = assemble(mechanism)
    assert execute(mechanism, assembly, False, None).status == "ok"
    return assembly


@pytest.fixture(scope="module")
def c60() -> tuple[Mechanism, Assembly]:
    """Return the C-60 at rest in its last phase."""
    mechanism = load_mechanism("c60")
    return mechanism, settled(mechanism)


def touching_gap(mechanism: Mechanism) -> float:
    """Return the gap below which contacts touch in a run of the mechanism."""
    return max(mechanism.simulation.penetration, mechanism.simulation.rest.drift)


def forces(mechanism: Mechanism, assembly: Assembly) -> np.ndarray:
    """Return the forces (N, T1, T2) at rest in the last phase."""
    found = forces_at_rest(assembly, len(mechanism.phases) - 1, mechanism.simulation.step, touching_gap(mechanism))
    assert found is not None
    return found


def unbalance(mechanism: Mechanism, assembly: Assembly, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each body's remaining force and moment about its centre of mass, contacts and loads together."""
    model, state, work = assembly.model, assembly.state, assembly.work
    apply_loads(
        model.bodies, model.loads, model.time_laws, state, len(mechanism.phases) - 1, 0.0, work.wrench, work.vectors
    )
    left = work.wrench.copy()
    world = np.einsum("ckj,ck->cj", work.sites.frame, found)
    for c, force in enumerate(world):
        for body, sign in ((model.contacts.a[c], 1.0), (model.contacts.b[c], -1.0)):
            left[body, :3] += sign * force
            left[body, 3:] += sign * np.cross(work.sites.point[c] - state.x[body], force)
    return left[:-1, :3], left[:-1, 3:]


def test_c60_is_in_balance(c60):
    """Force and moment of every body: zero to 1e-6 of the largest load."""
    mechanism, assembly = c60
    found = forces(mechanism, assembly)
    force, moment = unbalance(mechanism, assembly, found)
    assert np.abs(force).max() <= 1e-6 * np.abs(found).max()
    largest = np.abs(unbalance(mechanism, assembly, np.zeros_like(found))[1]).max()
    assert np.abs(moment).max() <= 1e-6 * largest


def test_c60_forces_lie_in_their_cones(c60):
    """Each N >= 0 and |T| <= mu N; open contacts carry nothing; some contacts use their friction."""
    mechanism, assembly = c60
    found, mu = forces(mechanism, assembly), assembly.model.laws.mu
    tangential = np.linalg.norm(found[:, 1:], axis=1)
    largest = np.abs(found).max()
    assert found[:, 0].min() >= -1e-7 * largest
    assert np.all(tangential <= mu * found[:, 0] + 1e-7 * largest)
    assert not found[assembly.work.gap > 1e-6].any()
    assert tangential.max() > 1e-3 * largest


def test_c60_forces_do_not_depend_on_the_last_impulses(c60):
    """Other impulses left over from the run, on the same contacts: the same forces to the bit."""
    mechanism, assembly = c60
    kept, first = assembly.state.r.copy(), forces(mechanism, assembly)
    rng = np.random.default_rng(1)
    for scale in (1e-3, 7.0, rng.uniform(0.1, 10, size=kept.shape)):
        assembly.state.r[:] = kept * scale
        np.testing.assert_array_equal(forces(mechanism, assembly), first)
    assembly.state.r[:] = kept


def test_c60_forces_are_those_of_springs_that_are_bodies_of_their_own(c60):
    """Each contact through a spring with three velocities of its own, solved to 1e-12: the same to 1e-6."""
    mechanism, assembly = c60
    found, h = forces(mechanism, assembly), 1e-3 * mechanism.simulation.step
    status, nc = hold_loads(assembly.arrays, len(mechanism.phases) - 1, 0.0, h, touching_gap(mechanism))
    chosen, n = assembly.work.chosen[:nc], assembly.problem.w.size
    effect = np.zeros((3 * nc, n))
    effect_on_bodies(assembly.problem.rows, np.arange(nc), effect)
    compliance = COMPLIANCE[0] * np.sum(effect**2) / (3 * nc)
    G = np.hstack([effect, np.sqrt(compliance) * np.eye(3 * nc)])
    springs, _ = solver_arrays(FrictionProblem(np.eye(n + 3 * nc), G, np.zeros(3 * nc), np.zeros(nc)))
    q, carried = assembly.work.q[chosen].copy(), np.zeros((nc, 3))
    springs.mu[:] = assembly.model.laws.mu[chosen]
    for _ in range(1 + REFINEMENTS):
        springs.q[:] = q - compliance * carried
        assert solve_friction(nc, springs, 1e-12)[0] == CONVERGED
        carried = springs.r.copy()
    assert status == HELD
    np.testing.assert_allclose(found[chosen], carried / h, atol=1e-6 * np.abs(found).max())


def test_contact_force_of_a_run_is_the_one_at_rest(c60):
    """FC-1 of a run is the normal force of C7 among the forces at rest."""
    mechanism, assembly = c60
    at = assembly.contact_names.index("C7")
    assert simulate(mechanism).responses["FC-1"] == pytest.approx(forces(mechanism, assembly)[at, 0], rel=1e-12)


def table(legs: list[tuple[float, float]], centre: tuple[float, float], friction: float) -> Mechanism:
    """Describe a table on the floor with its centre of mass off the middle."""
    return made(
        small(
            gravity=[0, 0, -GRAVITY],
            bodies={
                "ground": {"fixed": True},
                "table": {"mass": 3.0, "inertia": [0.5, 0.6, 0.7], "center_of_mass": [*centre, 0.4]},
            },
            contacts={
                f"leg_{i}": {
                    "a": {"body": "table", "point": [*leg, 0.0]},
                    "b": {"body": "ground", "plane": FLOOR},
                    "friction": friction,
                }
                for i, leg in enumerate(legs)
            },
            responses={f"leg_{i}": {"type": "contact_force", "contact": f"leg_{i}"} for i in range(len(legs))},
        )
    )


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("count", [4, 5, 9])
def test_hyperstatic_table_shares_its_weight_as_equal_springs(count, friction):
    """N_i = a + b x_i + c y_i, in balance: the forces of equal springs under a stiff top, to 1e-4."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.3
    legs = [(float(0.5 * np.cos(t)), float(0.3 * np.sin(t))) for t in angles]
    centre = (0.05, -0.02)
    run = simulate(table(legs, centre, friction))
    assert run.status == "ok", run.message
    rows = np.array([[1.0, x, y] for x, y in legs])
    plane = np.linalg.solve(rows.T @ rows, 3.0 * GRAVITY * np.array([1.0, *centre]))
    np.testing.assert_allclose(list(run.responses.values()), rows @ plane, rtol=1e-4)


def test_three_legs_are_statically_determinate():
    """By the lever rule, whatever the friction."""
    legs, centre = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], (0.3, 0.2)
    run = simulate(table(legs, centre, 0.4))
    np.testing.assert_allclose(list(run.responses.values()), 3.0 * GRAVITY * np.array([0.5, 0.3, 0.2]), rtol=1e-5)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_leg_that_carries_nothing_may_carry(friction):
    """Equal springs give the fourth of four legs 0 N; it touches, so it may take up to what its neighbours carry."""
    legs = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
    data = table(legs, (-0.5, -0.5), friction).model_dump(by_alias=True, exclude_unset=True)
    weight, most = 3.0 * GRAVITY, {"leg_0": 0.75, "leg_1": 0.25, "leg_2": 0.25, "leg_3": 0.25}
    for leg in most:
        for bound in ("least", "largest"):
            data["responses"][f"{leg}_{bound}"] = {"type": "contact_force", "contact": leg, "bound": bound}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["leg_3"] == pytest.approx(0.0, abs=1e-6)
    for leg, share in most.items():
        assert run.responses[f"{leg}_largest"] == pytest.approx(share * weight, rel=1e-6)
        assert run.responses[f"{leg}_least"] == pytest.approx((share - 0.25) * weight, rel=1e-6, abs=1e-6)


def test_pose_that_friction_cannot_hold_has_no_forces():
    """A block on a slope above its angle of friction: no balance, None."""
    mechanism = load_mechanism("incline")
    held = settled(mechanism)
    held.model.laws.mu[:] = 0.3
    assert forces_at_rest(held, 0, mechanism.simulation.step, mechanism.simulation.penetration) is None


def test_block_on_the_slope_feels_its_weight_and_friction():
    """Corner forces of the shipped incline: sum m g cos 30 across, m g sin 30 along, the lower corners more."""
    mechanism = load_mechanism("incline")
    assembly = settled(mechanism)
    found = forces(mechanism, assembly)
    world = np.einsum("ckj,ck->cj", assembly.work.sites.frame, found).sum(axis=0)
    np.testing.assert_allclose(world, [0, 0, GRAVITY], atol=1e-4)
    assert found[:, 0].sum() == pytest.approx(GRAVITY * np.cos(np.pi / 6), rel=1e-5)
    lower, upper = found[[0, 3], 0], found[[1, 2], 0]
    # moments about the middle of the base: (lower - upper) 0.1 = m g sin 30 0.05
    assert lower.sum() - upper.sum() == pytest.approx(0.5 * GRAVITY * np.sin(np.pi / 6), rel=1e-4)


def test_ideal_joint_and_contact_share_the_weight():
    """A beam of 2 kg on a hinge at one end, a stop under the other: half the weight each; and none without the stop.

    A second beam hangs from the first by a hinge one quarter along: the stop carries a quarter of it too.
    """
    hinge = {"point": [0, 0, 0], "axis": [0, 1, 0]}
    beam = {"mass": 2.0, "inertia": [0.01, 0.2, 0.2], "center_of_mass": [0.5, 0, 0]}
    hung = {"mass": 1.0, "inertia": [0.1, 0.1, 0.01], "center_of_mass": [0, 0, -0.3], "origin": [0.25, 0, 0]}
    data = small(
        gravity=[0, 0, -GRAVITY],
        bodies={"ground": {"fixed": True}, "beam": beam, "hung": hung},
        joints={
            "A": {"type": "revolute", "bearing": {"body": "ground", **hinge}, "journal": {"body": "beam", **hinge}},
            "B": {
                "type": "revolute",
                "bearing": {"body": "beam", **hinge, "point": [0.25, 0, 0]},
                "journal": {"body": "hung", **hinge},
            },
        },
        contacts={
            "stop": {
                "a": {"body": "beam", "point": [1, 0, 0]},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": 0.3,
            }
        },
        responses={"force": {"type": "contact_force", "contact": "stop"}},
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["force"] == pytest.approx((0.5 * 2 + 0.25) * GRAVITY, rel=1e-9)
    data["contacts"]["stop"]["a"]["point"] = [1, 0, 1e-3]  # out of reach: nothing but the joints
    assembly = assemble(made(data))
    assert forces_at_rest(assembly, 0, 1e-3, 1e-8) is None
