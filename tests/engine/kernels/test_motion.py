"""Free motion of a body against an independent integrator, and what a free body keeps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.assembly import Assembly, assemble
from engine.kernels.motion import EULER_STEPS, free_twist, move
from tests.engine.small import GRAVITY, energy, made, small

MOMENTS = np.array([1.0, 2.0, 2.9])
SPIN = np.array([0.02, 1.5, 0.01])  # about the middle axis: it tumbles over and over (Dzhanibekov)


def free_body(**body) -> Assembly:
    """Make one asymmetric body that nothing touches."""
    table = {"mass": 1.5, "inertia": MOMENTS.tolist(), "axis": [1, 2, 3], "angle": 0.7, **body}
    return assemble(made(small(bodies={"body": {"angular_velocity": SPIN.tolist(), **table}})))


def advance(assembly: Assembly, h: float, steps: int) -> None:
    """Make time steps without contacts: half a displacement, the free twist, the other half."""
    model, state, work = assembly.model, assembly.state, assembly.work
    for _ in range(steps):
        move(state, 0.5 * h)
        free_twist(model.bodies, state.R, state.v, work.wrench, h, 0.5, state.v, EULER_STEPS, work.free)
        state.v[:-1] = work.free[:-1]
        move(state, 0.5 * h)


def quaternion_rate(p: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Half the product p (0, spin)."""
    w, v = p[0], p[1:]
    return 0.5 * np.array([-v @ spin, *(w * spin + np.cross(v, spin))])


def exact(start: Assembly, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrate Euler's equations by DOP853; return quaternion and angular velocity (body axes)."""

    def rate(_, y):
        spin = y[4:]
        return [*quaternion_rate(y[:4], spin), *(-np.cross(spin, MOMENTS * spin) / MOMENTS)]

    y0 = [*start.state.p[0], *start.state.v[0, 3:]]
    y = solve_ivp(rate, (0, time), y0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return y[:4], y[4:]


def test_tumbling_body_is_second_order():
    """Half the step, a quarter of the error in attitude and spin, through several flips."""
    time, errors = 20.0, []
    p, spin = exact(free_body(), time)
    assert abs(SPIN[1] - spin[1]) > 0.5  # it did flip on the way
    for steps in (2000, 4000, 8000):
        assembly = free_body()
        advance(assembly, time / steps, steps)
        state = assembly.state
        errors.append([np.abs(state.p[0] - p).max(), np.abs(state.v[0, 3:] - spin).max()])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.15)
    assert np.max(errors[-1]) < 1e-3


def test_tumbling_body_keeps_energy_momentum_and_its_unit_quaternion():
    """Over 5000 steps of 0.015 rad: energy to 1e-9, momentum's size to 1e-9, its direction to second order."""
    assembly = free_body()
    state = assembly.state
    before, momentum = energy(assembly), state.R[0] @ (MOMENTS * state.v[0, 3:])
    drift = []
    for _ in range(50):
        advance(assembly, 0.01, 100)
        now = state.R[0] @ (MOMENTS * state.v[0, 3:])
        drift.append(np.linalg.norm(now - momentum) / np.linalg.norm(momentum))
        assert energy(assembly) == pytest.approx(before, rel=1e-9)
        assert np.linalg.norm(now) == pytest.approx(np.linalg.norm(momentum), rel=1e-9)
        assert np.linalg.norm(state.p[0]) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(state.R[0] @ state.R[0].T, np.eye(3), atol=1e-13)
    assert max(drift) < 2e-3


def test_large_rotation_in_one_displacement_is_exact():
    """A steady spin about any axis turns by its angle, however large the step."""
    assembly = free_body(angular_velocity=[0.3, -0.4, 1.2], axis=[0, 0, 1], angle=0.0)
    move(assembly.state, 2.0)
    angle = 2.0 * 1.3
    axis = np.array([0.3, -0.4, 1.2]) / 1.3
    expected = [np.cos(angle / 2), *(np.sin(angle / 2) * axis)]
    np.testing.assert_allclose(assembly.state.p[0], expected, atol=1e-15)


def test_slow_spin_is_not_lost():
    """Below the switch to the series: 1e-9 rad turn the quaternion by half of it."""
    assembly = free_body(angular_velocity=[0, 0, 1e-9], axis=[0, 0, 1], angle=0.0)
    move(assembly.state, 1.0)
    assert assembly.state.p[0, 3] == pytest.approx(0.5e-9, rel=1e-12)


def test_thrown_body_follows_its_parabola():
    """Constant force: the midpoint rule is exact for the centre of mass."""
    assembly = free_body(velocity=[1.0, 2.0, 3.0])
    assembly.work.wrench[0, 2] = -1.5 * GRAVITY
    advance(assembly, 0.01, 100)
    np.testing.assert_allclose(assembly.state.x[0], [1, 2, 3 - GRAVITY / 2], atol=1e-12)


def test_torque_in_world_axes_changes_the_momentum_by_its_impulse():
    """A constant torque on a tumbling body: L(t) - L(0) = M t in the world, to second order."""
    misses = []
    for steps in (500, 1000):
        assembly = free_body()
        state, torque = assembly.state, np.array([0.1, -0.2, 0.3])
        before = state.R[0] @ (MOMENTS * state.v[0, 3:])
        assembly.work.wrench[0, 3:] = torque
        advance(assembly, 5.0 / steps, steps)
        misses.append(np.abs(state.R[0] @ (MOMENTS * state.v[0, 3:]) - before - 5.0 * torque).max())
    assert misses[1] < 1e-4
    assert misses[0] / misses[1] == pytest.approx(4, rel=0.2)
