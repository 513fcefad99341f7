"""Contacts of Hertz: indentation, time and force of an impact, the energy account, steps of any length."""

import numpy as np
import pytest
from scipy.special import gamma

from engine import simulate
from engine.errors import MechanismError
from tests.engine.small import GRAVITY, made
from tests.engine.test_compliance import MASS, falling

HERTZ = 1e6  # N/m^1.5
DEEP = (5 * MASS / (4 * HERTZ)) ** 0.4  # of an impact at 1 m/s
LASTS = 2 * np.sqrt(np.pi) * gamma(1.4) / gamma(0.9) * DEEP  # 2.943 of them


def on_hertz(**described):
    """Describe the ball on a floor with the law of Hertz."""
    data = falling(**described)
    del data["contacts"]["floor"]["stiffness"]
    data["contacts"]["floor"]["hertz_stiffness"] = HERTZ
    return data


def test_an_impact_is_that_of_hertz():
    """As deep and as long as he says, and elastic: of second order in the step."""
    data, missing = on_hertz(speed=1.0, duration=0.05), []
    data["responses"]["left"] = {"type": "time", "at": {"response": "z", "above": 1e-9}}
    for step in (2e-4, 1e-4):
        data["simulation"]["step"] = step
        run = simulate(made(data))
        assert run.status == "ok", run.message
        assert run.responses["deep"] == pytest.approx(-DEEP, rel=2e-3)
        assert run.responses["peak"] == pytest.approx(HERTZ * DEEP**1.5, rel=3e-3)
        assert run.responses["left"] == pytest.approx(LASTS, abs=step)
        assert run.certificate.created_energy < 1e-8
        missing.append(1.0 - run.responses["speed"])
    assert 0.0 <= missing[0] < 2e-3
    assert missing[0] > 2.5 * missing[1]


@pytest.mark.parametrize("step", [5e-4, 0.05, 1.0])
def test_a_load_rests_where_its_spring_holds_it(step):
    """(m g / k)^(2/3) deep, whatever the step, and the floor reports its weight."""
    data = on_hertz(height=0.02, damping=50.0)
    data["simulation"] |= {"step": step, "rest": {"window": max(0.5, 4 * step), "drift": 1e-7}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(-((MASS * GRAVITY / HERTZ) ** (2 / 3)), rel=1e-3)
    assert run.responses["force"] == pytest.approx(MASS * GRAVITY, rel=1e-3)
    assert run.certificate.created_energy < 1e-6


def test_one_law_at_a_time():
    data = on_hertz()
    data["contacts"]["floor"]["stiffness"] = 5.0
    with pytest.raises(MechanismError, match=r"contacts\.floor\.hertz_stiffness"):
        made(data)
