"""The length of adaptive steps depends on the motion alone: not on the origin, nor on contacts that never come near."""

import copy

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.mechanism import Mechanism
from tests.counts import many
from tests.engine.histories import History, history, recorded
from tests.engine.linkages import linkage
from tests.engine.small import made, shipped, swinging, tumbling, turned

pytestmark = pytest.mark.bits

TRAVEL = 2e-3  # m
SOME = settings(max_examples=many(16), deadline=None)
seeds = st.integers(0, 100_000)
coordinate = st.floats(-1000, 1000)
vectors = st.tuples(coordinate, coordinate, coordinate)


def adaptive(data: dict) -> dict:
    """Let the steps of a description of a mechanism grow sixteen times, and shrink to a quarter of what they were."""
    simulation = data["simulation"]
    step = simulation["step"] / 4
    return {**data, "simulation": {**simulation, "step": step, "adaptive": {"longest": 16 * step, "travel": TRAVEL}}}


def with_peg(data: dict, place: np.ndarray) -> dict:
    """Add a peg of the ground, and a plate on the last body: points of the ground are measured from the origin."""
    name = list(data["bodies"])[-1]
    plate = {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.1}
    peg = {"a": {"body": "ground", "point": place.tolist()}, "b": {"body": name, "disc": plate}, "friction": 0.3}
    return {**data, "contacts": {"peg": peg, **data["contacts"]}}


def on_springs(seed: int) -> dict:
    """Describe a chain of two to five bodies with play in a joint, a spring on every body, and a floor; adaptive."""
    rng, data = np.random.default_rng(seed), adaptive(linkage(seed, 2 + seed % 4))
    data["simulation"]["tolerance"] = 1e-8  # near the rounding of the solver, whether a step fails would depend on it
    data["contacts"]["floor"]["restitution"] = float(rng.choice([0.0, 0.5]))
    data["springs"] = {
        f"S{i}": {
            "type": "linear",
            "a": {"body": "ground", "point": rng.normal(size=3).tolist()},
            "b": {"body": f"body_{i}", "point": (0.1 * rng.normal(size=3)).tolist()},
            "stiffness": float(rng.uniform(5, 100)),
            "free_length": float(rng.uniform(0.1, 1)),
        }
        for i in range(2 + seed % 4)
    }
    return data


def other_way_round(data: dict) -> dict:
    """Describe the same mechanism with contacts, bodies, joints and springs in the opposite order."""
    other = copy.deepcopy(data)
    for table in {"contacts", "bodies", "joints", "springs"} & data.keys():
        other[table] = dict(reversed(data[table].items()))
    return other


def same_motion(one: History, other: History) -> None:
    """Check that two runs have the same steps, and the same impulses, to the bit."""
    for field in ("step", "x", "p", "v", "r"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), field)


@pytest.mark.parametrize("describe", [tumbling, swinging])
def test_lengths_do_vary(describe):
    """Otherwise the other tests would say nothing."""
    assert len(set(history(made(adaptive(describe()))).step)) > 3


@SOME
@given(seeds)
def test_contacts_that_are_looked_at_in_vain_change_no_step(seed):
    """Look at every contact in every step: not a bit of the motion is different."""
    mechanism = made(adaptive(linkage(seed)))
    near, every = assemble(mechanism), assemble(mechanism)
    every.model.contacts.reach[:] = np.inf
    one, other = recorded(near, mechanism), recorded(every, mechanism)
    same_motion(one, other)
    np.testing.assert_array_equal(one.gap, other.gap)


@SOME
@given(seeds, st.floats(0.02, 0.5))
def test_contacts_that_never_touch_change_no_step(seed, away):
    """A peg beside the last body, which passes it at more than the travel of a step."""
    data = adaptive(linkage(seed))
    one = history(made(data))
    other = history(made(with_peg(data, one.x[0, -1] + [0.6 * away, 0.0, 0.8 * away])))
    peg = other.assembly.contact_names.index("peg")
    assume(other.gap[:, peg].min() > TRAVEL)
    np.testing.assert_array_equal(one.step, other.step)
    np.testing.assert_array_equal(one.x, other.x)


@SOME
@given(seeds, vectors, vectors)
def test_lengths_do_not_depend_on_the_frame(seed, turn, shift):
    """Turned and moved by up to a kilometre: as many steps as long, and the same responses to what rounding moves.

    A place 1 km away is known to 1e-13 m only. Without play: what rattles in a joint enlarges that without limit.
    """
    data = with_peg(adaptive(linkage(seed, loose=False)), np.array([0.0, 0.0, 100.0]))
    other = turned(data, Rotation.from_rotvec(np.asarray(turn) / 300.0 + [0.1, 0.0, 0.0]), np.asarray(shift))
    here, there = (history(made(described)) for described in (data, other))
    np.testing.assert_array_equal(here.step, there.step)
    one, two = (simulate(made(described), full_horizon=True).responses for described in (data, other))
    np.testing.assert_allclose(list(two.values()), list(one.values()), rtol=0, atol=1e-6)


@SOME
@given(seeds)
def test_lengths_do_not_depend_on_the_order(seed):
    """Contacts, bodies and joints the other way round; without play, see above."""
    data = adaptive(linkage(seed, loose=False))
    np.testing.assert_array_equal(history(made(data)).step, history(made(other_way_round(data))).step)


@SOME
@given(seeds, st.sampled_from([0.016, 0.1, 2.0]), vectors)
def test_nothing_of_it_matters_to_a_chain_with_play_on_springs(seed, away, direction):
    """Moved, turned with gravity, written the other way round: as many steps as long, and the same place to 1e-5 m.

    For a fifth of a second: what rattles in a joint enlarges what the tolerance leaves open.
    """
    assume(np.linalg.norm(direction) > 1.0)
    data = on_springs(seed)
    turn, shift = Rotation.from_rotvec(np.asarray(direction) / 300.0), away * np.asarray(direction)
    other = other_way_round(turned(data, turn, shift / np.linalg.norm(direction)))
    here, there = (simulate(made(described), full_horizon=True) for described in (data, other))
    assert (there.status, there.certificate.steps) == (here.status, here.certificate.steps)
    np.testing.assert_allclose(list(there.responses.values()), list(here.responses.values()), rtol=0, atol=1e-5)


BREAKERS = [
    [0.0441, 0.0681, 0.0622, 0.0836, 0.0734, 0.0415, 0.0491],
    [0.0749, 0.0669, 0.0552, 0.0644, 0.0534, 0.0701, 0.0503],
    [0.0492, 0.0599, 0.0666, 0.0857, 0.0900, 0.0468, 0.0561],
]
TURN = Rotation.from_rotvec([0.4, -0.9, 0.5])


def placed(shift: list[float], turn: Rotation | None = None) -> Mechanism:
    """Return the C-60 elsewhere in the world."""
    data = shipped("c60")
    del data["benches"]  # they have loads in the world's directions
    if turn is not None:
        data = turned(data, turn, np.zeros(3))
    for body in data["bodies"].values():
        body["origin"] = np.add(body.get("origin", [0, 0, 0]), shift).tolist()
    return made(data)


@pytest.mark.slow
@pytest.mark.parametrize("clearances", BREAKERS)
def test_the_c60_does_not_depend_on_the_frame(clearances):
    """Where a breaker stands on the bench, and how it is turned, moves no force by more than the solver's tolerance.

    Most of its joints start concentric, where any direction is that of the least gap: rounding, which depends on the
    world's axes, must not choose one.
    """
    values = {f"J{i}": clearance for i, clearance in enumerate(clearances, 1)}
    here = simulate(placed([0, 0, 0]), values)
    for there in (placed([16, 0, 0]), placed([300, -200, 100]), placed([1200, -1300, 930]), placed([0, 0, 0], TURN)):
        run = simulate(there, values)
        assert run.certificate.steps == here.certificate.steps
        assert run.responses == pytest.approx(here.responses, abs=2e-4)


def test_the_c60_does_not_depend_on_what_stays_open_nor_on_the_order():
    """Without its stops that are never reached in ON: the same bits; with its contacts the other way round, to 2e-4."""
    data, values = shipped("c60"), {f"J{i}": clearance for i, clearance in enumerate(BREAKERS[0], 1)}
    del data["benches"]
    here, contacts = simulate(made(data), values), data["contacts"]
    reached = {name: contact for name, contact in contacts.items() if not name.startswith(("C2", "S9", "B"))}
    assert len(reached) < len(contacts)
    assert simulate(made(data | {"contacts": reached}), values).responses == here.responses
    other = simulate(made(data | {"contacts": dict(reversed(contacts.items()))}), values)
    assert other.certificate.steps == here.certificate.steps
    assert other.responses == pytest.approx(here.responses, abs=2e-4)
