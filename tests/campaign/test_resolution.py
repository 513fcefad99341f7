"""What the solver resolves of a response follows from the tolerances of its mechanism."""

import pytest

from campaign.plan import resolution
from engine import load_mechanism


def test_a_length_is_known_to_the_penetration() -> None:
    incline = load_mechanism("incline")
    assert resolution(incline, "slide") == (incline.simulation.penetration, 0.0)


def test_a_force_is_known_to_the_residual_and_a_pure_number_exactly() -> None:
    c60 = load_mechanism("c60")
    units = c60.response_units()
    found = {units[name]: resolution(c60, name) for name in c60.responses}
    assert found["N"] == (0.0, c60.simulation.tolerance)
    assert found["mm"] == (c60.simulation.penetration, 0.0)


def test_an_angle_is_known_to_the_penetration_at_the_farthest_point() -> None:
    pendulum = load_mechanism("double_pendulum")
    angles = [name for name, unit in pendulum.response_units().items() if unit == "rad"]
    for name in angles:
        absolute, relative = resolution(pendulum, name)
        assert (absolute, relative) == (pytest.approx(pendulum.simulation.penetration, rel=10), 0.0)
    assert angles
