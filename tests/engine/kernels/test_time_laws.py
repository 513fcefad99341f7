"""Laws of time against scipy's interpolation and closed forms, and the loads that follow them."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from engine.assembly import Assembly, assemble
from engine.assembly.loads import time_law_arrays
from engine.kernels.loads import apply_loads, time_law, time_law_rate
from engine.kernels.motion import free_twist, move
from tests.engine.small import made, small

SEEDS = range(6)
BODY = {"mass": 2.0, "inertia": [1, 1.2, 1.4]}


def driven(forces: Any = None, motions: Any = None, torques: Any = None) -> dict[str, Any]:
    """Describe one free body with forces, torques and motions that have the given laws."""
    return small(
        bodies={"b": BODY},
        forces={n: {"body": "b", "force": [1, -2, 0.5], "law": law} for n, law in (forces or {}).items()},
        torques={n: {"body": "b", "torque": [0, 3, 1], "law": law} for n, law in (torques or {}).items()},
        motions={n: {"body": "b", "along": {"direction": [1, 0, 0]}, "law": law} for n, law in (motions or {}).items()},
    )


def values(law: dict[str, Any], times: Any, owner: str = "forces") -> np.ndarray:
    """Evaluate a law, of a force or a motion, at many times."""
    laws, numbers = time_law_arrays(made(driven(**{owner: {"L": law}})))
    return np.array([time_law(laws, numbers[f"{owner}.L"], float(t)) for t in times])


def table(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw a table of n points at uneven times."""
    return np.cumsum(rng.uniform(0.05, 1, n)) - 0.3, rng.normal(size=n)


@pytest.mark.parametrize("seed", SEEDS)
def test_linear_table_is_numpy_s(seed):
    """Between the points, on them, and constant outside."""
    rng = np.random.default_rng(seed)
    t, y = table(rng, int(rng.integers(2, 30)))
    times = np.concatenate([t, rng.uniform(t[0] - 2, t[-1] + 2, 300)])
    law = {"table": np.column_stack([t, y]).tolist()}
    np.testing.assert_allclose(values(law, times), np.interp(times, t, y), atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_smooth_table_is_scipy_s_inside(seed):
    """PCHIP in all intervals but the first and the last, where it leaves from rest and comes to rest."""
    rng = np.random.default_rng(seed)
    t, y = table(rng, int(rng.integers(4, 30)))
    times = rng.uniform(t[1], t[-2], 300)
    law = {"table": np.column_stack([t, y]).tolist(), "interpolation": "smooth"}
    np.testing.assert_allclose(values(law, times), PchipInterpolator(t, y)(times), atol=1e-12)
    np.testing.assert_allclose(values(law, t), y, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_smooth_table_has_no_kink_and_no_overshoot(seed):
    """The slope on both sides of every point is the same, 0 at both ends; values stay between their neighbours."""
    rng, d = np.random.default_rng(seed), 1e-6
    t, y = table(rng, 8)
    law = {"table": np.column_stack([t, y]).tolist(), "interpolation": "smooth"}
    left, right = (values(law, t) - values(law, t - d)) / d, (values(law, t + d) - values(law, t)) / d
    np.testing.assert_allclose(left, right, atol=1e-2)  # curvature times d; a kink would be of order 1
    np.testing.assert_allclose(left[[0, -1]], 0, atol=1e-2)
    for i in range(7):
        inside = values(law, np.linspace(t[i], t[i + 1], 50))
        low, high = sorted(y[i : i + 2])
        assert inside.min() >= low - 1e-13
        assert inside.max() <= high + 1e-13


def test_smooth_table_of_two_points_is_the_smooth_step():
    """3 s^2 - 2 s^3."""
    s = np.linspace(0, 1, 21)
    law = {"table": [[0, 0], [2, 5]], "interpolation": "smooth"}
    np.testing.assert_allclose(values(law, 2 * s, "motions"), 5 * (3 - 2 * s) * s**2, atol=1e-14)


@pytest.mark.parametrize("speed", [{"frequency": 4.0}, {"period": 0.25}], ids=["frequency", "period"])
def test_sines(speed):
    """Of a force: about its mean; of a motion: 0 at the start, whatever the phase."""
    t = np.linspace(0, 3, 200)
    swing = 0.7 * np.sin(8 * np.pi * t + 0.4)
    law = {"amplitude": 0.7, "phase": 0.4, **speed}
    np.testing.assert_allclose(values({**law, "mean": 1.5}, t), 1.5 + swing, atol=1e-13)
    np.testing.assert_allclose(values(law, t), swing, atol=1e-13)
    np.testing.assert_allclose(values(law, t, "motions"), swing - swing[0], atol=1e-13)


def test_ramp_goes_on_for_ever():
    """The way speed t."""
    t = np.array([0.0, 1e-9, 0.3, 7.0, 1e9])
    np.testing.assert_allclose(values({"speed": -2.5}, t, "motions"), -2.5 * t, rtol=1e-15)


LAWS = {
    "linear": {"table": [[0, 0], [0.5, 2], [1.2, 1]]},
    "smooth": {"table": [[0, 0], [0.5, 2], [1.2, 1], [2, 4]], "interpolation": "smooth"},
    "sine": {"amplitude": 0.7, "frequency": 1.3, "phase": 0.4},
    "ramp": {"speed": -2.5},
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_rate_is_the_slope(law):
    """Against central differences, between the points and beyond the ends."""
    laws, numbers = time_law_arrays(made(driven(motions={"L": law})))
    number, d = numbers["motions.L"], 1e-6
    for t in np.random.default_rng(0).uniform(-0.5, 2.5, 100):
        slope = (time_law(laws, number, t + d) - time_law(laws, number, t - d)) / (2 * d)
        assert time_law_rate(laws, number, t) == pytest.approx(slope, abs=1e-7)


def test_every_owner_has_its_own_law():
    """Laws of several points, of sines and ramps side by side; what has none has no number."""
    data = driven(
        forces={"A": {"table": [[0, 1], [1, 2], [2, 4]]}, "B": {"amplitude": 1, "period": 4}},
        torques={"A": {"table": [[0, 5], [2, 6]]}},
        motions={"A": {"speed": 3}, "B": {"table": [[0, 0], [2, 8]]}},
    )
    data["forces"]["C"] = {"body": "b", "force": [0, 0, 1]}
    laws, numbers = time_law_arrays(made(data))
    found = {owner: float(time_law(laws, number, 1.0)) for owner, number in numbers.items()}
    expected = {"forces.A": 2.0, "forces.B": 1.0, "torques.A": 5.5, "motions.A": 3.0, "motions.B": 4.0}
    assert found == pytest.approx(expected, rel=1e-15)


def wrench(assembly: Assembly, t: float, phase: int = 0) -> np.ndarray:
    """Return force and torque on the body."""
    model, state, work = assembly.model, assembly.state, assembly.work
    apply_loads(model.bodies, model.loads, model.time_laws, state, phase, t, work.wrench, work.vectors)
    return work.wrench[0].copy()


@pytest.mark.parametrize("frame", ["world", "body"])
def test_force_and_torque_are_multiplied_with_their_law(frame):
    """Each with its own, in either frame, the force's moment too; one without a law stays constant."""
    turn = {"axis": [1, 2, 3], "angle": 0.8}
    law = {"table": [[1, 1], [3, -2]]}

    def loaded(first: Any, second: Any) -> Assembly:
        data = small(
            bodies={"b": {**BODY, **turn}},
            forces={
                "F": {"body": "b", "point": [0.1, 0.2, 0.3], "force": [1, -2, 0.5], "frame": frame, **first},
                "still": {"body": "b", "force": [0, 0.25, 0]},
            },
            torques={"T": {"body": "b", "torque": [0, 3, 1], "frame": frame, **second}},
        )
        return assemble(made(data))

    still = wrench(loaded({"law": {"table": [[0, 0], [1, 0]]}}, {"law": {"table": [[0, 0], [1, 0]]}}), 0.0)
    force = wrench(loaded({}, {"law": {"table": [[0, 0], [1, 0]]}}), 0.0) - still
    torque = wrench(loaded({"law": {"table": [[0, 0], [1, 0]]}}, {}), 0.0) - still
    np.testing.assert_allclose(still, [0, 0.25, 0, 0, 0, 0], atol=1e-15)
    assembly = loaded({"law": law}, {"law": {"amplitude": 2.0, "period": 4.0}})
    for t, factor in ((0.0, 1.0), (1.0, 1.0), (2.0, -0.5), (3.0, -2.0), (9.0, -2.0)):
        expected = still + factor * force + 2 * np.sin(np.pi * t / 2) * torque
        np.testing.assert_allclose(wrench(assembly, t), expected, atol=1e-14)


def test_a_law_does_not_outlast_the_phases_of_its_load():
    """Time is that of the run, and the phases still say when the load acts."""
    data = small(
        bodies={"b": BODY},
        phases=[{"name": "first", "duration": 1.0}, {"name": "second"}],
        forces={"F": {"body": "b", "force": [1, 0, 0], "law": {"table": [[0, 0], [2, 2]]}, "phases": ["second"]}},
    )
    assembly = assemble(made(data))
    assert wrench(assembly, 1.5, 0)[0] == 0
    assert wrench(assembly, 1.5, 1)[0] == 1.5


def stepped(data: dict[str, Any], h: float, steps: int) -> tuple[Assembly, list[np.ndarray]]:
    """Step the one body freely, its loads taken at mid-step; return its twists after each step."""
    assembly = assemble(made(data))
    model, state, work = assembly.model, assembly.state, assembly.work
    twists = []
    for k in range(steps):
        move(state, 0.5 * h)
        wrench(assembly, (k + 0.5) * h)
        free_twist(model.bodies, state.R, state.v, work.wrench, h, 0.5, False, work.free)
        state.v[:] = work.free
        move(state, 0.5 * h)
        twists.append(state.v[0].copy())
    return assembly, twists


def test_sine_force_on_a_free_mass_is_the_midpoint_sum():
    """Sum sin(w h (k + 1/2) + phi) = sin(n w h/2) sin(n w h/2 + phi) / sin(w h/2)."""
    h, n, phi, w = 0.01, 137, 0.3, 2 * np.pi * 1.7
    law = {"amplitude": 4.0, "frequency": 1.7, "phase": phi, "mean": 0.6}
    data = small(bodies={"b": BODY}, forces={"F": {"body": "b", "force": [0, 2.5, 0], "law": law}})
    total = 4.0 * np.sin(n * w * h / 2) * np.sin(n * w * h / 2 + phi) / np.sin(w * h / 2) + 0.6 * n
    _, twists = stepped(data, h, n)
    np.testing.assert_allclose(twists[-1], [0, 2.5 * h * total / 2.0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("kind", ["linear", "torsion"])
def test_dampers_slow_down_exponentially(kind):
    """exp(-c t/m) along the line, exp(-c t/I) about the axis, to first order in the step."""
    if kind == "linear":
        ends = {"a": {"body": "ground", "point": [-5, 0, 0]}, "b": {"body": "b", "point": [0, 0, 0]}}
        motion, k, inertia = {"velocity": [0.8, 0, 0]}, 0, 2.0
    else:
        ends = {"a": "ground", "b": "b", "axis": [0, 0, 1]}
        motion, k, inertia = {"angular_velocity": [0, 0, 0.8]}, 5, 1.4
    data = small(
        bodies={"ground": {"fixed": True}, "b": {**BODY, **motion}},
        dampers={"D": {"type": kind, **ends, "damping": 0.9}},
    )
    _, twists = stepped(data, 1e-3, 3000)
    expected = np.zeros(6)
    expected[k] = 0.8 * np.exp(-0.9 * 3.0 / inertia)
    np.testing.assert_allclose(twists[-1], expected, atol=1e-3 * expected[k])
