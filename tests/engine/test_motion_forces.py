"""Force, torque, work and travel of prescribed motions, against closed forms and the energy of the bodies."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.loop import control_of, drive
from tests.engine.small import GRAVITY, block_on_floor, coordinates, energy, made, shipped, small, turned

MASS, WAY, TIME = 2.0, 0.3, 0.5
UP = {"body": "load", "along": {"direction": [0, 0, 1]}}
SMOOTH = {"table": [[0, 0], [TIME, WAY]], "interpolation": "smooth"}
RAMP = {"table": [[0, 0], [TIME, WAY]]}


def read(motion: str, force: str = "force", **more: Any) -> dict[str, Any]:
    """Read everything of a motion."""
    of = {"motion": motion, **more}
    return {
        "end": {"type": f"motion_{force}", **of},
        "peak": {"type": f"motion_{force}", **of, "at": "maximum"},
        "low": {"type": f"motion_{force}", **of, "at": "minimum"},
        "work": {"type": "motion_work", **of},
        "travel": {"type": "motion_travel", **of},
    }


def lifted(law: dict[str, Any], step: float = 1e-3, **tables: Any) -> dict[str, Any]:
    """Describe a load that is lifted against gravity by a motion, until it rests."""
    return small(
        gravity=[0, 0, -GRAVITY],
        simulation={"step": step},
        bodies={"load": {"mass": MASS, "inertia": [1, 1, 1]}},
        motions={"lift": {**UP, "law": law}},
        responses=read("lift"),
        **tables,
    )


@pytest.mark.parametrize("law", [SMOOTH, RAMP], ids=["smooth", "ramp"])
def test_a_load_is_lifted(law):
    """F = m (g + s''), where s'' of the smooth law falls from 6 WAY/TIME^2 to its opposite; the work is m g WAY.

    A ramp starts and ends with an impact, which is no force: in the first step it is still 0.
    """
    h = 1e-3
    run = simulate(made(lifted(law, h)))
    assert run.status == "ok", run.message
    assert run.units == {"end": "N", "peak": "N", "low": "N", "work": "J", "travel": "m"}
    weight = MASS * GRAVITY
    swing = MASS * 6 * WAY / TIME**2 * (1 - h / TIME) if law is SMOOTH else 0.0  # at the middle of the first step
    found = run.responses
    assert found["end"] == pytest.approx(weight, rel=1e-9)
    assert found["peak"] == pytest.approx(weight + swing, rel=1e-5 if law is SMOOTH else 1e-9)
    assert found["low"] == (pytest.approx(weight - swing, rel=1e-5) if law is SMOOTH else 0.0)
    assert found["work"] == pytest.approx(weight * WAY, rel=1e-9)
    assert found["travel"] == pytest.approx(WAY, abs=1e-15)
    assert run.at_impact == ()


def test_a_run_whose_force_is_read_does_not_end_before_its_motion():
    """A slow smooth start, and a pause in the table, are no rest, although nothing else is measured that moves.

    The first step after the pause is implicit, and takes m (s'' h)^2 / 2 more, 2e-4 of the work.
    """
    law = {"table": [[0, 0], [0.2, 0], [0.4, WAY], [0.6, WAY], [0.8, 2 * WAY]], "interpolation": "smooth"}
    data = lifted(law)
    data["responses"] = {"work": {"type": "motion_work", "motion": "lift"}, "end": {"type": "time"}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["work"] == pytest.approx(2 * MASS * GRAVITY * WAY, rel=3e-4)
    assert run.responses["end"] == pytest.approx(0.85, abs=0.011)


def test_the_work_of_a_jump_is_the_kinetic_energy_that_it_gives():
    """A speed from the start: m v^2 / 2 at once, then m g v t."""
    data = lifted({"speed": 2.0}, phases=[{"name": "up", "duration": 0.25}])
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["work"] == pytest.approx(MASS * 2.0**2 / 2 + MASS * GRAVITY * 0.5, rel=1e-9)
    assert run.responses["peak"] == pytest.approx(MASS * GRAVITY, rel=1e-9)


def test_a_motion_that_begins_later_takes_over_the_speed_and_counts_from_there():
    """The load falls for 0.1 s, and is then led with -1 m/s: an impact, then its weight; afterwards it is free."""
    phases = [{"name": "fall", "duration": 0.1}, {"name": "led", "duration": 0.2}, {"name": "free", "duration": 0.1}]
    data = lifted({"speed": -1.0}, phases=phases)
    data["motions"]["lift"]["phases"] = ["led"]
    data["bodies"]["ground"] = {"fixed": True}
    data["responses"] = read("lift", from_phase="led", to_phase="led") | {
        "after": {"type": "motion_force", "motion": "lift"},
        "kept": {"type": "motion_travel", "motion": "lift"},
        "z": coordinates("load")["z"],
    }
    for r in data["responses"].values():
        if r.get("at", "end") == "end" and r["type"] != "motion_work":
            r.pop("from_phase", None)
    run = simulate(made(data))
    assert run.status == "ok", run.message
    found, weight, speed = run.responses, MASS * GRAVITY, GRAVITY * 0.1
    assert found["end"] == pytest.approx(weight, rel=1e-9)
    assert found["peak"] == pytest.approx(weight, rel=1e-9)
    assert found["work"] == pytest.approx(MASS * (1.0 - speed**2) / 2 - weight * 0.2, rel=1e-9)
    assert found["travel"] == found["kept"] == pytest.approx(-0.2, abs=1e-14)
    assert found["after"] == 0.0


def test_a_rotation_winds_a_spring():
    """T = k phi at the end, and the work is k phi^2 / 2; the mean over TIME of the torque is behind it."""
    k, phi = 3.0, 2.5
    data = small(
        bodies={"ground": {"fixed": True}, "drum": {"mass": 1.0, "inertia": [0.1, 0.2, 0.3]}},
        springs={
            "s": {"type": "torsion", "a": "ground", "b": "drum", "axis": [0, 0, 1], "stiffness": k, "free_angle": 0}
        },
        motions={
            "wind": {
                "body": "drum",
                "about": {"axis": [0, 0, 1]},
                "law": {"table": [[0, 0], [TIME, phi]], "interpolation": "smooth"},
            }
        },
        responses={
            **read("wind", "torque"),
            "shown": {"type": "motion_torque", "motion": "wind", "averaged_over": 0.05, "at": "maximum"},
        },
    )
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.units["end"] == "N m"
    assert run.units["travel"] == "rad"
    assert run.responses["end"] == pytest.approx(k * phi, rel=1e-9)
    assert run.responses["work"] == pytest.approx(k * phi**2 / 2, rel=1e-5)
    assert run.responses["travel"] == pytest.approx(phi, abs=1e-14)
    assert k * phi * 0.5 < run.responses["shown"] < run.responses["peak"]


@pytest.mark.parametrize("drag", [0.0, 5.0])
def test_a_block_is_pushed_over_a_rough_floor(drag):
    """F = mu m g, with drag m (mu g + rate v) at a constant speed; the work is that force times the way."""
    v, mu, mass = 0.1, 0.4, 2.0
    data = block_on_floor(friction=mu, mass=mass, origin=[0, 0, 0.1], velocity=[v, 0, 0])
    data["phases"] = [{"name": "push", "duration": 0.5, "damping": drag}]
    data["motions"] = {"push": {"body": "block", "along": {"direction": [1, 0, 0]}, "law": {"speed": v}}}
    data["responses"] = read("push")
    run = simulate(made(data))
    assert run.status == "ok", run.message
    force = mass * (mu * GRAVITY + drag * v)
    assert run.responses["peak"] == pytest.approx(force, rel=1e-6)
    assert run.responses["end"] == pytest.approx(force, rel=1e-6)
    assert run.responses["work"] == pytest.approx(force * v * 0.5, rel=1e-6)


def test_at_rest_the_force_balances_loads_and_contacts():
    """A block is held on its floor by a motion, against a force: as the contacts carry what they must, so does it."""
    data = block_on_floor(friction=0.0, origin=[0, 0, 0.1])
    data["forces"] = {"side": {"body": "block", "point": [0.3, 0, 0], "force": [-7.0, 0, 0]}}
    data["motions"] = {"hold": {"body": "block", "along": {"direction": [1, 0, 0]}, "law": {"speed": 0.0}}}
    data["responses"] = read("hold") | {"n": {"type": "contact_force", "contact": "corner_0"}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["end"] == pytest.approx(7.0, rel=1e-9)
    assert run.responses["n"] == pytest.approx(2.0 * GRAVITY / 4, rel=1e-6)
    assert run.responses["work"] == pytest.approx(0.0, abs=1e-12)


def driven(step: float) -> dict[str, Any]:
    """Describe the shipped double pendulum with its first link driven."""
    data = shipped("double_pendulum")
    data["motions"] = {
        "crank": {
            "body": "upper",
            "about": {"axis": [0, 1, 0]},
            "law": {"table": [[0, 0], [0.6, 1.5]], "interpolation": "smooth"},
        }
    }
    data["phases"] = [{"name": "run", "duration": 0.6}]
    data["responses"] = {"work": {"type": "motion_work", "motion": "crank"}}
    data["simulation"] |= {"step": step, "horizon": 1.0}
    return data


def work_less_energy(data: dict[str, Any]) -> float:
    """Return the work of the motion less the energy that the bodies gained, as a share of the work."""
    mechanism = made(data)
    assembly = assemble(mechanism)
    before = energy(assembly)
    drive(assembly, control_of(mechanism, False), 60.0)
    work = float(assembly.work.values[0])
    return (work - (energy(assembly) - before)) / work


def test_work_is_energy_of_second_order():
    """Ideal joints do no work: what the motion puts in, the links have; halved steps leave a quarter."""
    coarse, fine = (abs(work_less_energy(driven(h))) for h in (4e-3, 2e-3))
    assert fine < 1e-3
    assert 3.0 < coarse / fine < 5.0


def test_it_does_not_matter_where_the_mechanism_stands():
    """Turned and moved, the load takes the same force and work."""
    data = lifted(SMOOTH)
    moved = turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.array([3.0, -2.0, 1.0]))
    here, there = simulate(made(data)), simulate(made(moved))
    assert {
        name: pytest.approx(value, rel=1e-9, abs=1e-12) for name, value in here.responses.items()
    } == there.responses


def test_what_is_read_changes_no_bit_of_the_motion():
    """The same steps, with and without a look at the force."""
    data = block_on_floor(friction=0.3, origin=[0, 0, 0.3], angular_velocity=[1, 2, 3])
    data["phases"] = [{"name": "run", "duration": 0.3}]
    data["motions"] = {"push": {"body": "block", "along": {"direction": [1, 0, 0]}, "law": {"speed": 0.5}}}
    plain = simulate(made(data)).responses
    data["responses"] |= read("push")
    assert {name: simulate(made(data)).responses[name] for name in plain} == plain
