"""The settlings of the study: each is another one, and two of them are those that the C-60 is shipped with."""

import pytest

from engine import load_mechanism
from engine.mechanism import set_values
from studies.settling import CHOSEN, FREE_FALL, mechanism_of, settlings

pytestmark = pytest.mark.slow

BY_NAME = {settling.name: settling for settling in settlings()}
C60 = load_mechanism("c60")


def test_settlings_differ():
    """No two have the same name or do the same."""
    assert len(BY_NAME) == len(settlings()) == len({repr(settling.tables()) for settling in settlings()})


@pytest.mark.parametrize(
    ("name", "mechanism"), [(CHOSEN, C60), (FREE_FALL, set_values(C60, C60.preset("paper")))], ids=["default", "paper"]
)
def test_the_shipped_settlings_are_in_the_study(name, mechanism):
    """The mechanism file and its preset settle as the study says, so its tables tell what is shipped."""
    ours, shipped = mechanism_of(BY_NAME[name]), mechanism
    assert [(phase.name, phase.damping, phase.duration) for phase in ours.phases] == [
        (phase.name, phase.damping, phase.duration) for phase in shipped.phases
    ]
    assert ours.simulation == shipped.simulation


def test_all_steps_are_halved_together():
    """The shortest and the longest step, and the travel that decides between them."""
    settling = BY_NAME[CHOSEN]
    whole, quarter = settling.steps(0), settling.steps(2)
    assert quarter["step"] == whole["step"] / 4
    assert quarter["adaptive"] == {key: value / 4 for key, value in whole["adaptive"].items()}
