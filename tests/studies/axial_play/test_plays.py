"""The starts of the study: each is another one, and none needs parts that overlap."""

import numpy as np
import pytest

from engine import load_mechanism
from engine.mechanism import set_values
from studies.axial_play import CENTRED, SHIPPED, plays, starts
from tests.each import each
from tests.engine.mechanism.test_c60 import axial_gaps

pytestmark = pytest.mark.slow

ALL = plays()
C60 = load_mechanism("c60")


def gaps(play, sample):
    """Return the gaps of the axial stops at the start of a sample."""
    return axial_gaps(set_values(C60, starts(play, sample)))


def test_starts_differ():
    """No two have the same name or the same numbers, and only the shipped one changes nothing."""
    changed = [repr(starts(play, 0)) for play in ALL]
    assert len(set(changed)) == len(ALL) == len({play.name for play in ALL})
    assert [play.name for play in ALL if not starts(play, 0)] == [SHIPPED]
    assert ALL[1].name == CENTRED


@each("play", ALL)
def test_no_start_overlaps(play):
    """Every stop is open or just touched, in every sample."""
    assert min(min(gaps(play, sample).values()) for sample in range(20)) > -1e-9


def test_a_start_elsewhere_keeps_the_drawn_play():
    """Lifting parts divides the same play differently; opening a flange adds to it."""
    drawn = gaps(ALL[0], 0)
    for play in ALL[1:]:
        total = sum(gaps(play, 3)[stop] for stop in ("S7", "S8", "S11"))
        if play.opened is None:
            assert total == pytest.approx(0.1), play.name
        elif play.opened != "random":
            assert total == pytest.approx(0.1 + play.opened.get("S7", 0) + play.opened.get("S8", 0)), play.name
    assert [drawn["S7"], drawn["S8"]] == pytest.approx([0, 0], abs=1e-12)


def test_random_starts_reach_the_whole_play():
    """Drawn anew for each sample, and the same again for the same sample."""
    play = next(play for play in ALL if play.lifts == "random")
    found = np.array([list(gaps(play, sample).values()) for sample in range(200)])
    assert np.ptp(found[:, list(gaps(play, 0)).index("S8")]) > 0.08
    assert gaps(play, 5) == gaps(play, 5) != gaps(play, 6)
