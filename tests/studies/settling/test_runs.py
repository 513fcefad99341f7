"""The runs of the study: every settling starts, and comes to rest in the way that it says."""

import pytest

from engine import check, load_mechanism, simulate
from studies.settling import CHOSEN, CONTINUED, Settling, mechanism_of, run, settlings
from tests.each import each

pytestmark = pytest.mark.slow

GAPS = {f"J{i}": 0.06 for i in range(1, 8)}
BY_NAME = {settling.name: settling for settling in settlings()}


@each("settling", settlings())
def test_every_settling_can_start(settling):
    """Its mechanism is a C-60 with the phases that it asks for."""
    mechanism = mechanism_of(settling)
    check(mechanism, GAPS)
    assert [phase.damping for phase in mechanism.phases] == list(settling.drag)
    assert ("latch_hold" in mechanism.torques) != settling.free


def test_a_run_is_that_of_the_shipped_mechanism():
    """The chosen settling gives, to the bit, what the shipped file gives; shorter steps are more steps."""
    ours, shipped = run(BY_NAME[CHOSEN], GAPS), simulate(load_mechanism("c60"), GAPS)
    assert ours.status == shipped.status == "ok"
    assert ours.responses == shipped.responses
    assert (ours.steps, ours.iterations) == (shipped.certificate.steps, shipped.certificate.iterations)
    assert run(BY_NAME[CHOSEN], GAPS, 1).steps > 1.5 * ours.steps


def test_rest_is_rest_without_drag():
    """What the run measures stays when it goes on without drag: the drag has held nothing."""
    braked, then_free = run(BY_NAME[CHOSEN], GAPS), run(BY_NAME[CONTINUED], GAPS)
    assert then_free.simulated > braked.simulated
    for name in ("FC-1", "FC-2", "FC-3", "FC-4", "FC-5", "FC-6", "latch_overlap"):
        assert then_free.responses[name] == pytest.approx(braked.responses[name], abs=1e-4)


def test_a_phase_of_fixed_length():
    """The latch is let go after the time that the settling says."""
    phases = mechanism_of(Settling("v", (20.0, 5.0), held=1.0)).phases
    assert [phase.duration for phase in phases] == [1.0, None]
