"""A pin pressed into elastic rings: what it holds, how far it yields, and what is left where it lifts off."""

from math import cos, pi, sin

import pytest

from engine import MechanismError, set_values, simulate
from engine.mechanism.keys.values import settable_numbers
from engine.preflight.plausibility import implausible_numbers
from tests.each import each
from tests.engine.small import coordinates, made, small

STIFF, TIGHT, RADIUS, FRICTION, MASS = 1e6, 1e-5, 5e-3, 0.15, 0.1
PRESSES = 2.0 * STIFF * TIGHT  # the sum of the normal forces all round a ring
RINGS = (-0.02, 0.02)


def pressed(load=(0.0, 0.0, 0.0), torque=0.0, duration=None, **joint):
    """Describe a pin along z that two rings of the ground press, and on which a force and a torque about z act."""
    data = small(
        bodies={"ground": {"fixed": True}, "pin": {"mass": MASS, "inertia": [1e-4, 1e-4, 1e-5]}},
        joints={
            "fit": {
                "type": "clearance_revolute",
                "bearing": {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "journal": {"body": "pin", "point": [0, 0, 0], "axis": [0, 0, 1], "radius": RADIUS},
                "rings": list(RINGS),
                "radial_clearance": -TIGHT,
                "ring_stiffness": STIFF,
                "ring_damping": 20.0,
                "friction": FRICTION,
                **joint,
            }
        },
        forces={"load": {"body": "pin", "point": [0, 0, 0], "force": list(load)}},
        torques={"drive": {"body": "pin", "torque": [0, 0, torque]}},
        responses=coordinates("pin") | {"angle": {"type": "angle", "body": "pin", "axis": [0, 0, 1]}},
    )
    data["simulation"] |= {"horizon": 5.0, "step": 1e-3}
    if duration is not None:
        data["phases"] = [{"name": "all", "duration": duration}]
    return data


def test_a_press_fit_holds_a_torque():
    """Up to friction times radius times the pressure all round both rings, 2 mu r (2 K delta); above it turns."""
    most = 2 * FRICTION * RADIUS * PRESSES
    holds = simulate(made(pressed(torque=0.99 * most)))
    assert holds.status == "ok", holds.message
    assert holds.responses["angle"] == pytest.approx(0.0, abs=1e-6)
    turns = simulate(made(pressed(torque=1.2 * most, duration=0.02)))
    assert turns.responses["angle"] == pytest.approx(0.5 * 0.2 * most / 1e-5 * 0.02**2, rel=1e-3)


def test_a_press_fit_holds_a_pull():
    """The pin is pulled out against friction times the pressure, while a torque takes a part of what holds."""
    most = 2 * FRICTION * PRESSES
    holds = simulate(made(pressed(load=(0.0, 0.0, 0.99 * most))))
    assert holds.status == "ok", holds.message
    assert holds.responses["z"] == pytest.approx(0.0, abs=1e-8)
    slips = simulate(made(pressed(load=(0.0, 0.0, 1.2 * most), duration=0.02)))
    assert slips.responses["z"] == pytest.approx(0.5 * 0.2 * most / MASS * 0.02**2, rel=1e-3)
    both = 0.8 * most, 0.8 * most * RADIUS  # their resultant is 1.13 of what holds
    assert abs(simulate(made(pressed(load=(0.0, 0.0, both[0]), torque=both[1], duration=0.02))).responses["z"]) > 1e-6


@pytest.mark.parametrize("angle", [0.0, 0.3, pi / 8])
def test_a_pressed_pin_yields_alike_in_all_directions(angle):
    """By the load over the stiffness of both rings, as long as it is pressed all round."""
    load, far = 12.0, 12.0 / (2 * STIFF)
    run = simulate(made(pressed(load=(load * cos(angle), load * sin(angle), 0.0), friction=0.0)))
    assert run.status == "ok", run.message
    assert run.responses["x"] == pytest.approx(far * cos(angle), abs=2e-3 * far)
    assert run.responses["y"] == pytest.approx(far * sin(angle), abs=2e-3 * far)
    assert run.certificate.created_energy < 1e-9


def test_with_play_it_goes_to_the_other_side():
    """A clearance is taken up first; then the side that touches yields, with the springs that it presses."""
    play = 2e-5
    run = simulate(made(pressed(load=(3.0, 0.0, 0.0), friction=0.0, radial_clearance=play)))
    assert run.status == "ok", run.message
    deep = 3.0 / 2 / (2 * STIFF / 8)  # one of eight springs a ring, its neighbours do not touch
    assert deep < play * (1 / cos(pi / 4) - 1)
    assert run.responses["x"] == pytest.approx(play + deep, rel=2e-3)


def test_a_clearance_may_change_its_sign():
    """A campaign draws fits that are loose or tight: the same mechanism but for one number."""
    mechanism = made(pressed(friction=0.0, load=(12.0, 0.0, 0.0)))
    [number] = [each for each in settable_numbers(mechanism) if each.key == "joints.fit.radial_clearance"]
    assert (number.lower, number.upper) == (-RADIUS, RADIUS)
    loose = simulate(set_values(mechanism, {"fit": 1e-5}))
    assert loose.responses["x"] > simulate(set_values(mechanism, {"fit": -2e-5})).responses["x"] > 0.0
    tight = simulate(set_values(mechanism, {"fit": -TIGHT}))
    assert tight.responses == simulate(mechanism).responses
    assert [*implausible_numbers(mechanism)] == []


@each(
    ("change", "named"),
    [
        ({"ring_stiffness": None, "ring_damping": None}, r"radial_clearance.*ring_stiffness if the pin is pressed in"),
        ({"ring_stiffness": None}, r"joints\.fit\.ring_damping"),
        ({"radial_clearance": -2 * RADIUS}, r"joints\.fit\.radial_clearance"),
        ({"journal": {"lobes": {"number": 3, "height": 1e-6}}}, r"joints\.fit\.journal\.lobes"),
    ],
)
def test_what_is_refused(change, named):
    data = pressed()
    joint = data["joints"]["fit"]
    journal = joint["journal"] | change.get("journal", {})
    data["joints"]["fit"] = {k: v for k, v in (joint | change | {"journal": journal}).items() if v is not None}
    with pytest.raises(MechanismError, match=named):
        made(data)


def test_the_plain_scheme_has_rigid_rings_only():
    data = pressed()
    data["simulation"]["scheme"] = "moreau_jean"
    with pytest.raises(MechanismError, match=r"joints\.fit\.ring_stiffness"):
        made(data)
