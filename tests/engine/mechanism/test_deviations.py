"""Axes off their drawing: as typed at their place, closed forms of gaps, and zones of a campaign with a bonus."""

from importlib.resources import files
from math import cos, hypot, pi, sin
from typing import Any

import numpy as np
import pytest

from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign_text
from engine import simulate
from engine.assembly import assemble
from engine.mechanism import get_value, set_values, settable_keys
from tests.engine.small import made, small

Z = [0.0, 0.0, 1.0]
OFF, WAY, TILT, TILT_WAY = 0.03, 0.7, 0.01, 2.0


def wheel(bearing: dict[str, Any], journal: dict[str, Any]) -> dict[str, Any]:
    """Describe a wheel on the ground's pin, with rings at -1 and 3 and a play of 0.1; overlap is let pass."""
    joint = {
        "type": "clearance_cylindrical",
        "bearing": {"body": "part", "point": [0.2, 0.1, 0], "axis": Z, **bearing},
        "journal": {"body": "ground", "point": [0.2, 0.1, 0], "axis": Z, "radius": 0.5, **journal},
        "rings": [-1.0, 3.0],
        "radial_clearance": 0.1,
        "friction": 0.1,
    }
    return small(
        bodies={"ground": {"fixed": True}, "part": {"mass": 1.0, "inertia": [1, 1, 1]}},
        joints={"J": joint},
        simulation={"penetration": 1e3},
    )


def gaps(data: dict[str, Any]) -> list[float]:
    """Return the gaps of the two rings at the start."""
    return [float(gap) for gap in assemble(made(data)).state.gap]


def test_an_axis_off_its_place_and_tilted():
    """A ring at station s has its centre at off u(way) + s sin t u(tilt_way), across the other's axis."""
    off = {"off": OFF, "way": WAY, "tilt": TILT, "tilt_way": TILT_WAY}
    for found, station in zip(gaps(wheel({"deviation": off}, {})), (-1.0, 3.0), strict=True):
        x = OFF * cos(WAY) + station * sin(TILT) * cos(TILT_WAY)
        y = OFF * sin(WAY) + station * sin(TILT) * sin(TILT_WAY)
        assert found == pytest.approx(0.1 - hypot(x, y), abs=1e-14)


@pytest.mark.parametrize("side", ["bearing", "journal"])
def test_a_deviation_is_a_point_and_an_axis_typed_in(side):
    """On either side, about an axis that leans."""
    axis = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    e = np.array([0.0, 1.0, 0.0]) - axis[1] * axis  # y is the most perpendicular to it
    e = e / np.linalg.norm(e)
    f = np.cross(axis, e)
    point = np.array([0.2, 0.1, 0]) + OFF * (cos(WAY) * e + sin(WAY) * f)
    turned = cos(TILT) * axis + sin(TILT) * (cos(TILT_WAY) * e + sin(TILT_WAY) * f)
    off = {"axis": axis.tolist(), "deviation": {"off": OFF, "way": WAY, "tilt": TILT, "tilt_way": TILT_WAY}}
    typed = {"axis": turned.tolist(), "point": point.tolist()}
    plain = {"axis": axis.tolist()}
    drawn = [wheel(x, plain) if side == "bearing" else wheel(plain, x) for x in (off, typed)]
    assert gaps(drawn[0]) == pytest.approx(gaps(drawn[1]), abs=1e-14)


def test_an_ideal_joint_is_closed_where_its_sides_are():
    """The wheel is moved to where the deviation has its bore; and the keys of a deviation can be set."""
    data = wheel({"deviation": {"off": 0.0}}, {})
    data["joints"]["J"]["type"] = "cylindrical"
    data["simulation"]["penetration"] = 1e-9
    data["bodies"]["part"]["center_of_mass"] = [0.2, 0.1, 0.0]  # about which it does not turn then
    mechanism = made(data)
    assert {f"joints.J.bearing.deviation.{key}" for key in ("off", "way", "tilt", "tilt_way")} <= {
        *settable_keys(mechanism)
    }
    assembly = assemble(set_values(mechanism, {"joints.J.bearing.deviation.off": 0.02}))
    assert assembly.state.x[0] == pytest.approx([0.18, 0.1, 0.0], abs=1e-8)
    assert assembly.travel == pytest.approx(0.02, abs=1e-8)


def test_nothing_of_it_is_in_a_mechanism_without():
    """So its digest stays."""
    dump = made(wheel({}, {})).model_dump(mode="json", by_alias=True)["joints"]["J"]
    assert "deviation" not in dump["bearing"].keys() | dump["journal"].keys()


LEVER = files("engine.mechanism").joinpath("library", "lever.toml").read_text("utf-8")
ZONES = """
format = 1
name = "zones"
mechanism = "lever.toml"
samples = 4000
[variables]
hole = { target = "parameters.hole", distribution = "uniform", lower = 3.05, upper = 3.15 }
share = { target = "parameters.share", distribution = "position", zone = 2.0 }
way = { target = "parameters.way", distribution = "uniform", lower = 0.0, upper = 6.283185307 }
"""


def test_a_position_zone_with_the_bonus_of_maximum_material():
    """With a zone of 0.04 and a bore from 3.05 on: E(off) = 2/3 (0.04 + E(hole) - 3.05) / 2, and the ways are even.

    The force on the stop is load long' / short', from the bore's own place: 4 N (30 - x) / (12 + x).
    """
    text = LEVER.replace("[parameters]\n", "[parameters]\nhole = 3.1\nshare = 0.5\nway = 0.0\n")
    text = text.replace("radial_clearance = 0.05\n", "").replace("radius = 1.5 }", "diameter = 3.0 }")
    bearing = 'bearing = { body = "lever", point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0]'
    deviation = 'deviation = { off = "share * (0.04 + hole - 3.05) / 2", way = "way" }'
    text = text.replace(bearing, f'{bearing}, diameter = "hole", {deviation}')
    campaign = load_campaign_text(ZONES, {"lever.toml": text.encode()})
    drawn, targets = draw(campaign.spec, 0, 4000), campaign.spec.targets()
    off = drawn["share"] * (0.04 + drawn["hole"] - 3.05) / 2
    key = "joints.pin.bearing.deviation.off"
    for i in range(3):
        values = {targets[name]: float(column[i]) for name, column in drawn.items()}
        assert get_value(set_values(campaign.mechanism, values), key) == pytest.approx(off[i], rel=1e-12)
    mean = 2 / 3 * (0.04 + 0.05) / 2
    assert off.mean() == pytest.approx(mean, abs=5 * off.std() / np.sqrt(4000))
    assert off.max() < (0.04 + 0.1) / 2
    assert abs(np.exp(1j * drawn["way"]).mean()) < 5 / np.sqrt(4000)
    run = simulate(campaign.mechanism, {"parameters.share": 1.0, "parameters.way": pi, "parameters.hole": 3.15})
    assert run.status == "ok", run.message
    assert run.responses["force"] == pytest.approx(4 * (30 + 0.07) / (12 - 0.07), rel=1e-5)
