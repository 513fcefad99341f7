"""The energy that steps create is what no work explains, to the last digits; and no step creates much."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine import load_mechanism, simulate
from engine.arrays import Array
from tests.engine.assembly.pairs_of_bodies import body, joint
from tests.engine.histories import History, history
from tests.engine.linkages import LOOSE
from tests.engine.small import GRAVITY, block_on_floor, coordinates, made, shipped, small

SOME = settings(max_examples=10, deadline=None, derandomize=True)
seeds = st.integers(0, 100_000)
SHARE = 1e-3  # of the largest kinetic energy so far, that a step may create, as docs/method.md promises
LONG = {"adaptive": {"longest": 0.05, "travel": 0.2}}  # steps in which a pin slides far round its bore
CLEARANCES = {"radial_clearance", "axial_clearance", "clearance", "width_clearance"}


def loose_chain(seed: int, **simulation: Any) -> dict[str, Any]:
    """Describe three bodies that hang on each other by joints with play.

    Gravity is the only load: its work in a step is known, whatever the way. Bodies with equal moments of inertia have
    no gyroscopic moment.
    """
    rng = np.random.default_rng(seed)
    bodies: dict[str, Any] = {"ground": {"fixed": True}}
    bodies |= {f"body_{i}": body(rng) | {"inertia": [float(rng.uniform(0.1, 2.0))] * 3} for i in range(3)}
    joints = {}
    for i, pair in enumerate(itertools.pairwise(bodies)):
        found = joint(str(rng.choice(LOOSE)), bodies, pair, rng.normal(size=3), rng, True)
        found |= dict.fromkeys(CLEARANCES & found.keys(), 1e-3)
        joints[f"J{i}"] = found | {"friction": float(rng.choice([0.0, 0.1]))}
    return small(
        simulation={"step": 2e-3, "horizon": 0.5, "tolerance": 1e-11, "penetration": 1e-9, **simulation},
        gravity=[0, 0, -GRAVITY],
        bodies=bodies,
        joints=joints,
        responses=coordinates("body_2"),
    )


def thrown_cube(**simulation: Any) -> dict[str, Any]:
    """Throw a cube on the floor: it bounces on its corners, with friction."""
    data = block_on_floor(
        half=(0.1, 0.1, 0.1),
        friction=0.3,
        restitution=0.5,
        origin=[0, 0, 0.4],
        axis=[1, 2, 0.5],
        angle=0.6,
        velocity=[0.5, -0.3, -1.0],
        angular_velocity=[1.0, 2.0, -0.5],
    )
    data["simulation"] |= {"horizon": 0.6, "step": 4e-3, "tolerance": 1e-11, **simulation}
    return data


def kanes_pendulum(friction: float, restitution: float) -> dict[str, Any]:
    """Let the tip of a double pendulum, two rods of 1 m, strike a floor: Newton's law makes it quicker than it was."""
    angles, rates = np.radians([20.0, 30.0]), np.array([-1.0, -2.0])  # from the vertical; per second
    down, ahead = np.array([np.sin(angles), 0 * angles, -np.cos(angles)]), [np.cos(angles), 0 * angles, np.sin(angles)]
    height, ahead = np.cos(angles).sum() + 1e-3, np.array(ahead) * rates
    bodies: dict[str, Any] = {"ground": {"fixed": True}}
    for i, name in enumerate(("upper", "lower")):
        bodies[name] = {
            "mass": 1.0,
            "inertia": [1e-3, 1 / 12, 1 / 12],
            "origin": ([0, 0, height] + down[:, :i].sum(1) + 0.5 * down[:, i]).tolist(),
            "axis": [0, 1, 0],
            "angle": float(np.pi / 2 - angles[i]),
            "velocity": (ahead[:, :i].sum(1) + 0.5 * ahead[:, i]).tolist(),
            "angular_velocity": [0, -float(rates[i]), 0],
        }
    pins = {
        "hip": ("ground", [0, 0, float(height)], "upper", [-0.5, 0, 0]),
        "knee": ("upper", [0.5, 0, 0], "lower", [-0.5, 0, 0]),
    }
    return small(
        simulation={"step": 1e-4, "horizon": 0.01, "tolerance": 1e-10},
        bodies=bodies,
        joints={
            name: {
                "type": "revolute",
                "bearing": {"body": a, "point": p, "axis": [0, 1, 0]},
                "journal": {"body": b, "point": q, "axis": [0, 1, 0]},
            }
            for name, (a, p, b, q) in pins.items()
        },
        contacts={
            "tip": {
                "a": {"body": "lower", "point": [0.5, 0, 0]},
                "b": {"body": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
                "friction": friction,
                "restitution": restitution,
            }
        },
    )


def kinetic(run: History) -> Array:
    """Return the kinetic energy at each instant of a run."""
    bodies = run.assembly.model.bodies
    moving, spin = (bodies.mass * (run.v[..., :3] ** 2).sum(-1)).sum(1), run.v[..., 3:]
    return np.asarray(0.5 * (moving + np.einsum("nbi,bij,nbj->n", spin, bodies.inertia, spin)))


@SOME
@given(seeds, st.sampled_from([0.5, 0.7]), st.sampled_from([{}, LONG, {"step": 0.01}]))
def test_no_step_creates_more_than_its_share(seed, theta, steps):
    """Energy rises in no step by more than a thousandth of the largest kinetic energy so far."""
    run = history(made(loose_chain(seed, theta=theta, **steps)))
    allowed = SHARE * np.maximum.accumulate(kinetic(run))[1:]
    assert (np.diff(run.energy) <= allowed + 1e-10).all()


def check_balance(data: dict[str, Any]) -> None:
    """Run it; energy rises by what the certificate says, the most in a step and all together, to 1e-10 J."""
    gained = np.maximum(np.diff(history(made(data)).energy), 0.0)
    certificate = simulate(made(data), full_horizon=True).certificate
    assert certificate.max_created_energy == pytest.approx(gained.max(), rel=1e-6, abs=1e-10)
    assert certificate.created_energy == pytest.approx(gained.sum(), rel=1e-6, abs=1e-10)


@SOME
@given(seeds, st.sampled_from([0.5, 0.7, 1.0]), st.sampled_from([{}, LONG, {"step": 0.01}]))
def test_certificate_knows_what_loose_chains_create(seed, theta, steps):
    """Gravity works along the way, friction takes, contacts and projection add: nothing else changes the energy."""
    check_balance(loose_chain(seed, theta=theta, **steps))


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("scheme", ["combined", "moreau_jean"])
def test_certificate_knows_what_impacts_create(theta, scheme):
    """Restitution and friction, with projection and without."""
    check_balance(thrown_cube(theta=theta, scheme=scheme))


@pytest.mark.parametrize(("friction", "restitution"), [(0.5, 0.5), (0.5, 0.7), (0.7, 0.9)])
def test_an_oblique_impact_creates_nothing_however_it_bounces(friction, restitution):
    """Kane's paradox: with all of its restitution the pendulum would gain 0.6, 1.8 and 4.1 times its energy."""
    data = kanes_pendulum(friction, restitution)
    run, certificate = history(made(data)), simulate(made(data), full_horizon=True).certificate
    assert np.diff(run.energy).max() <= SHARE * run.energy[0]
    assert certificate.max_created_energy <= SHARE * run.energy[0]
    assert certificate.repeated > 0
    assert run.gap[-1, 0] - run.gap[-2, 0] > 0.3 * run.step[-1]  # m/s: it bounces


def test_a_bounce_that_creates_nothing_is_newtons():
    """The same pendulum with little friction and less restitution: the tip leaves the floor as fast as Newton says."""
    run = history(made(kanes_pendulum(0.05, 0.2)))
    speed = np.diff(run.gap[:, 0]) / run.step[1:]
    hit = int(np.flatnonzero(run.r[:, 0, 0])[0])
    assert speed[hit + 1] == pytest.approx(-0.2 * speed[hit - 2], rel=1e-2)


def test_coarse_steps_do_create():
    """The chains put their question: some of their steps create almost as much as they may, and some are repeated."""
    runs = [simulate(made(loose_chain(seed, **LONG)), full_horizon=True) for seed in range(8)]
    assert sum(run.certificate.repeated for run in runs) > 30
    for run in runs:
        assert run.certificate.created_energy >= run.certificate.max_created_energy >= 0.0
    assert max(run.certificate.max_created_energy for run in runs) > 1e-2  # J


def test_plain_scheme_is_measured_only():
    """Moreau-Jean's scheme is there for comparison: its steps have the length that the file says."""
    run = simulate(made(thrown_cube(scheme="moreau_jean")), full_horizon=True)
    assert (run.certificate.repeated, run.certificate.steps) == (0, 150)


@pytest.mark.parametrize("describe", [lambda: shipped("incline"), lambda: block_on_floor(origin=[0, 0, 0.1])])
def test_what_rests_is_not_repeated(describe):
    """What rounding leaves of a body at rest is no kinetic energy to compare with."""
    run = simulate(made(describe()), full_horizon=True)
    assert run.status == "ok", run.message
    assert run.certificate.repeated == 0


def test_tight_breaker_creates_little():
    """The C-60 with clearances of 0.01 and 0.13 mm, whose steps created up to a sixth of their kinetic energy."""
    most = 0.0
    for wide in ("1001011", "0101100", "1010101", "1100110"):
        values = {f"J{i}": 0.13 if bit == "1" else 0.01 for i, bit in enumerate(wide, 1)}
        run = simulate(load_mechanism("c60"), values)
        assert run.status == "ok", run.message
        assert run.certificate.max_created_energy <= SHARE * 4.0  # mJ: the peak of kinetic energy is 1.6 to 3.9
        most = max(most, run.certificate.max_created_energy)
    assert most > 1e-5
