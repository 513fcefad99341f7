"""Machines that stick, slide, strike, tip and lock, against closed forms and integrations with located events."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine import simulate
from engine.run import Run
from tests.engine.oracles.machines import brake, detent, oscillator, plates, seesaw, tether, toggle, wedge
from tests.engine.small import GRAVITY, made


def ran(data: dict) -> Run:
    """Run a machine to its end, which has to be ok."""
    run = simulate(made(data))
    assert run.status == "ok", run.message
    return run


def accelerations(pull: float, friction: tuple[float, ...]) -> np.ndarray:
    """Return those of three plates: of all ways in which pairs of faces stick or slide, the one that Coulomb allows."""
    mass = np.array([1.0, 2.0, 3.0])
    limit = np.array(friction) * GRAVITY * mass[::-1].cumsum()[::-1]
    for slides in itertools.product((False, True), repeat=3):
        system, right = np.zeros((6, 6)), np.array([0, 0, pull, 0, 0, 0])  # accelerations, forces from below
        for i in range(3):
            system[i, i], system[i, 3 + i] = mass[i], -1
            if i < 2:
                system[i, 4 + i] = 1
            if slides[i]:
                system[3 + i, 3 + i], right[3 + i] = 1, -limit[i]
            else:
                system[3 + i, i] = 1
                if i:
                    system[3 + i, i - 1] = -1
        found = np.linalg.solve(system, right)
        slip = np.diff(found[:3], prepend=0.0)
        if all(slip[i] > 0 if slides[i] else abs(found[3 + i]) <= limit[i] + 1e-9 for i in range(3)):
            return found[:3]
    raise AssertionError("no such way")


@pytest.mark.parametrize("pull", [5.0, 11.0, 12.5, 15.0, 25.0])
def test_plates_slide_where_friction_is_least(pull):
    """Nothing slides, the lowest plate does, or the uppermost too: half the acceleration times the time squared."""
    run = ran(plates(pull))
    expected = accelerations(pull, (0.2, 0.4, 0.6)) * 0.2**2 / 2
    np.testing.assert_allclose(list(run.responses.values()), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("friction", "start"), [(0.1, 0.3), (0.15, 0.1), (0.3, 0.21)])
def test_an_oscillator_with_dry_friction_stops_where_it_must(friction, start):
    """Each half swing loses 2 mu m g / k, until the spring no longer overcomes friction."""
    lost, x = friction * GRAVITY / 100.0, start
    while abs(x) > lost:
        x = -np.sign(x) * (abs(x) - 2 * lost)
    assert ran(oscillator(friction, start)).responses["x"] == pytest.approx(x, abs=1e-4)


@pytest.mark.parametrize("mass", [1.0, 1e-3, 1e-5])
@pytest.mark.parametrize("share", [0.9, 0.999])
def test_a_wedge_below_twice_the_angle_of_friction_holds(mass, share):
    """Also one of 10 mg under 50 kg, for which the mean contact is as compliant as suits the wedge.

    The load is held along its guide by the normal force and by friction, within the cone.
    """
    angle = 2 * share * np.arctan(0.2)
    found = ran(wedge(angle, 0.2, mass)).responses
    normal, friction = found["force"], found["friction"]
    assert found["x"] == pytest.approx(0.0, abs=1e-6)
    assert normal * np.cos(angle) + friction * np.sin(angle) == pytest.approx(50 * GRAVITY, rel=1e-6)
    assert friction <= 0.2 * normal * (1 + 1e-6)


@pytest.mark.parametrize("share", [1.001, 1.1])
def test_a_wedge_above_twice_the_angle_of_friction_slips_out(share):
    """However little too steep it is."""
    run = simulate(made(wedge(2 * share * np.arctan(0.2), 0.2, 1e-3)))
    assert run.status == "not_at_rest"
    assert run.measured["x"] > 1e-3


@pytest.mark.parametrize("duration", [0.25, 0.4, 1.0])
def test_a_tether_goes_taut_and_swings(duration):
    """A fall, an impact that takes the speed along the thread, and a pendulum (DOP853)."""
    length, start = 0.5, 0.3
    fall = np.sqrt(2 * np.sqrt(length**2 - start**2) / GRAVITY)
    if duration < fall:
        x, z = start, -GRAVITY * duration**2 / 2
    else:
        angle = np.arcsin(start / length)
        first = [angle, -GRAVITY * fall * np.sin(angle) / length]

        def rates(_, y):
            return [y[1], -GRAVITY / length * np.sin(y[0])]

        swing = solve_ivp(rates, (0, duration - fall), first, "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
        x, z = length * np.sin(swing), -length * np.cos(swing)
    run = ran(tether(length, start, duration))
    tolerance = 1e-9 if duration < fall else 3e-4
    assert [run.responses["x"], run.responses["z"]] == pytest.approx([x, z], abs=tolerance)


def test_a_seesaw_takes_the_first_ball_with_it():
    """Angular momentum at the impact, then one degree of freedom (DOP853)."""
    inertia, fall, duration = 1 / 6, np.sqrt(2 * 0.28 / GRAVITY), 0.28
    speed = GRAVITY * fall * 0.4 / (inertia + 0.16)

    def height(a):
        return -0.4 * np.tan(a) + 0.02 / np.cos(a)

    def slope(a):
        return (-0.4 + 0.02 * np.sin(a)) / np.cos(a) ** 2

    def rates(_, y):
        a, w = y
        bend = (slope(a + 1e-6) - slope(a - 1e-6)) / 2e-6
        return [w, -slope(a) * (GRAVITY + bend * w * w) / (inertia + slope(a) ** 2)]

    angle = solve_ivp(rates, (0, duration - fall), [0, speed], "DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
    run = ran(seesaw(duration))
    assert run.responses["angle"] == pytest.approx(-angle, abs=3e-4)
    assert run.responses["z1"] == pytest.approx(0.2 + height(angle), abs=3e-4)


def test_a_seesaw_rests_on_the_stop_of_the_heavier_ball():
    """Balls push along the beam's normal, the stop at the limit of friction: moments about the pivot."""
    angle = np.arcsin(0.1 / 0.5)
    c, s = np.cos(angle), np.sin(angle)
    hits = np.array([1.0, 3.0]) * GRAVITY / c
    arms = (np.array([-0.4, 0.4]) - 0.02 * s) / c
    stop = hits @ arms / (0.5 * (c + 0.2 * s))
    found = ran(seesaw()).responses
    assert found["angle"] == pytest.approx(angle, abs=1e-6)
    assert [found["hit_1"], found["hit_2"]] == pytest.approx(hits, abs=1e-5)
    assert [found["stop_1"], found["stop_2"]] == pytest.approx([0.0, stop], abs=1e-3)


SLOPE, FRICTION, SPRING = np.radians(35), 0.15, 20.0
BREAKAWAY = SPRING * np.tan(SLOPE + np.arctan(FRICTION))


@pytest.mark.parametrize("share", [0.5, 0.95, 0.999])
def test_a_detent_holds_below_its_breakaway_force(share):
    """tan(slope + angle of friction) times the spring's force."""
    assert abs(ran(detent(BREAKAWAY * share, SLOPE, FRICTION, SPRING)).responses["x"]) < 1e-7


@pytest.mark.parametrize("share", [1.001, 1.01])
def test_a_detent_gives_way_above_it(share):
    """The slider moves until the spring balances the push again: by its stiffness and the slope."""
    run = simulate(made(detent(BREAKAWAY * share, SLOPE, FRICTION, SPRING)))
    assert run.measured["x"] > 0.5 * SPRING * (share - 1) / (500.0 * np.tan(SLOPE))


@pytest.mark.parametrize("friction", [0.3, 2.0, 3.9])
@pytest.mark.parametrize("turn", [1, -1])
def test_a_brake_lever_is_pulled_in_or_pushed_off(friction, turn):
    """Moments about its pivot: 0.2 N + 0.05 mu N (with the turn) = 0.4 times the hand's 10 N."""
    expected = 4.0 / (0.2 + turn * 0.05 * friction)
    assert ran(brake(friction, turn)).responses["force"] == pytest.approx(expected, rel=3e-5)


def test_a_brake_that_locks_is_jammed_and_says_what():
    """From a coefficient of friction of 4 on nothing the hand does matters."""
    run = simulate(made(brake(4.1, -1)))
    assert run.status == "jammed"
    assert "friction locks contact pad (lever and drum)" in run.message
    assert "motor" in run.message


@pytest.mark.parametrize(("angle", "play"), [(0.15, 1e-4), (0.1, 2e-5)])
def test_a_toggle_without_friction_comes_to_rest(angle, play):
    """Its links end one and two plays shorter, and their forces balance the hand's 10 N at the knee.

    A pin that rolls in its bore is far quicker than the steps that the travel allows: each of them creates up to a
    thousandth of the largest kinetic energy, which kept earlier builds trembling to the horizon.
    """
    first, second, span = 0.1 - play, 0.1 - 2 * play, 0.2 * np.cos(angle)
    x = (span**2 + first**2 - second**2) / (2 * span)
    z = np.sqrt(first**2 - x**2)
    system = [[x / first, -(span - x) / second], [z / first, z / second]]
    root, end = np.linalg.solve(system, [0.0, 10.0])
    run = ran(toggle(angle, play))
    assert run.responses["root"] == pytest.approx(root, rel=2e-4)
    assert run.responses["force"] == pytest.approx(end * (span - x) / second, rel=2e-4)
