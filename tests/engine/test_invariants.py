"""What must not matter, and what must not change: frames, units, order, mirrors; energy and momentum."""

import copy
import json
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine import load_mechanism, simulate
from engine.assembly import assemble
from engine.loop import Cancel
from tests.counts import many
from tests.engine.histories import History, history, recorded
from tests.engine.linkages import fly, in_millimetres, linkage, mirrored
from tests.engine.small import GRAVITY, made, shipped, small, swinging, tumbling, turned
from tests.engine.test_determinism import fresh

pytestmark = pytest.mark.bits

seeds = given(seed=st.integers(0, 100_000))
few = settings(max_examples=many(12), deadline=None)
many = settings(max_examples=many(24), deadline=None)

NAMED = pytest.mark.parametrize("describe", [tumbling, swinging, lambda: shipped("incline")])


def responses(data: dict, **overrides: dict) -> np.ndarray:
    """Run to the horizon and return the responses in the file's order."""
    run = simulate(made({**data, **overrides}), full_horizon=True)
    assert run.status == "ok", run.message
    return np.array([run.responses[name] for name in data["responses"]])


# --- what must not matter


def check_frame(data: dict) -> None:
    """Move every pose, speed and gravity by one rigid motion: the same responses to 1e-8."""
    other = turned(data, Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.5, -2.0, 1.0]))
    for response in other["responses"].values():  # the ground is moved too, the world is not
        assert response["from"]["body"] in data["bodies"]
    np.testing.assert_allclose(responses(other), responses(data), rtol=0, atol=1e-8)


@NAMED
def test_frame_does_not_matter(describe):
    """Shipped and thrown ones."""
    check_frame(describe())


@few
@seeds
def test_frame_does_not_matter_to_linkages(seed):
    """Ideal joints, a joint with play, a contact that closes."""
    check_frame(linkage(seed))


def check_units(data: dict) -> None:
    """SI, and mm, g, ms: the same responses to 1e-8 m."""
    run = simulate(in_millimetres(made(data)), full_horizon=True)
    assert run.status == "ok", run.message
    assert set(run.units.values()) == {"mm"}
    np.testing.assert_allclose(np.array(list(run.responses.values())) / 1000, responses(data), rtol=0, atol=1e-8)


@NAMED
def test_units_do_not_matter(describe):
    """Shipped and thrown ones."""
    check_units(describe())


@few
@seeds
def test_units_do_not_matter_to_linkages(seed):
    """Ideal joints, a joint with play, a contact that closes."""
    check_units(linkage(seed))


def check_order(data: dict) -> None:
    """Contacts, bodies and joints the other way round: the same responses to 1e-8."""
    other = copy.deepcopy(data)
    for table in {"contacts", "bodies", "joints"} & data.keys():
        other[table] = dict(reversed(data[table].items()))
    np.testing.assert_allclose(responses(other), responses(data), rtol=0, atol=1e-8)


@NAMED
def test_order_in_the_file_does_not_matter(describe):
    """Shipped and thrown ones."""
    check_order(describe())


@few
@seeds
def test_order_in_the_file_does_not_matter_to_linkages(seed):
    """Ideal joints, a joint with play, a contact that closes."""
    check_order(linkage(seed))


def check_mirror(data: dict) -> None:
    """Mirror it: the same responses, which lie in the mirror or along it, to 1e-8."""
    np.testing.assert_allclose(responses(mirrored(data)), responses(data), rtol=0, atol=1e-8)


@NAMED
def test_mirror_image_is_the_same(describe):
    """Shipped and thrown ones."""
    check_mirror(describe())


@few
@seeds
def test_mirror_image_of_linkages_is_the_same(seed):
    """Ideal joints, a joint with play, a contact that closes."""
    data = linkage(seed)
    for joint in data["joints"].values():
        joint.pop("flanges", None)
        joint.pop("axial_clearance", None)
    check_mirror(data)


def test_linkages_do_move_and_touch():
    """The random linkages put their questions: they move, contacts press, joints with play and the floor among them."""
    pressed, moved = set(), []
    for seed in range(30):
        run = history(made(linkage(seed)))
        moved.append(np.abs(run.x[-1] - run.x[0]).max())
        pressed |= {
            name.split(".")[-1][:4]
            for name, r in zip(run.assembly.contact_names, np.moveaxis(run.r, 1, 0), strict=True)
            if r.any()
        }
    assert np.median(moved) > 0.05
    assert pressed >= {"floo", "ring"}


@pytest.mark.processes
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_linkage_without_the_compiler_gives_the_same(seed):
    """NUMBA_DISABLE_JIT=1: plain Python ends at the same numbers to 1e-12."""
    code = (
        "import json; from engine import simulate; from tests.engine.linkages import linkage;"
        "from tests.engine.small import made;"
        f"run = simulate(made(linkage({seed}, 2)), horizon=0.004, full_horizon=True);"
        "print(json.dumps([run.status, run.certificate.steps, list(run.responses.values())]))"
    )
    status, steps, plain = json.loads(fresh(code, NUMBA_DISABLE_JIT="1"))
    run = simulate(made(linkage(seed, 2)), horizon=0.004, full_horizon=True)
    assert (status, steps) == (run.status, run.certificate.steps) == ("ok", 4)
    np.testing.assert_allclose(plain, list(run.responses.values()), rtol=0, atol=1e-12)


# --- which contacts are looked at


def check_broad_phase(data: dict) -> None:
    """Look at every contact in every step: not a bit of the motion is different."""
    mechanism = made(data)
    near, every = assemble(mechanism), assemble(mechanism)
    every.model.contacts.reach[:] = np.inf
    one, other = recorded(near, mechanism), recorded(every, mechanism)
    for field in ("step", "energy", "x", "p", "v", "gap", "r"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), field)


@NAMED
def test_contacts_passed_over_change_nothing(describe):
    """Shipped and thrown ones."""
    check_broad_phase(describe())


@many
@seeds
def test_contacts_passed_over_change_nothing_in_linkages(seed):
    """Ideal joints, a joint with play, a contact that closes."""
    check_broad_phase(linkage(seed))


# --- momentum


def colliding(seed: int) -> dict:
    """Let a ball fly at a block that tumbles, in space: restitution and friction at random."""
    rng = np.random.default_rng(seed)
    aim = rng.uniform(-0.3, 0.3, 3)
    return small(
        simulation={"horizon": 0.6, "step": 1e-3, "tolerance": 1e-11},
        bodies={
            "ground": {"fixed": True},
            "block": {
                "mass": float(rng.uniform(0.5, 2)),
                "inertia": [0.2, 0.2, 0.2],
                "angular_velocity": (0.5 * rng.normal(size=3)).tolist(),
            },
            "ball": {
                "mass": float(rng.uniform(0.5, 2)),
                "inertia": [0.02, 0.02, 0.02],
                "origin": [aim[0], aim[1], 0.7],
                "velocity": [0.1, -0.2, -2.0],
                "angular_velocity": (3 * rng.normal(size=3)).tolist(),
            },
        },
        contacts={
            "hit": {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": 0.1}},
                "b": {"body": "block", "plane": {"point": [0, 0, 0.1], "normal": [0, 0, 1]}},
                "friction": float(rng.choice([0.0, 0.3, 0.8])),
                "restitution": float(rng.choice([0.0, 0.5, 1.0])),
            }
        },
    )


def drift(run: History) -> tuple[float, float]:
    """Return how far linear and angular momentum ever are from where they began, relative to the bodies' own."""
    found, bodies = run.momentum(), run.assembly.model.bodies
    linear = (bodies.mass[:, None] * np.abs(run.v[0, :, :3])).sum()
    angular = np.linalg.norm(found[0, 3:]) + linear
    off = np.abs(found - found[0]).max(0)
    return float(off[:3].max() / linear), float(off[3:].max() / angular)


@many
@seeds
def test_momentum_of_a_collision_is_kept(seed):
    """Ball and block with equal moments, no load: linear momentum to 1e-9, whatever the impact law.

    The projection moves masses that have a velocity, by as much as they sank: angular momentum changes by the order of
    a step's way at an impact that is found late. The plain scheme takes contacts where the velocities of the start
    would lead; there its impulses are in balance.
    """
    data = colliding(seed)
    run = history(made(data))
    assert run.r.any()
    linear, angular = drift(run)
    assert linear < 1e-9
    assert angular < 0.2 * data["simulation"]["step"]
    data["simulation"]["scheme"] = "moreau_jean"
    plain = history(made(data))
    assert plain.r.any()
    linear, angular = drift(plain)
    assert linear < 1e-9
    assert angular < 2 * data["simulation"]["step"]
    assert imbalance_where_the_start_leads(plain) < 1e-9


def imbalance_where_the_start_leads(run: History) -> float:
    """Return the largest moment of a step's impulses about the origin, at the pose x + h v, relative to their size.

    The angular velocity is in body axes, which have turned by h/2 times it more at that pose than at mid-step, where
    its jump is seen in the world.
    """
    bodies, R = run.assembly.model.bodies, run.rotation()
    h, v = run.step[1:, None, None], run.v[:-1]
    spin = np.einsum("nbij,bjk,nbk->nbi", R, bodies.inertia, run.v[..., 3:])
    omega = np.einsum("nbij,nbj->nbi", R, run.v[..., 3:])[:-1]
    turn = Rotation.from_rotvec((0.5 * h * omega).reshape(-1, 3))
    moments = turn.apply(np.diff(spin, axis=0).reshape(-1, 3)).reshape(omega.shape)
    impulses = bodies.mass[:, None] * np.diff(run.v[..., :3], axis=0)
    about = np.cross(run.x[:-1] + h * v[..., :3], impulses) + moments
    return float(np.abs(about.sum(1)).max() / np.abs(about).max())


@many
@seeds
def test_momentum_of_a_flying_linkage_is_kept(seed):
    """A chain of ideal joints thrown as one: linear momentum to 1e-9; angular to second order in the step."""
    data = fly(linkage(seed, loose=False, ground=False), [1.0, 0.5, -0.2], [0.5, -0.3, 1.0])
    off = {}
    for h in (1e-3, 5e-4):
        linear, off[h] = drift(history(made(data | {"simulation": data["simulation"] | {"step": h}})))
        assert linear < 1e-9
    assert off[1e-3] < 1e-7
    assert off[5e-4] < 0.3 * off[1e-3] + 1e-11


@many
@seeds
def test_momentum_of_a_flying_linkage_with_play_is_kept(seed):
    """The same with play in a joint: linear momentum to 1e-9, angular within what the projections move."""
    linear, angular = drift(history(made(fly(linkage(seed, ground=False), [1.0, 0.5, -0.2], [0.5, -0.3, 1.0]))))
    assert linear < 1e-9
    assert angular < 1e-4


# --- energy


@many
@seeds
def test_energy_of_ideal_linkages_is_second_order(seed):
    """Hanging chains without play or contact: a quarter of the energy's error with half the step."""
    data, off = linkage(seed, loose=False), {}
    del data["contacts"]
    for h in (2e-3, 1e-3):
        run = history(made(data | {"simulation": data["simulation"] | {"step": h}}))
        off[h] = np.abs(run.energy - run.energy[0]).max()
    assert off[1e-3] < 0.3 * off[2e-3] + 1e-9


@many
@seeds
def test_energy_of_a_collision_never_grows(seed):
    """No step gains any; without friction and with restitution 1 none is lost either.

    Not asked where both are: Newton's law with friction can gain (Kane's paradox), here up to 1e-3 of what there is.
    """
    data = colliding(seed)
    law = data["contacts"]["hit"]
    growth = 1e-12 if 0.0 in (law["friction"], law["restitution"]) else 1e-3
    energy = history(made(data)).energy
    assert np.diff(energy).max() <= growth * energy[0]
    law |= {"friction": 0.0, "restitution": 1.0}
    np.testing.assert_allclose(history(made(data)).energy, energy[0], rtol=1e-12)


@many
@seeds
def test_energy_of_linkages_with_play_never_grows(seed):
    """Hanging chains with play, friction and a floor: gained are terms of second order, m (g h)^2 at most."""
    data = linkage(seed)
    run = history(made(data))
    gained = run.energy - np.minimum.accumulate(run.energy)
    assert gained.max() <= run.assembly.model.bodies.mass.sum() * (GRAVITY * data["simulation"]["step"]) ** 2


# --- how a run ends


@pytest.mark.parametrize(("name", "size"), [("c60", 10.0), ("clearance_pendulum", 0.2)])
def test_stopping_at_rest_changes_no_response(name, size):
    """The run that stops at rest and the one that goes on to its horizon: the same responses within 1e-6 of their size.

    With friction problems solved to 1e-9: what a residual leaves is a velocity, and parts at rest creep at it. At the
    C-60's own 1e-8 a length goes on by 1e-6 mm each ms.
    """
    stopped, whole = (
        simulate(load_mechanism(name), {"simulation.tolerance": 1e-9}, full_horizon=full) for full in (False, True)
    )
    assert stopped.certificate.time < 0.9 * whole.certificate.time
    assert whole.responses == pytest.approx(stopped.responses, rel=1e-6, abs=1e-6 * size)


def test_cancel_from_another_thread_ends_a_run():
    """A run that takes far longer than a test may ends amid its motion."""
    cancel, mechanism = Cancel(), load_mechanism("c60")
    timer = threading.Timer(0.3, cancel.set)
    timer.start()
    run = simulate(mechanism, step=1e-6, full_horizon=True, cancel=cancel)
    assert (run.status, run.responses) == ("cancelled", {})
    assert run.certificate.time < mechanism.simulation.horizon
