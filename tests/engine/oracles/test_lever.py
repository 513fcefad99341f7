"""The shipped lever against load * long / short, with its dimensions varied by parameters and by single components."""

import re
import tomllib
from importlib.resources import files

import pytest

from engine import load_mechanism, simulate
from engine.mechanism import mechanism_from

pytestmark = pytest.mark.bits

TEXT = files("engine.mechanism").joinpath("library", "lever.toml").read_text("utf-8")


def typed(long=30.0, short=12.0, mass=2.0, load=4.0):
    """Return the lever as one writes it who has no parameters: a number in the place of each expression."""
    inertia = mass * (long + short) ** 2 / 12
    numbers = {
        "mass": mass,
        "(long - short) / 2": (long - short) / 2,
        "mass * 1.0": mass * 1.0,
        "mass * (long + short)**2 / 12": inertia,
        "-short": -short,
        "long": long,
        "-load": -load,
    }
    text = re.sub(r"^\[parameters\].*?^(?=\[simulation\])", "", TEXT, flags=re.DOTALL | re.MULTILINE)
    for expression, number in numbers.items():
        text = text.replace(f'"{expression}"', repr(number))
    return tomllib.loads(text)


@pytest.mark.parametrize("dimensions", [{}, {"long": 31.7, "short": 11.3}, {"load": 5.5, "mass": 1.1}])
def test_varied_parameters_are_numbers_typed_in(dimensions):
    """The same run, bit for bit; and the force that the lever rule says."""
    varied = simulate(load_mechanism("lever"), {f"parameters.{name}": x for name, x in dimensions.items()})
    written = simulate(mechanism_from(typed(**dimensions), "typed"))
    assert varied.status == "ok", varied.message
    assert varied.responses == written.responses
    assert varied.certificate.steps == written.certificate.steps
    all_of_them = {"long": 30.0, "short": 12.0, "load": 4.0} | dimensions
    lever_rule = all_of_them["load"] * all_of_them["long"] / all_of_them["short"]
    assert varied.responses["force"] == pytest.approx(lever_rule, rel=1e-6)


def test_a_varied_component_is_a_number_typed_in():
    """The bore 0.02 mm off its place makes one arm longer and the other shorter; again the same bits."""
    off = 0.02
    varied = simulate(load_mechanism("lever"), {"joints.pin.bearing.point.x": off})
    data = typed()
    data["joints"]["pin"]["bearing"]["point"][0] = off
    assert varied.responses == simulate(mechanism_from(data, "typed")).responses
    assert varied.responses["force"] == pytest.approx(4.0 * (30.0 - off) / (12.0 + off), rel=1e-6)


def test_a_load_that_leans():
    """The components of a force: what acts along the arm has no moment about the pin, but for its height there."""
    upright, leaning = (simulate(load_mechanism("lever"), {"forces.load.force.x": x}).responses for x in (0.0, 1.0))
    assert upright["force"] == pytest.approx(10.0, rel=1e-6)
    assert leaning["force"] == pytest.approx(10.0, rel=5e-3)
    assert leaning["force"] != upright["force"]
