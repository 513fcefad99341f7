"""The runs of the study: the shipped set is the shipped bench, and each assumption does what it says."""

from dataclasses import replace

import pytest

from engine import load_mechanism, simulate
from studies.trip_force import FRICTION, SHIPPED, bench, run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", ["trip_pin", "trip_lamage"])
def test_the_shipped_set_is_the_shipped_bench(name):
    """Groups of contacts with the shipped friction, and a spring of 1e-9 N mm, change nothing that can be seen."""
    c60 = load_mechanism("c60")
    shipped = simulate(c60.on_bench(name), c60.preset("prototype")).responses
    ours = run(replace(SHIPPED, bench=name))
    assert ours.status == "ok"
    assert ours.force == pytest.approx(shipped["peak_force"], rel=0.1)
    assert ours.at_peak[0.1] == pytest.approx(shipped["displacement_at_peak"], abs=0.06)
    assert ours.release[0.1] == pytest.approx(shipped["release_distance"], abs=0.01)


def test_every_group_has_its_contacts():
    """Each friction of the study belongs to some contact or joint of the bench."""
    mechanism = bench("trip_pin", False)
    used = [
        table.material
        for table in (*mechanism.contacts.values(), *mechanism.joints.values())
        if hasattr(table, "material")
    ]
    assert set(used) >= FRICTION
    assert used.count("latch") == 6
    assert used.count("bump") == 2
    assert mechanism.joints["J4"].material == "bar"


def test_less_friction_at_the_latch_is_less_force():
    """The force falls with the friction of the latch, and so does the way to release."""
    rough, smooth = run(SHIPPED), run(replace(SHIPPED, latch=0.06))
    assert smooth.force < 0.5 * rough.force
    assert smooth.release[0.1] < rough.release[0.1]


def test_a_spring_on_the_bar_is_felt_at_the_pin():
    """A torque of 3 N mm at the pin's arm of 3.6 mm is 0.8 N; friction of the other contacts changes with it."""
    without, spring = run(replace(SHIPPED, latch=0.03)), run(replace(SHIPPED, latch=0.03, torque=3.0))
    assert 0.5 < spring.force - without.force < 1.6


def test_a_later_touch_is_a_shorter_way():
    """Distances from a larger force that counts as touching are not longer."""
    push = run(replace(SHIPPED, latch=0.1))
    limits = sorted(push.release)
    assert [push.release[limit] for limit in limits] == sorted(push.release.values(), reverse=True)


def test_a_held_pin_wedges():
    """Led along Y alone, the pin cannot follow its hole across: the force is several times that of the free one."""
    assert run(replace(SHIPPED, held=True)).force > 2 * run(SHIPPED).force
