"""Contacts that hold more while they stick than while they slide: closed forms, stick-slip, what it leaves alone."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import set_values, settable_keys
from tests.each import each
from tests.engine.small import FLOOR, GRAVITY, block_on_floor, coordinates, made, small, turned

SLIDING, STATIC = 0.4, 0.6


def slope(angle: float, speed: float = 0.0, **contact: Any) -> dict[str, Any]:
    """Describe a brick on a floor, with gravity inclined to it by an angle towards x."""
    data = block_on_floor(origin=[0, 0, 0.1], velocity=[speed, 0, 0])
    data["gravity"] = [GRAVITY * np.sin(angle), 0, -GRAVITY * np.cos(angle)]
    for each_one in data["contacts"].values():
        del each_one["restitution"]
        each_one |= {"friction": SLIDING, "static_friction": STATIC, **contact}
    return data


def test_a_brick_between_the_two_angles_stays_at_rest_and_slides_on_once_pushed():
    """Below atan 0.6 it stays, also with forces at rest; pushed, it gains g (sin - 0.4 cos) t."""
    angle = float(np.arctan(0.5))
    rests = simulate(made(slope(angle)))
    assert rests.status == "ok", rests.message
    assert rests.responses["x"] == pytest.approx(0.0, abs=1e-9)
    for speed in (0.2, 1e-3):
        data = slope(angle, speed)
        data["phases"] = [{"name": "run", "duration": 0.2}]
        gained = GRAVITY * (np.sin(angle) - SLIDING * np.cos(angle))
        slides = simulate(made(data))
        assert slides.responses["x"] == pytest.approx(speed * 0.2 + 0.5 * gained * 0.2**2, rel=1e-3)
        assert slides.certificate.created_energy < 1e-8


@each(("steepness", "moves"), [(0.599, False), (0.601, True)])
def test_it_starts_to_slide_at_the_static_angle(steepness, moves):
    """And then with the friction of sliding, but for its first step."""
    angle = float(np.arctan(steepness))
    data = slope(angle)
    data["phases"] = [{"name": "run", "duration": 0.2}]
    run = simulate(made(data))
    gained = GRAVITY * (np.sin(angle) - SLIDING * np.cos(angle)) if moves else 0.0
    assert run.responses["x"] == pytest.approx(0.5 * gained * 0.2**2, rel=0.02, abs=1e-9)


def test_a_brick_that_stops_sticks_again():
    """On a slope of less than atan 0.4 it stops, and then holds a pull that would have kept it sliding."""
    angle = float(np.arctan(0.2))
    data = slope(angle, 0.3)
    pull = [0.35 * 2.0 * GRAVITY * float(np.cos(angle)), 0.0, 0.0]
    law = {"table": [[0, 0], [0.5, 0], [0.51, 1]]}
    data["forces"] = {"pull": {"body": "block", "force": pull, "law": law}}
    data["phases"] = [{"name": "run", "duration": 0.8}]
    run = simulate(made(data))
    slowed = GRAVITY * (SLIDING * np.cos(angle) - np.sin(angle))
    assert run.responses["x"] == pytest.approx(0.5 * 0.3**2 / slowed, rel=5e-3)


PULL, DRAWN = 500.0, 0.02  # N/m, m/s


def drawn(duration: float, step: float = 2e-4) -> dict[str, Any]:
    """Describe a block that a spring pulls, whose other end is drawn at a constant speed."""
    data = small(
        gravity=[0, 0, -GRAVITY],
        phases=[{"name": "run", "duration": duration}],
        simulation={"step": step, "horizon": 10.0},
        bodies={
            "ground": {"fixed": True},
            "block": {"mass": 2.0, "inertia": [1, 1, 1]},
            "hand": {"mass": 1.0, "inertia": [1, 1, 1], "origin": [1.0, 0, 0], "velocity": [DRAWN, 0, 0]},
        },
        joints={
            "rail": {
                "type": "prismatic",
                "guide": {"body": "ground", "point": [0, 0, 0], "axis": [1, 0, 0]},
                "slider": {"body": "hand", "point": [0, 0, 0], "axis": [1, 0, 0]},
            }
        },
        contacts={
            f"foot_{i}": {
                "a": {"body": "block", "point": [*corner, 0]},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": SLIDING,
                "static_friction": STATIC,
            }
            for i, corner in enumerate([(0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1)])
        },
        springs={
            "s": {
                "type": "linear",
                "a": {"body": "block", "point": [0, 0, 0]},
                "b": {"body": "hand", "point": [0, 0, 0]},
                "stiffness": PULL,
                "free_length": 1.0,
            }
        },
        motions={"hand": {"body": "hand", "along": {"direction": [1, 0, 0]}, "law": {"speed": DRAWN}}},
        responses=coordinates("block"),
    )
    data["responses"]["starts"] = {"type": "time", "at": {"response": "x", "above": 1e-7}}
    return data


def test_stick_and_slip_have_the_period_of_their_closed_form():
    """A block of m on a spring of k drawn at V, with F_s and F_k: it starts at F_s / k V, and slips by 2 A + V t.

    A = (F_s - F_k) / k and t = 2 (pi - atan(A w / V)) / w; then it sticks for 2 A / V.
    """
    weight, omega = 2.0 * GRAVITY, np.sqrt(PULL / 2.0)
    starts, amplitude = STATIC * weight / PULL / DRAWN, (STATIC - SLIDING) * weight / PULL
    slip = 2 * (np.pi - np.arctan(amplitude * omega / DRAWN)) / omega
    way, stick = 2 * amplitude + DRAWN * slip, 2 * amplitude / DRAWN
    first = simulate(made(drawn(starts + slip + 0.3 * stick)))
    assert first.status == "ok", first.message
    assert first.responses["starts"] == pytest.approx(starts, abs=3e-3)
    assert first.responses["x"] == pytest.approx(way, rel=2e-3)
    third = simulate(made(drawn(starts + 2 * (slip + stick) + slip + 0.1 * stick)))
    assert third.responses["x"] == pytest.approx(3 * way, rel=2e-3)
    early = simulate(made(drawn(starts + 2 * (slip + stick) - 0.02 * stick)))
    assert early.responses["x"] == pytest.approx(2 * way, rel=2e-3)


def test_nothing_depends_on_place_or_order():
    """The same elsewhere, and with bodies and contacts in another order."""
    data = slope(float(np.arctan(0.65)))
    data["phases"] = [{"name": "run", "duration": 0.1}]
    first = simulate(made(data)).responses["x"]
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))))
    assert there.responses["x"] == pytest.approx(first, rel=1e-6)
    other = data | {key: dict(reversed(data[key].items())) for key in ("bodies", "contacts")}
    assert simulate(made(other)).responses["x"] == pytest.approx(first, rel=1e-6)


def test_one_coefficient_leaves_all_as_it_was():
    """Equal coefficients have no array of their own, and the bits of a file without them."""
    data = slope(0.3, 0.5)
    data["phases"] = [{"name": "run", "duration": 0.1}]
    for contact in data["contacts"].values():
        contact["static_friction"] = SLIDING
    equal = made(data)
    assert not assemble(equal).model.laws.sticking.size
    for contact in data["contacts"].values():
        del contact["static_friction"]
    assert simulate(equal).responses == simulate(made(data)).responses


def test_materials_and_joints_with_play_have_it():
    """That of the material, unless the contact has a friction of its own; every number has a key."""
    data = slope(0.1)
    data["materials"] = {"dry": {"friction": 0.3, "static_friction": 0.5}}
    for i, contact in enumerate(data["contacts"].values()):
        contact["material"] = "dry"
        del contact["static_friction"]
        if i:
            del contact["friction"]
    mechanism = made(data)
    assert mechanism.static_friction(mechanism.contacts["corner_0"]) == SLIDING
    assert mechanism.static_friction(mechanism.contacts["corner_1"]) == 0.5
    assert "materials.dry.static_friction" in settable_keys(mechanism)
    assert set_values(mechanism, {"materials.dry.static_friction": 0.7}).materials["dry"].static_friction == 0.7
    assert "contacts.corner_0.static_friction" in settable_keys(made(slope(0.1)))


@each(
    ("tables", "named"),
    [
        ({"contacts": {"corner_0": {"static_friction": 0.3}}}, r"contacts\.corner_0\.static_friction"),
        ({"materials": {"dry": {"friction": 0.5, "static_friction": 0.4}}}, r"materials\.dry\.static_friction"),
        (
            {
                "materials": {"dry": {"friction": 0.7}},
                "contacts": {"corner_0": {"friction": None, "material": "dry"}},
            },
            r"contacts\.corner_0\.static_friction",
        ),
        ({"contacts": {"corner_0": {"static_friction": -0.1}}}, r"contacts\.corner_0\.static_friction"),
    ],
)
def test_a_contact_that_would_hold_less_at_rest_is_refused(tables, named):
    data = slope(0.1)
    data["materials"] = tables.get("materials", {})
    for name, change in tables.get("contacts", {}).items():
        contact = data["contacts"][name] | change
        data["contacts"][name] = {key: value for key, value in contact.items() if value is not None}
    with pytest.raises(MechanismError, match=named):
        made(data)
