"""The shipped push-button: its operating curve is that of its dome, moved up and down by the friction of its guide."""

import pytest

from engine import load_mechanism, simulate
from engine.mechanism import set_values

INERTIA = 1e-3  # N, of 2 g that the finger moves by 1.1 mm in 300 ms; more than that


@pytest.mark.parametrize(("peak", "valley", "friction"), [(3.0, 1.2, 0.15), (4.2, 2.0, 0.4), (2.5, 0.9, 0.0)])
def test_its_forces_are_those_of_the_dome_and_the_friction(peak, valley, friction):
    """Friction takes its force along 1.1 mm, twice."""
    values = {"parameters.peak": peak, "parameters.valley": valley, "parameters.friction": friction}
    run = simulate(set_values(load_mechanism("push_button"), values))
    assert run.status == "ok", run.message
    found = run.responses
    assert found["actuation"] == pytest.approx(peak + friction, abs=INERTIA)
    assert found["push_at_valley"] == pytest.approx(-valley - friction, abs=INERTIA)
    assert found["push_on_return"] == pytest.approx(friction - peak, abs=INERTIA)
    assert found["snap"] == pytest.approx(1 - (valley + friction) / (peak + friction), abs=INERTIA)
    assert found["hysteresis"] == pytest.approx(2 * friction, abs=INERTIA)
    assert found["loss"] == pytest.approx(friction * 2.2, rel=1e-4, abs=1e-9)
    assert run.certificate.created_energy < 1e-9
