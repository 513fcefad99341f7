"""The shipped door latch: it shuts and opens, and holds what the seal, the claw's spring and its arms say."""

import math

import pytest

from engine import load_mechanism, simulate
from engine.mechanism import set_values

SEAL, PLAY = 30.0, 0.5  # N/mm; mm between striker and fork on either side
STRIKER, RIM = 18.0, 22.97063  # mm from the pin of the claw: the striker, the corner of its tooth


def run(**values):
    """Run it with other values of its parameters."""
    return simulate(set_values(load_mechanism("door_latch"), {f"parameters.{n}": v for n, v in values.items()}))


def test_it_shuts_holds_and_opens():
    """Tooth on pawl, striker on the fork's outer wall; then the door is as far out as it goes."""
    found = run()
    assert found.status == "ok", found.message
    assert found.responses["shut"] == pytest.approx(-PLAY, abs=1e-6)
    assert found.responses["rebound"] == pytest.approx(1.5 + PLAY, abs=1e-6)
    assert found.responses["engagement"] == pytest.approx(RIM - 18.5, abs=1e-6)
    assert found.responses["door"] == pytest.approx(-30.0, abs=1e-6)
    assert found.certificate.max_penetration <= 1e-8
    assert found.certificate.created_energy < 1e-6 * found.certificate.max_kinetic_energy


def test_the_tooth_carries_what_the_seal_and_the_spring_turn():
    """Without friction, at the corner of the tooth: seal x 18 mm + 150 N mm/rad x 3 rad, over 22.97 mm."""
    found = run(friction=0.0)
    assert found.responses["held"] == pytest.approx((SEAL * (8 - PLAY) * STRIKER + 450.0) / RIM, rel=1e-5)


def test_a_tooth_that_stands_out_shuts_the_door_further():
    """By 0.2 mm: the tip of the pawl, at (2, 18.5), meets the face of the tooth, and the fork's wall the striker."""
    found = run(tooth=0.2, friction=0.0)
    assert found.status == "ok", found.message
    turn = math.asin(2.2 / math.hypot(2.0, 18.5)) - math.atan2(2.0, 18.5)
    assert found.responses["shut"] == pytest.approx((STRIKER * math.sin(turn) - PLAY) / math.cos(turn), abs=1e-5)


def test_friction_makes_it_harder_to_open():
    efforts = [run(friction=friction).responses["effort"] for friction in (0.0, 0.1, 0.2)]
    assert efforts == sorted(efforts)
    assert efforts[2] > 1.5 * efforts[0]


def test_a_door_that_is_not_pushed_far_enough_is_not_shut():
    """The tooth has not passed the pawl: the run says so."""
    found = run(overtravel=-3.0)
    assert found.status == "invalid"
