"""Closed loops of ideal joints move as their one freedom lets them, and keep their energy; so does what spins fast."""

from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.preflight.cautions import cautions
from tests.each import each
from tests.engine.histories import history
from tests.engine.oracles.closed_loops import bennett, bennett_fastest, bricard, four_bars, four_bars_exact
from tests.engine.small import made, small

DEFAULT = 1e-8  # limits of penetration and joint violation


def drift(data: dict[str, Any]) -> float:
    """Return the largest deviation of the energy of a run from that at its start [J]."""
    energy = history(made(data)).energy
    return float(np.abs(energy - energy[0]).max())


@pytest.mark.slow
def test_bennett():
    """Four pins, three constraints too many: the speed that energy gives, of second order, and no energy lost."""
    exact, errors = bennett_fastest(), []
    for step, allowed in ((4e-3, 1.6e-4), (2e-3, 4e-5), (1e-3, 1.1e-5)):  # shares of the energy
        run = simulate(made(bennett(step)))
        assert run.status == "ok", run.message
        errors.append(abs(run.responses["fastest"] - exact))
        assert run.certificate.lost_energy < 3e-4 * run.certificate.max_kinetic_energy
        assert drift(bennett(step)) < allowed * 10.0
    assert errors[0] < 4e-4
    assert errors[-1] < 4e-5


@pytest.mark.slow
def test_bricard():
    """Six pins: 4.553 J of kinetic energy at most, and what is potential and kinetic together stays."""
    off = [drift(bricard(step)) for step in (5e-3, 2.5e-3)]
    assert off[1] < 0.3 * off[0] < 0.3 * 3.1e-5  # J
    assert simulate(made(bricard(2.5e-3))).certificate.max_kinetic_energy == pytest.approx(4.553, abs=5e-4)


@pytest.mark.slow
@each("count", [1, 2, 6])
def test_rows_of_four_bars_pass_through_their_singular_poses(count):
    """Where all bars lie on one line, rows that were needed become redundant for a step."""
    errors = []
    for step in (4e-3, 2e-3):
        run = simulate(made(four_bars(count, step, 5.0, 7.0, angle=np.pi / 2)))
        assert run.status == "ok", run.message
        errors.append(abs(run.responses["angle"] - four_bars_exact(count, 5.0, 7.0, np.pi / 2)))
    assert errors[1] < 1.2e-3
    assert errors[1] < 0.35 * errors[0]


@pytest.mark.slow
@each("off", [0.0, 1e-8, 1e-7, 3e-7, 1e-6, 1e-5])
def test_an_axis_that_is_off_by_the_last_digits_of_a_file(off):
    """A planar loop moves as with an exact axis, to within what the axis is off by, and says how far it is open."""
    data = four_bars(1, 1e-3, 2.0, 2.0, angle=-np.pi / 2, tilt=np.pi / 4, off=off)
    run = simulate(made(data))
    assert run.status == "ok", run.message
    exact = four_bars_exact(1, 2.0, 2.0, -np.pi / 2)
    assert run.responses["angle"] == pytest.approx(exact, abs=1e-6)
    assert run.certificate.max_violation <= max(DEFAULT, off)
    assert run.certificate.lost_energy < 1e-4
    assert run.certificate.repeated == 0


@pytest.mark.slow
@each("crank_mass", [1e-3, 1e-6, 1e-9])
def test_what_a_loop_holds_twice_does_not_depend_on_masses(crank_mass):
    """Cranks of a milligram that carry a bar of a tonne, in proportion, swing as a pendulum of 1 m."""
    motion = {"horizon": 2.0, "speed": 2.0, "angle": -np.pi / 2, "crank_mass": crank_mass}
    run = simulate(made(four_bars(1, 1e-3, off=1e-6, **motion)))
    assert run.status == "ok", run.message
    assert run.responses["angle"] == pytest.approx(four_bars_exact(1, **motion), abs=2e-6)
    assert run.certificate.lost_energy < 1e-4


def test_check_names_loops_and_what_they_could_be():
    """Three motions of a planar loop of four pins are held twice, and so are three of a Bennett linkage."""
    for data, loop in ((four_bars(1, 1e-3, 1.0, 0.0, 1.0), "foot_0-foot_1-left_0-right_0"), (bennett(1e-3), "A-B-C-D")):
        (found,) = [str(caution) for caution in cautions(made(data)) if "twice" in str(caution)]
        assert f"the loop {loop} holds 3 motions twice" in found
        assert "cylindrical" in found
        assert "spherical" in found
        for change in found.partition("to change that, make ")[2].split(" and "):
            joint, kind = change.split()
            was = data["joints"][joint]
            if kind == "spherical":
                points = [{key: was[side][key] for key in ("body", "point")} for side in ("bearing", "journal")]
                data["joints"][joint] = {"type": kind, "socket": points[0], "ball": points[1]}
            else:
                was["type"] = kind
        assert not [caution for caution in cautions(made(data)) if "twice" in str(caution)]


def spinning(adaptive: bool) -> dict[str, Any]:
    """Describe a free body that spins at 200 rad/s about its axis, slightly off it."""
    steps: dict[str, Any] = {"step": 1e-4, "adaptive": {"longest": 1e-2, "travel": 1.0}} if adaptive else {"step": 1e-2}
    return small(
        simulation={"horizon": 0.1, **steps},
        bodies={"top": {"mass": 1.0, "inertia": [1.0, 1.0, 1.8], "angular_velocity": [1.0, 0.0, 200.0]}},
        phases=[{"name": "spin", "duration": 0.1}],
    )


def test_a_body_that_spins_fast_gets_short_steps_or_is_doubted():
    """Its transverse spin circles at 0.8 of 200 rad/s in the body; a step of 2 rad would not show that."""
    found = history(made(spinning(True)))
    turned = np.unwrap(np.arctan2(found.v[:, 0, 4], found.v[:, 0, 3]))[-1]
    assert turned == pytest.approx(160.0 * 0.1, rel=0.02)
    np.testing.assert_allclose(np.hypot(found.v[:, 0, 3], found.v[:, 0, 4]), 1.0, rtol=1e-3)
    run = simulate(made(spinning(True)))
    assert run.certificate.max_turn <= 0.5
    assert run.certificate.doubts() == []
    coarse = simulate(made(spinning(False)))
    assert coarse.certificate.max_turn == pytest.approx(2.0, rel=1e-3)
    assert len(coarse.certificate.doubts()) == 1
    assert [caution.key for caution in cautions(made(spinning(False)))] == ["simulation.step"]
