"""Mechanisms of two profiles that touch: a hook that hangs, a wedge, what collides; closed forms and balances."""

import hashlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.mechanism import set_values
from tests.engine.histories import recorded
from tests.engine.small import GRAVITY, coordinates, energy, made, small, turned
from tests.engine.test_determinism import fresh

UPRIGHT = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0]}
PEG = {**UPRIGHT, "start": [0.01, 0], "profile": [{"to": [0.01, 0], "centre": [0, 0], "turn": "left"}]}
HOOK = {  # hollow, with a radius of 15 mm about its origin, and its mouth below
    **UPRIGHT,
    "start": [-0.015, 0],
    "profile": [
        {"to": [0.015, 0], "centre": [0, 0], "turn": "right"},
        {"to": [0.015, -0.02]},
        {"to": [0.025, -0.02]},
        {"to": [0.025, 0.025]},
        {"to": [-0.025, 0.025]},
        {"to": [-0.025, -0.02]},
        {"to": [-0.015, -0.02]},
    ],
}
SQUARE = {**UPRIGHT, "start": [-1, -1], "profile": [{"to": [1, -1]}, {"to": [1, 1]}, {"to": [-1, 1]}]}
IN_PLANE = {"point": [0, 0, 0], "normal": [0, 0, 1]}


def in_plane(body):
    return {"type": "planar", "a": {"body": "ground", **IN_PLANE}, "b": {"body": body, **IN_PLANE}}


def hanging():
    """Hang a bar of 0.5 kg by its hook on a peg; its centre of mass is 12 mm beside the hook's centre, 40 mm below."""
    return small(
        gravity=[0, -GRAVITY, 0],
        phases=[{"name": "hang", "damping": 8.0}],
        simulation={"step": 5e-4, "horizon": 8.0, "rest": {"window": 0.2, "drift": 1e-7}},
        bodies={
            "ground": {"fixed": True},
            "bar": {
                "mass": 0.5,
                "inertia": [1e-4, 1e-4, 2e-4],
                "center_of_mass": [0.012, -0.04, 0],
                "origin": [0, -0.004, 0],
            },
        },
        joints={"plane": in_plane("bar")},
        contacts={
            "hook": {
                "a": {"body": "bar", "extruded": HOOK},
                "b": {"body": "ground", "extruded": PEG},
                "friction": 0.0,
            }
        },
        responses={
            **coordinates("bar"),
            "tilt": {"type": "angle", "body": "bar", "axis": [0, 0, 1]},
            "force": {"type": "contact_force", "contact": "hook"},
            "gap": {"type": "gap", "contact": "hook"},
        },
    )


def test_a_hook_hangs_with_its_mass_below_the_peg():
    """The peg's centre, the hook's and the centre of mass on one vertical line; the weight at the one point."""
    run = simulate(made(hanging()))
    assert run.status == "ok", run.message
    assert run.responses["tilt"] == pytest.approx(-np.arctan2(0.012, 0.04), abs=2e-4)
    assert run.responses["y"] == pytest.approx(-0.005, abs=1e-6)
    assert run.responses["force"] == pytest.approx(0.5 * GRAVITY, rel=1e-6)
    assert abs(run.responses["gap"]) < 1e-7
    assert run.certificate.max_penetration <= 1e-8


def wedge(slope=0.5, friction=0.0):
    """Push a wedge along -x under a slide along y that a spring of 200 N/m holds down; their flanks are parallel."""
    up = [{"to": [0.1, 0.0]}, {"to": [0.1, 0.1 * slope]}]
    flank = [{"to": [0.02, 0.02 * slope]}, {"to": [0.02, 0.05]}, {"to": [-0.02, 0.05]}]
    guide = {"point": [0, 0, 0], "axis": [1, 0, 0]}
    way = {"point": [0, 0, 0], "axis": [0, 1, 0]}
    body = {"mass": 0.1, "inertia": [1e-4, 1e-4, 1e-4]}
    return small(
        phases=[{"name": "push", "damping": 40.0}],
        simulation={"step": 1e-3, "horizon": 5.0, "rest": {"window": 0.1, "drift": 1e-8}},
        bodies={
            "ground": {"fixed": True},
            "wedge": {**body, "origin": [-0.05, 0, 0]},
            "slide": {**body, "origin": [0.0, 0.05 * slope, 0]},
        },
        joints={
            "guide": {
                "type": "prismatic",
                "guide": {"body": "ground", **guide},
                "slider": {"body": "wedge", **guide},
            },
            "way": {"type": "prismatic", "guide": {"body": "ground", **way}, "slider": {"body": "slide", **way}},
        },
        contacts={
            "flank": {
                "a": {"body": "wedge", "extruded": {**UPRIGHT, "start": [0, 0], "profile": up}},
                "b": {"body": "slide", "extruded": {**UPRIGHT, "start": [-0.02, -0.02 * slope], "profile": flank}},
                "friction": friction,
            }
        },
        springs={
            "press": {
                "type": "linear",
                "a": {"body": "ground", "point": [0, 0.05 * slope + 0.1, 0]},
                "b": {"body": "slide", "point": [0, 0, 0]},
                "stiffness": 200.0,
                "free_length": 0.1,
            }
        },
        forces={"push": {"body": "wedge", "force": [-1.0, 0, 0]}},
        responses={
            "lift": {
                "type": "position",
                "from": {"body": "ground", "point": [0, 0.05 * slope, 0]},
                "to": {"body": "slide", "point": [0, 0, 0]},
                "direction": {"vector": [0, 1, 0]},
            },
            "force": {"type": "contact_force", "contact": "flank"},
            "rub": {"type": "contact_force", "contact": "flank", "component": "friction"},
            "least": {"type": "contact_force", "contact": "flank", "bound": "least"},
            "heat": {"type": "friction_work", "contact": "flank"},
            "impulse": {"type": "contact_impulse", "contact": "flank"},
            "bounces": {"type": "bounces", "contact": "flank", "opening": 1e-4},
        },
    )


def test_flanks_that_lie_on_each_other_carry_what_the_wedge_says():
    """Without friction 1 N along -x is N sin, and N cos lifts the spring by 1 N / tan / 200 N/m: 10 mm at a half."""
    run = simulate(made(wedge()))
    assert run.status == "ok", run.message
    assert run.responses["lift"] == pytest.approx(0.01, rel=1e-4)
    assert run.responses["force"] == pytest.approx(np.hypot(1, 2), rel=1e-4)
    assert run.responses["least"] == pytest.approx(np.hypot(1, 2), rel=1e-4)
    assert (run.responses["rub"], run.responses["heat"], run.responses["bounces"]) == (0.0, 0.0, 0.0)
    assert run.responses["impulse"] > 0.0


def test_friction_of_the_flanks_takes_its_share():
    """Sliding up slowly: the lift is 1 N (1 - mu tan) / (tan + mu) / 200 N/m, and the flank takes heat."""
    run = simulate(made(wedge(friction=0.2)))
    assert run.status == "ok", run.message
    assert run.responses["lift"] == pytest.approx((1 - 0.2 * 0.5) / (0.5 + 0.2) / 200.0, rel=2e-2)
    assert run.responses["heat"] > 0.0


def test_what_friction_takes_is_that_of_all_points():
    """A motion lifts the slide 10 mm: mu N along the flank, N = 200 N/m lift / (cos - mu sin)."""
    data = wedge(friction=0.2)
    data["phases"] = [{"name": "push", "duration": 1.0}]
    del data["forces"], data["responses"]["least"]
    data["motions"] = {
        "push": {
            "body": "wedge",
            "along": {"direction": [-1, 0, 0]},
            "law": {"table": [[0.0, 0.0], [1.0, 0.02]], "interpolation": "smooth"},
        }
    }
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["lift"] == pytest.approx(0.01, rel=1e-6)
    cosine, sine = 2 / np.hypot(1, 2), 1 / np.hypot(1, 2)
    heat = 0.2 * 0.5 * 200.0 * 0.01**2 / (cosine - 0.2 * sine) / sine
    assert run.responses["heat"] == pytest.approx(heat, rel=2e-3)


def colliding(**contact):
    """Two squares fly at each other, turning; nothing else acts on them."""
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 0.7]}
    return small(
        simulation={"step": 1e-3, "horizon": 3.0, "tolerance": 1e-11},
        bodies={
            "ground": {"fixed": True},
            "one": {**body, "origin": [-2, 0.3, 0], "velocity": [1, 0, 0], "angular_velocity": [0, 0, 0.7]},
            "other": {**body, "mass": 2.0, "origin": [2, 0, 0], "velocity": [-1, 0.1, 0]},
        },
        contacts={
            "touch": {
                "a": {"body": "one", "extruded": SQUARE},
                "b": {"body": "other", "extruded": SQUARE},
                "friction": 0.3,
                **contact,
            }
        },
        responses={f"{key}_{axis}": each for key in ("one", "other") for axis, each in coordinates(key).items()},
    )


def momentum(assembly):
    """Return the linear and the angular momentum about the origin, (6,)."""
    total = np.zeros(6)
    for i, (mass, inertia) in enumerate(zip(assembly.model.bodies.mass, assembly.model.bodies.inertia, strict=True)):
        v, spin, x = assembly.state.v[i, :3], assembly.state.v[i, 3:], assembly.state.x[i]
        total[:3] += mass * v
        total[3:] += np.cross(x, mass * v) + assembly.state.R[i] @ inertia @ spin
    return total


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_a_collision_keeps_the_momentum_and_creates_no_energy(restitution):
    mechanism = made(colliding(restitution=restitution))
    assembly = assemble(mechanism)
    before, had = momentum(assembly), energy(assembly)
    run = simulate(mechanism, full_horizon=True)
    assert run.status == "ok", run.message
    assert run.certificate.created_energy < 1e-9
    assert run.certificate.max_penetration <= 1e-8
    recorded(assembly, mechanism)
    np.testing.assert_allclose(momentum(assembly)[:3], before[:3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(momentum(assembly)[3:], before[3:], rtol=0, atol=2e-4)  # see test_invariants.py
    assert energy(assembly) < 0.95 * had


@pytest.mark.parametrize(
    ("start", "scheme", "off"), [(0.0, "combined", 1e-7), (1e-3, "combined", 1e-7), (1e-3, "moreau_jean", 1e-4)]
)
def test_a_corner_that_slides_past_a_corner_is_not_caught(start, scheme, off):
    """A tall block slides down a short wall that it is pressed on: both its corners pass both of the wall's."""
    tall = [{"to": [0.1, -0.5]}, {"to": [0.1, 0.5]}, {"to": [0.0, 0.5]}]
    wall = [{"to": [0.0, -0.2]}, {"to": [0.0, 0.2]}, {"to": [-1.0, 0.2]}]
    body = {"mass": 0.1, "inertia": [1e-3, 1e-3, 1e-3], "origin": [start, 0.4, 0]}
    x, y = {"point": [0, 0, 0], "axis": [1, 0, 0]}, {"point": [0, 0, 0], "axis": [0, 1, 0]}
    data = small(
        simulation={"scheme": scheme},
        bodies={"ground": {"fixed": True}, "carriage": body, "block": {**body, "velocity": [0, -0.97, 0]}},
        joints={
            "across": {
                "type": "prismatic",
                "guide": {"body": "ground", **x, "point": [0, 0.4, 0]},
                "slider": {"body": "carriage", **x},
            },
            "along": {
                "type": "prismatic",
                "guide": {"body": "carriage", **y},
                "slider": {"body": "block", **y},
            },
        },
        contacts={
            "face": {
                "a": {"body": "block", "extruded": {**UPRIGHT, "start": [0, -0.5], "profile": tall}},
                "b": {"body": "ground", "extruded": {**UPRIGHT, "start": [-1, -0.2], "profile": wall}},
                "friction": 0.0,
            }
        },
        forces={"press": {"body": "carriage", "force": [-1.0, 0, 0]}},
        responses=coordinates("block"),
    )
    run = simulate(made(data), full_horizon=True)
    assert run.status == "ok", run.message
    assert run.responses["y"] == pytest.approx(0.4 - 0.97, abs=1e-9)
    assert run.responses["x"] == pytest.approx(0.0, abs=off)


def test_it_is_the_same_elsewhere_and_in_any_order():
    """Moved, turned, with the sides swapped and the bodies the other way round."""
    data = wedge(friction=0.1)
    here = simulate(made(data))
    swapped = wedge(friction=0.1)
    flank = swapped["contacts"]["flank"]
    flank["a"], flank["b"] = flank["b"], flank["a"]
    swapped["bodies"] = dict(reversed(swapped["bodies"].items()))
    for other in (turned(data, Rotation.from_rotvec([0.4, -0.9, 0.5]), np.array([0.6, -0.6, 0.5])), swapped):
        there = simulate(made(other))
        assert there.status == "ok", there.message
        for name in ("force", "heat"):
            assert there.responses[name] == pytest.approx(here.responses[name], rel=1e-6), name


def test_a_number_of_an_outline_is_a_variable():
    """The slope by the corner of the wedge, as a campaign sets it."""
    data = wedge()
    steeper = set_values(made(data), {"contacts.flank.a.extruded.profile.1.to.1": 0.0501})
    assert steeper.contacts["flank"].a.extruded.profile[1].to == (0.1, 0.0501)
    assert simulate(steeper).responses["lift"] != simulate(made(data)).responses["lift"]


def digest() -> str:
    """Hash the responses of runs, bit for bit."""
    runs = [simulate(made(data), full_horizon=True, horizon=1.0) for data in (hanging(), wedge(friction=0.2))]
    runs += [simulate(made(colliding(restitution=0.4)), full_horizon=True)]
    words = [value.hex() for run in runs for value in run.responses.values()]
    return hashlib.sha256(" ".join(words).encode()).hexdigest()


@pytest.mark.processes
@pytest.mark.bits
def test_same_bits_in_another_process():
    code = "from tests.engine.test_outlines import digest; print(digest())"
    assert fresh(code, PYTHONHASHSEED="7", OPENBLAS_NUM_THREADS="2") == digest()
