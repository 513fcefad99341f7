"""The slider-crank with play: against events located exactly, and against Siconos."""

import numpy as np
import pytest

from tests.engine.oracles.event_driven import run as exact_run
from tests.engine.oracles.reference import at, recorded, table
from tests.engine.small import shipped


@pytest.fixture(scope="module")
def ours():
    """Return a run of the shipped mechanism with its step of 2e-5 s, 0.1 s."""
    return recorded(shipped("slider_crank"))


def impulses(run):
    """Return the sum of all normal impulses of each step."""
    return sum(contact.impulse[:, 0] for contact in run.contacts.values())


def test_motion_through_the_first_impacts_is_exact(ours):
    """Crank and rod within 3e-5 rad up to the third impact (measured 1.7e-5 and less), each impact within 5 steps.

    Instants of impacts are of first order; a bounce after each carries the error on.
    """
    time, states, hits = exact_run(3)
    rows = ours.time < hits[-1]
    for column, name in enumerate(("crank", "rod")):
        exact = np.interp(ours.time[rows], time, states[:, column])
        assert np.abs(ours.responses[name][rows] - exact).max() < 3e-5
    found = ours.time[impulses(ours) > 0][:3]
    assert np.abs(found - hits).max() < 5 * 2e-5


def test_gaps_stay_open_and_the_slider_straight(ours):
    """No corner passes the guide, both corners of a side meet it together, and energy only goes."""
    assert min(contact.gap.min() for contact in ours.contacts.values()) >= -1e-11
    assert np.abs(ours.responses["slider"]).max() < 1e-7
    energy = ours.kinetic + ours.potential
    assert np.diff(energy).max() < 1e-4 * energy[0]
    assert 0.8 * energy[0] < energy[-1] < energy[0]


def test_siconos_agrees_as_far_as_it_keeps_its_energy(ours):
    """Crank within 6e-3 rad, slider within 0.13 mm of 2 mm for 0.02 s; later Siconos has gained too much energy.

    Its combined projection at h = 1e-4 s goes from 7.50 J to 8.58 J, though friction and impacts only take.
    Before the first impact, where the exact motion is known, it is 5e-4 rad off, and this engine 5e-6 rad.
    """
    theirs = table("slider_crank_siconos")
    early = theirs["t"] <= 0.01
    times = theirs["t"][early]
    assert np.abs(at(ours, times, ours.responses["crank"]) - theirs["th1"][early]).max() < 6e-3
    assert np.abs(at(ours, times, ours.responses["rod"]) - theirs["th2"][early]).max() < 2e-3
    early = theirs["t"] <= 0.02
    lift = 0.153 * np.sin(theirs["th1"]) + 0.306 * np.sin(theirs["th2"])
    assert np.abs(at(ours, theirs["t"][early], ours.responses["lift"]) - lift[early]).max() < 1.3e-4
    time, states, hits = exact_run(1)
    free = theirs["t"] < hits[0]
    assert np.abs(np.interp(theirs["t"][free], time, states[:, 0]) - theirs["th1"][free]).max() > 4e-4
