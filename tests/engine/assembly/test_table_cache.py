"""What is kept from one assembly to the next: never more than what is the same to the bit."""

import random
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine import load_mechanism, simulate
from engine.assembly import Assembly, assemble, lent_assembly
from engine.assembly.joints import without_play
from engine.assembly.table_cache import cached
from engine.errors import MechanismError
from engine.mechanism import Mechanism, get_value, library_names, set_values
from engine.mechanism.keys.values import settable_keys
from tests.counts import many
from tests.each import each
from tests.engine.small import made, shipped

pytestmark = pytest.mark.bits

EVERY = [(name, bench) for name in library_names() for bench in (None, *load_mechanism(name).benches)]


@cache
def mechanism_of(which: tuple[str, str | None]) -> Mechanism:
    """Return a shipped mechanism, or one on a bench."""
    name, bench = which
    return load_mechanism(name).on_bench(bench) if bench else load_mechanism(name)


def changed(which: tuple[str, str | None], seed: int) -> Mechanism:
    """Return a shipped mechanism with up to three of its numbers a little different."""
    mechanism, rng = mechanism_of(which), random.Random(seed)
    keys = [key for key in settable_keys(mechanism) if not key.startswith("simulation.")]
    values = {}
    for key in rng.sample(keys, rng.randrange(4)):
        values[key] = get_value(mechanism, key) * (1 + rng.uniform(-1e-4, 1e-4))
    try:
        return set_values(mechanism, values)
    except MechanismError:  # such as a direction that is no longer across another
        return mechanism


def arrays(parts: Any) -> list[Any]:
    """Return all arrays of tuples of such, or of None."""
    return [parts] if isinstance(parts, np.ndarray) else [array for part in parts or () for array in arrays(part)]


def everything(assembly: Assembly) -> list[Any]:
    """Return all arrays of an assembly."""
    return arrays((assembly.model, assembly.state, assembly.work, assembly.problem))


def bits(mechanism: Mechanism) -> Any:
    """Return the assembly of a mechanism as bytes and names, or the message of the error."""
    try:
        assembly = assemble(mechanism)
    except MechanismError as error:
        return str(error)
    names = assembly.contact_names, assembly.row_names
    return names, [(array.shape, str(array.dtype), array.tobytes()) for array in everything(assembly)]


def anew(mechanism: Mechanism) -> Mechanism:
    """Return the same mechanism, none of whose tables has been seen before."""
    return mechanism.model_copy(deep=True)


@pytest.mark.slow
@settings(deadline=None, max_examples=many(30))
@given(st.lists(st.tuples(st.sampled_from(EVERY), st.integers(0, 3)), min_size=1, max_size=6))
def test_an_assembly_does_not_depend_on_those_before(turns):
    """Any mechanisms and values in any order: to the bit as if nothing had been assembled before."""
    for which, seed in turns:
        mechanism = changed(which, seed)
        assert bits(mechanism) == bits(anew(mechanism))


@pytest.mark.slow
@each("which", EVERY)
def test_every_number_that_may_be_set_has_the_same_effect_on_what_is_kept(which):
    """One number after the other, each also in a mechanism that is assembled anew; every twentieth of the C-60's.

    A bench has the keys of its mechanism, and each bench takes others of them.
    """
    mechanism, at = mechanism_of(which), EVERY.index(which)
    keys = settable_keys(mechanism)
    apart = 1 + len(keys) // (16 if which[1] else 40)
    for key in keys[at % apart :: apart]:
        try:
            other = set_values(mechanism, {key: get_value(mechanism, key) * 1.0001 + 1e-9})
        except MechanismError:
            continue
        assert bits(other) == bits(anew(other)), key
    assert bits(mechanism) == bits(anew(mechanism))


def test_runs_in_any_order_and_on_several_threads_have_the_same_bits():
    """Interleaved runs of mechanisms with other values, one after the other and on four threads at once."""
    turns = [(name, seed) for name in ("incline", "clearance_pendulum", "lever", "four_bar") for seed in range(4)]

    def result(turn: tuple[str, int]) -> Any:
        run = simulate(changed((turn[0], None), turn[1]), horizon=0.02)
        measured = [value.hex() for value in run.measured.values()]
        return run.status, run.certificate.steps, run.certificate.max_residual.hex(), measured

    alone = {turn: result(turn) for turn in turns}
    assert {turn: result(turn) for turn in reversed(turns)} == alone
    random.Random(1).shuffle(turns)
    with ThreadPoolExecutor(4) as threads:
        assert dict(zip(turns, threads.map(result, turns), strict=True)) == alone


def test_two_assemblies_share_no_memory():
    mechanism = load_mechanism("c60")
    one, other = everything(assemble(mechanism)), everything(assemble(mechanism))
    assert not any(np.shares_memory(a, b) for a in one for b in other if a.size and b.size)


def test_what_a_run_writes_is_not_kept():
    mechanism = load_mechanism("incline")
    before = bits(mechanism)
    for array in everything(assemble(mechanism)):
        array[...] = array.dtype.type(1)
    assert bits(mechanism) == before


def test_what_a_run_writes_into_lent_arrays_is_gone_from_the_next():
    """The next run of a mechanism with other play gets the same memory, with what would be assembled for it."""
    mechanism = load_mechanism("c60")
    with lent_assembly(mechanism) as assembly:
        lent = everything(assembly)
        for array in lent:
            array[...] = array.dtype.type(1)
    other = set_values(mechanism, {"J1": 0.05})
    with lent_assembly(other) as assembly:
        again = everything(assembly)
        assert all(one is before for one, before in zip(again, lent, strict=True))
        assert [array.tobytes() for array in again] == [array.tobytes() for array in everything(assemble(other))]
        with lent_assembly(mechanism) as second:  # while the first is in use, as in another thread
            assert not any(np.shares_memory(a, b) for a, b in zip(again, everything(second), strict=True) if a.size)


def test_a_dict_that_somebody_edits_is_noticed():
    """Tables are immutable, but Python lets anybody put another one in its place."""
    mechanism = load_mechanism("c60")
    friction = assemble(mechanism).model.laws.mu.copy()
    mechanism.materials["steel_plastic"] = mechanism.materials["plastic_plastic"]
    assert (assemble(mechanism).model.laws.mu != friction).any()


def test_minus_zero_is_another_number():
    """A journal's rings at 0.0 and -0.0 are equal, but need not give the same bits."""
    data = shipped("clearance_pendulum")
    rings = data["joints"]["J1"]["rings"] = [1.0, 0.0]
    plus, other = made(data), copy_with(data, [rings[0], -0.0])
    assert plus.joints["J1"].rings == other.joints["J1"].rings
    shapes = [without_play(mechanism).joints["J1"] for mechanism in (plus, other)]
    assert [np.signbit(shape.rings[1]) for shape in shapes] == [False, True]


def copy_with(data: dict[str, Any], rings: list[float]) -> Mechanism:
    """Return the pendulum with other rings."""
    return made({**data, "joints": {"J1": {**data["joints"]["J1"], "rings": rings}}})


def test_only_what_was_read_decides():
    """A result is kept while the tables that it read are the same, also those that a method of the mechanism read."""
    built = []

    @cached
    def frictions(mechanism: Mechanism, factor: object) -> list[float]:
        built.append(mechanism)
        return [mechanism.contact_law(joint)[0] for joint in mechanism.joints.values()]

    mechanism, factor = load_mechanism("c60"), object()
    first = frictions(mechanism, factor)
    assert frictions(set_values(mechanism, {"springs.A3.preload": 0.9}), factor) is first
    others = [{"materials.steel_plastic.friction": 0.2}, {"J1": 0.05}]
    for number, values in enumerate(others, start=2):
        assert frictions(set_values(mechanism, values), factor) is not first
        assert len(built) == number
    assert frictions(mechanism, factor) is first
    assert frictions(mechanism, object()) is not first
