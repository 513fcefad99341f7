"""The shipped planetary gear: ratio, lost motion and load of a planet's pin are those of closed forms."""

import numpy as np
import pytest

from engine import load_mechanism, simulate
from engine.mechanism import set_values
from tests.each import each

SUN, RING, ARM, BASE = 20, 52, 9.0, 5.0 * np.cos(np.radians(20.0))


@each(("backlash", "play", "brake"), [(0.03, 0.005, 60.0), (0.05, 0.02, 30.0), (0.0, 0.01, 90.0)])
def test_ratio_lost_motion_and_load(backlash, play, brake):
    """A planet's centre gives way by half the backlash, the yielding of two teeth, and the play of its pin.

    Both tooth forces load a pin along its way only: their radial parts cancel.
    """
    mechanism = load_mechanism("planetary_gear")
    values = {"parameters.backlash": backlash, "parameters.play": play, "parameters.brake": brake}
    run = simulate(set_values(mechanism, values))
    assert run.status == "ok", run.message
    found, load = run.responses, brake / (3 * ARM)
    yields = 0.5 * load / mechanism.parameters["teeth"] / np.cos(np.radians(20.0)) ** 2
    lost = (0.5 * backlash + yields + play) / ARM
    assert found["ratio"] == pytest.approx(1 + RING / SUN, rel=3e-5)
    assert found["there"] == pytest.approx(2 * np.pi * SUN / (SUN + RING) - lost, abs=2e-5)
    assert found["lost_motion"] == pytest.approx(lost, abs=2e-5)
    assert found["pin_load"] == pytest.approx(load, rel=1e-2)
    assert run.certificate.created_energy < 1e-3 * run.certificate.max_kinetic_energy
