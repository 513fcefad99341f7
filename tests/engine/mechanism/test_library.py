"""The small shipped mechanisms are built for answers that are known."""

import math

import pytest

from engine.mechanism import get_value, load_mechanism


def test_the_block_on_the_slope_is_held_by_its_friction():
    mechanism = load_mechanism("incline")
    slope = mechanism.bodies["slope"].angle
    assert slope == pytest.approx(math.radians(30))
    assert get_value(mechanism, "materials.block_slope.friction") > math.tan(slope)
    assert mechanism.bodies["block"].angle == slope
    assert {c.kind for c in mechanism.contacts.values()} == {"point-plane"}


def test_the_pendulum_hangs_free_of_friction():
    mechanism = load_mechanism("clearance_pendulum")
    joint = mechanism.joints["J1"]
    assert mechanism.contact_law(joint) == (0.0, 0.0)
    link = mechanism.bodies["link"]
    weight = -mechanism.gravity[1] * link.mass
    assert mechanism.springs["damper"].stiffness < 0.2 * weight * 0.1, "gravity rules"
