"""The two parts of a fit as two variables: a published example, and the moments of their clearance."""

from importlib.resources import files
from math import hypot

import numpy as np
import pytest

from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign_text
from engine import simulate
from engine.errors import MechanismError
from engine.mechanism import load_mechanism_text, set_values

LEVER = files("engine.mechanism").joinpath("library", "lever.toml").read_text("utf-8")
BEARING = 'bearing = { body = "lever", point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }'
HOLE, SHAFT = "joints.pin.bearing.diameter", "joints.pin.journal.diameter"


def fitted(hole: float, shaft: float) -> str:
    """Write the shipped lever with the diameters of its pin's fit."""
    text = LEVER.replace("radial_clearance = 0.05\n", "").replace("radius = 1.5 }", f"diameter = {shaft} }}")
    text = text.replace("radial_clearance_limit = 0.2", "radial_clearance_limit = 0.3")
    return text.replace(BEARING, f"{BEARING[:-2]}, diameter = {hole} }}")


def test_a_published_fit():
    """34 H11/c11 of Shigley, Mechanical Engineering Design, example 7-7.

    Hole 34.000 to 34.160 mm, shaft 33.720 to 33.880 mm: a radial clearance from 0.060 to 0.220 mm.
    """
    text = f"""
        format = 1
        name = "fit"
        mechanism = "lever.toml"
        samples = 20000
        seed = 4
        variables.hole = {{ target = "{HOLE}", dimension = "34 H11", cpk = 1.0 }}
        variables.shaft = {{ target = "{SHAFT}", dimension = "34 c11", cpk = 1.0 }}
    """
    campaign = load_campaign_text(text, {"lever.toml": fitted(34.08, 33.8).encode()})
    ends = [variable.cut() for variable in campaign.spec.variables.values()]
    assert ends == [pytest.approx((34.0, 34.16)), pytest.approx((33.72, 33.88))]
    extremes = {0.22: (34.16, 33.72), 0.06: (34.0, 33.88)}
    for clearance, (hole, shaft) in extremes.items():
        joint = set_values(campaign.mechanism, {HOLE: hole, SHAFT: shaft}).joints["pin"]
        assert joint.play("ring1") == pytest.approx(clearance, abs=1e-12)
        assert joint.radii == (shaft / 2, shaft / 2)
    drawn = draw(campaign.spec, 0, 20000)
    play = 0.5 * (drawn["hole"] - drawn["shaft"])
    spread = hypot(*(np.std(drawn[name]) for name in ("hole", "shaft"))) / 2  # independent: their variances add
    assert play.mean() == pytest.approx(0.14, abs=5 * spread / np.sqrt(20000))
    assert play.std() == pytest.approx(0.0186, rel=0.02)  # sqrt(2) 0.16 / 6 / 2, and 1.3 % less for the cut at 3 sigma
    assert 0.06 < play.min() < play.max() < 0.22


def test_what_is_wrong_with_diameters():
    """A shaft that is too thick; one diameter alone; a clearance beside both."""
    lever = load_mechanism_text(fitted(3.1, 3.0))
    with pytest.raises(MechanismError, match=r"no play; allowed: 0 < \(bearing.diameter - journal.diameter\) / 2"):
        set_values(lever, {SHAFT: 3.1})
    with pytest.raises(MechanismError, match="needs that of the bearing"):
        load_mechanism_text(LEVER.replace("radius = 1.5 }", "diameter = 3.0 }"))
    with pytest.raises(MechanismError, match="follows from the diameters"):
        load_mechanism_text(fitted(3.1, 3.0).replace("axial_clearance", "radial_clearance = 0.05\naxial_clearance"))
    with pytest.raises(MechanismError, match="has no number in this mechanism"):
        set_values(lever, {"pin": 0.05})


def test_the_diameters_of_a_joint_are_its_clearance():
    """A run bit for bit as with the clearance and the radius that follow from them."""
    by_diameters = simulate(load_mechanism_text(fitted(3.125, 3.0)))
    plain = LEVER.replace("radial_clearance = 0.05\n", "radial_clearance = 0.0625\n")
    by_clearance = simulate(load_mechanism_text(plain))
    assert by_diameters.status == "ok", by_diameters.message
    assert by_diameters.responses == by_clearance.responses
