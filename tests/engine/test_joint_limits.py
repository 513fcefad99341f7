"""Stops of ideal joints: where a joint ends, with which force, and how it bounces, against closed forms."""

import copy
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values
from tests.each import each
from tests.engine.small import GRAVITY, coordinates, made, small, turned

MASS, ARM = 2.0, 0.25


def hinged(torque: float = 0.0, spin: float = 0.0, **limits: Any) -> dict[str, Any]:
    """Describe a lever on an ideal hinge, without gravity, with a torque on it; inertia about the hinge 0.3 kg m2."""
    inertia = 0.3 - MASS * ARM**2
    return small(
        phases=[{"name": "run", "duration": 0.4}] if spin else [{"name": "settle"}],
        simulation={"horizon": 3.0},
        bodies={
            "base": {"fixed": True, "axis": [0, 0, 1], "angle": 0.7},
            "lever": {
                "mass": MASS,
                "inertia": [1, 1, inertia],
                "center_of_mass": [ARM, 0, 0],
                "velocity": [0, spin * ARM, 0],
                "angular_velocity": [0, 0, spin],
            },
        },
        joints={
            "hinge": {
                "type": "revolute",
                "bearing": {"body": "base", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "journal": {"body": "lever", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "limits": limits,
            }
        },
        torques={"t": {"body": "lever", "torque": [0, 0, torque]}},
        responses={
            "angle": {"type": "angle", "body": "lever", "axis": [0, 0, 1]},
            "upper": {"type": "contact_force", "contact": "hinge.upper"},
            "lower": {"type": "contact_force", "contact": "hinge.lower"},
        },
    )


@pytest.mark.parametrize(("torque", "end"), [(1.5, 0.4), (-1.5, -0.9)])
def test_a_lever_stops_at_the_limit_that_its_torque_presses_it_to(torque, end):
    """With the number of the torque as the force of the stop; the other stop is free."""
    run = simulate(made(hinged(torque, lower=-0.9, upper=0.4)))
    assert run.status == "ok", run.message
    assert run.responses["angle"] == pytest.approx(end, abs=1e-7)
    here, there = ("upper", "lower") if torque > 0 else ("lower", "upper")
    assert run.responses[here] == pytest.approx(1.5, rel=1e-6)
    assert run.responses[there] == 0.0


def test_it_bounces_with_the_restitution_of_its_limits():
    """At 4 rad/s from 0: at 0.4 rad after 0.1 s, back with 0.5 of the speed, and after 0.4 s at 0.4 - 2 x 0.3 rad.

    An impact on a body that turns is of first order: at most the angle of a step, 4e-3, is off.
    """
    data = hinged(spin=4.0, lower=-1.0, upper=0.4, restitution=0.5)
    data["responses"]["speed"] = {"type": "angular_velocity", "body": "lever", "axis": [0, 0, 1]}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["speed"] == pytest.approx(-2.0, rel=1e-3)
    assert run.responses["angle"] == pytest.approx(0.4 - 0.6, abs=1e-2)
    assert run.certificate.max_created_energy < 1e-9


def test_wide_limits_do_not_touch():
    """From -1.49 to 1.5 rad, without a torque: nothing is felt anywhere between."""
    data = hinged(spin=3.0, lower=-1.49, upper=1.5)
    free = copy.deepcopy(data)
    del free["joints"]["hinge"]["limits"], free["responses"]["upper"], free["responses"]["lower"]
    assert simulate(made(data)).responses["angle"] == pytest.approx(simulate(made(free)).responses["angle"], abs=1e-12)


def sliding(type_: str = "prismatic", **limits: Any) -> dict[str, Any]:
    """Describe a slider on a vertical guide, 0.1 m above the guide's point."""
    first, second = ("guide", "slider") if type_ == "prismatic" else ("bearing", "journal")
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"horizon": 3.0},
        bodies={"ground": {"fixed": True}, "load": {"mass": MASS, "inertia": [1, 1, 1], "origin": [0, 0, 0.1]}},
        joints={
            "slide": {
                "type": type_,
                first: {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1]},
                second: {"body": "load", "point": [0, 0, 0], "axis": [0, 0, 1]},
                "limits": limits,
            }
        },
        responses=coordinates("load") | {"stop": {"type": "contact_force", "contact": "slide.lower"}},
    )


@each("type_", ["prismatic", "cylindrical"])
def test_a_slider_falls_on_its_stop(type_):
    """The stop carries the weight; a campaign may vary its place; turned elsewhere all is the same."""
    data = sliding(type_, lower=-0.05)
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(-0.05, abs=1e-7)
    assert run.responses["stop"] == pytest.approx(MASS * GRAVITY, rel=1e-6)
    lower = simulate(set_values(made(data), {"joints.slide.limits.lower": -0.08}))
    assert lower.responses["z"] == pytest.approx(-0.08, abs=1e-7)
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["stop"] == pytest.approx(run.responses["stop"], rel=1e-6)


def fault(data: dict[str, Any]) -> str:
    """Return the message of the one fault of a mechanism."""
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    return str(caught.value).split("\n")[1].strip()


def test_limits_that_make_no_sense_are_refused_with_what_is_allowed():
    """Each message begins with the key."""
    assert "allowed: lower, upper or both" in fault(sliding())
    assert fault(sliding(lower=0.3, upper=0.2)).startswith("joints.slide.limits.lower = 0.3")
    assert "0.1 m beyond it at the start" in fault(sliding(lower=0.2))
    wide = fault(hinged(lower=-2.0, upper=1.5))
    assert wide.startswith("joints.hinge.limits.upper = 1.5")
    assert "3.5 rad apart; allowed: 0 < upper - lower <= 3" in wide
    assert "allowed: <= 0" in fault(hinged(lower=0.1, upper=1.5))
    loose = hinged(lower=-0.1, upper=0.1)
    loose["joints"]["hinge"] |= {"type": "clearance_revolute", "rings": [0], "radial_clearance": 1e-3, "friction": 0}
    loose["joints"]["hinge"]["journal"]["radius"] = 0.01
    assert "write each stop as a contact" in fault(loose)
    force = sliding(lower=0.0)
    force["responses"]["f"] = {"type": "joint_force", "joint": "slide"}
    assert "allowed: joints with clearance" in fault(force)
