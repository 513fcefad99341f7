"""Forces, torques, springs and dampers whose size is a table over a place, an angle or a speed: closed forms, scipy."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.kernels.loads import apply_loads, potential_energy
from engine.mechanism import set_values
from engine.preflight.plausibility import stiff_springs
from tests.engine.small import coordinates, made, small

MASS, INERTIA = 2.0, 0.3
ENDS = {"a": {"body": "ground", "point": [0, 0, 0]}, "b": {"body": "load", "point": [0, 0, 0]}}


def straight(duration: float, start: float = 1.0, speed: float = 0.0, **tables: Any) -> dict[str, Any]:
    """Describe a load that moves along x, without gravity."""
    return small(
        phases=[{"name": "run", "duration": duration}],
        bodies={
            "ground": {"fixed": True},
            "load": {"mass": MASS, "inertia": [1, 1, 1], "origin": [start, 0, 0], "velocity": [speed, 0, 0]},
        },
        responses=coordinates("load")
        | {
            "speed": {
                "type": "velocity",
                "to": {"body": "load", "point": [0, 0, 0]},
                "direction": {"vector": [1, 0, 0]},
            }
        },
        **tables,
    )


def turning(duration: float, **tables: Any) -> dict[str, Any]:
    """Describe a rotor about z."""
    return small(
        phases=[{"name": "run", "duration": duration}],
        bodies={"ground": {"fixed": True}, "rotor": {"mass": MASS, "inertia": [1, 1, INERTIA]}},
        responses={
            "angle": {"type": "angle", "body": "rotor", "axis": [0, 0, 1]},
            "speed": {"type": "angular_velocity", "body": "rotor", "axis": [0, 0, 1]},
        },
        **tables,
    )


def spring(**law: Any) -> dict[str, Any]:
    """Describe a spring with a law."""
    return {"springs": {"s": {"type": "linear", **ENDS, "law": law}}}


def test_a_progressive_spring_swings_as_scipy_says():
    """Of second order in the step; a fourth of it is left with half the step."""
    points = [[0.2, 30.0], [0.6, 10.0], [1.0, 0.0], [1.4, -5.0], [2.0, -40.0]]
    length, force = np.array(points).T

    def motion(_t: float, y: np.ndarray) -> list[float]:
        return [y[1], float(np.interp(y[0], length, force)) / MASS]

    exact = solve_ivp(motion, (0, 1.0), [1.8, 0.0], rtol=1e-11, atol=1e-11, max_step=1e-3).y[:, -1]
    data = straight(1.0, 1.8, **spring(table=points))
    errors = []
    for step in (2e-3, 1e-3):
        data["simulation"]["step"] = step
        run = simulate(made(data))
        errors.append(np.hypot(run.responses["x"] - exact[0], run.responses["speed"] - exact[1]))
    assert errors[1] < 4e-5
    assert errors[1] < 0.4 * errors[0]


def test_a_bistable_spring_snaps_through():
    """Pushed past its unstable place it goes on to the other one, where friction of the drag leaves it."""
    points = [[0.5, 10.0], [0.8, 0.0], [0.9, -3.0], [1.0, 0.0], [1.1, 3.0], [1.2, 0.0], [1.5, -10.0]]
    for start, end in ((0.99, 0.8), (1.01, 1.2)):
        data = straight(1.0, start, **spring(table=points))
        data["phases"] = [{"name": "settle", "damping": 20.0}]
        data["simulation"]["horizon"] = 20.0
        run = simulate(made(data))
        assert run.status == "ok", run.message
        assert run.responses["x"] == pytest.approx(end, abs=1e-5)


def test_a_magnet_pulls_with_what_its_gap_says():
    """From rest at 1 m to 0.5 m under 8 N falling to 4 N: v^2 = 2 W / m, W = 3 J; its reaction moves the other body."""
    data = straight(1.0)
    data["responses"]["at_half"] = {**data["responses"]["speed"], "at": {"response": "x", "below": 0.5}}
    data["forces"] = {
        "magnet": {"body": "load", "force": [-1, 0, 0], "law": {"over": "x", "table": [[0.5, 8.0], [1.0, 4.0]]}}
    }
    assert simulate(made(data)).responses["at_half"] == pytest.approx(-np.sqrt(3.0), rel=1e-5)
    data["bodies"]["yoke"] = {"mass": 6.0, "inertia": [1, 1, 1]}
    data["responses"]["x"] = {
        "type": "position",
        "from": {"body": "yoke", "point": [0, 0, 0]},
        "to": {"body": "load", "point": [0, 0, 0]},
        "direction": {"vector": [1, 0, 0]},
    }
    data["responses"]["yoke"] = {
        "type": "velocity",
        "to": {"body": "yoke", "point": [0, 0, 0]},
        "direction": {"vector": [1, 0, 0]},
        "at": {"response": "x", "below": 0.5},
    }
    data["forces"]["magnet"]["against"] = "yoke"
    found = simulate(made(data)).responses
    reduced = MASS * 6.0 / (MASS + 6.0)
    assert found["yoke"] - found["at_half"] == pytest.approx(np.sqrt(2 * 3.0 / reduced), rel=1e-5)
    assert 6.0 * found["yoke"] + MASS * found["at_half"] == pytest.approx(0.0, abs=1e-9)


def test_a_motor_comes_to_its_speed():
    """From a stall torque of 1.2 N m to 4 rad/s: w = 4 (1 - exp(-t / T)), T = 4 I / 1.2; against its stator too."""
    data = turning(1.0)
    data["torques"] = {
        "motor": {"body": "rotor", "torque": [0, 0, 1], "law": {"over": "speed", "table": [[0, 1.2], [4.0, 0.0]]}}
    }
    run = simulate(made(data))
    assert run.responses["speed"] == pytest.approx(4 * (1 - np.exp(-1.2 / (4 * INERTIA))), rel=1e-3)
    data["bodies"]["stator"] = {"mass": 1.0, "inertia": [1, 1, 0.6], "origin": [0.5, 0.2, 0.1]}
    data["responses"]["speed"]["relative_to"] = "stator"
    data["torques"]["motor"]["against"] = "stator"
    both = INERTIA * 0.6 / (INERTIA + 0.6)
    run = simulate(made(data))
    assert run.responses["speed"] == pytest.approx(4 * (1 - np.exp(-1.2 / (4 * both))), rel=1e-3)


def test_an_angle_counts_its_full_turns():
    """A torque that ends after two turns: the energy is the area of its table."""
    data = turning(6.0)
    data["simulation"]["horizon"] = 6.0
    data["torques"] = {
        "wound": {"body": "rotor", "torque": [0, 0, 1], "law": {"over": "angle", "table": [[0, 2.0], [4 * np.pi, 0.0]]}}
    }
    assert simulate(made(data)).responses["speed"] == pytest.approx(np.sqrt(2 * 4 * np.pi / INERTIA), rel=1e-4)
    data = turning(1.0)  # a torsion spring does not count them
    data["springs"] = {
        "wound": {
            "type": "torsion",
            "a": "ground",
            "b": "rotor",
            "axis": [0, 0, 1],
            "law": {"table": [[0, 2.0], [2, 0]]},
        }
    }
    assert simulate(made(data)).responses["speed"] == pytest.approx(np.sqrt(2 * 2 / INERTIA), rel=1e-4)


def test_a_damper_resists_as_its_table_says():
    """Ten times stiffer against compression: v falls as exp(-c t / m) with the c of its side; a torsion one too."""
    law = {"table": [[-5.0, -50.0], [0.0, 0.0], [5.0, 5.0]]}
    for speed, c in ((-0.4, 10.0), (0.4, 1.0)):
        data = straight(0.5, speed=speed, dampers={"d": {"type": "linear", **ENDS, "law": law}})
        assert simulate(made(data)).responses["speed"] == pytest.approx(speed * np.exp(-c * 0.5 / MASS), rel=1e-2)
    data = turning(0.5, dampers={"d": {"type": "torsion", "a": "ground", "b": "rotor", "axis": [0, 0, 1], "law": law}})
    data["bodies"]["rotor"]["angular_velocity"] = [0, 0, 0.4]
    assert simulate(made(data)).responses["speed"] == pytest.approx(0.4 * np.exp(-0.5 / INERTIA), rel=1e-2)


@given(
    st.lists(st.tuples(st.floats(0.1, 0.5), st.floats(-20, 20)), min_size=2, max_size=6),
    st.floats(0.05, 3.5),
    st.sampled_from(["linear", "smooth"]),
)
def test_the_force_is_the_slope_of_the_energy(steps, length, interpolation):
    """By central differences, at any length; beside a point of the table the slope may jump."""
    lengths = np.cumsum([step for step, _ in steps])
    points = [[float(x), y] for x, (_, y) in zip(lengths, steps, strict=True)]
    if np.abs(lengths - length).min() < 1e-3:
        return
    data = straight(1.0, length, **spring(table=points, interpolation=interpolation))
    assembly = assemble(made(data))
    model, state, work = assembly.arrays.model, assembly.state, assembly.work
    apply_loads(model.bodies, model.loads, model.time_laws, state, 0, 0.0, work.wrench, work.vectors)
    force, energies, d = work.wrench[0, 0], [], 1e-5
    for x in (length + d, length - d):
        state.x[0, 0] = x
        energies.append(potential_energy(model.bodies, model.loads, model.time_laws, state))
    assert force == pytest.approx((energies[1] - energies[0]) / (2 * d), rel=1e-5, abs=1e-5)


def test_a_campaign_varies_the_points():
    """A number of a table is a key like any other."""
    data = straight(0.1, **spring(table=[[0.5, 4.0], [1.5, 4.0]]))
    stronger = set_values(made(data), {"springs.s.law.table.0.1": 8.0, "springs.s.law.table.1.1": 8.0})
    assert simulate(stronger).responses["speed"] == pytest.approx(8.0 / MASS * 0.1, rel=1e-9)


def test_a_steep_table_is_warned_of():
    """As a stiff spring is; 1e9 N/m on 2 kg with a step of 1 ms."""
    (warning,) = stiff_springs(made(straight(1.0, **spring(table=[[0.9, 1e8], [1.0, 0.0]]))))
    assert warning.key == "springs.s.law"


def fault(data: dict[str, Any]) -> str:
    """Return the message of the one fault of a mechanism."""
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    return str(caught.value).split("\n")[1].strip()


def test_tables_that_make_no_sense_are_refused_with_what_is_allowed():
    """Each message begins with the key."""
    assert fault(straight(1.0, **spring(table=[[1.0, 2.0], [0.5, 3.0]]))).startswith("springs.s.law.table")
    assert "length 0.5 comes after length 1" in fault(straight(1.0, **spring(table=[[1.0, 2.0], [0.5, 3.0]])))
    both = straight(1.0, **spring(table=[[0.5, 2.0], [1.0, 3.0]]))
    both["springs"]["s"]["stiffness"] = 3.0
    assert fault(both).startswith("springs.s.stiffness = 3.0 N/m: the law gives all of it")
    neither = straight(1.0, springs={"s": {"type": "linear", **ENDS, "free_length": 1.0}})
    assert fault(neither).startswith("springs.s.stiffness: missing")
    drives = straight(1.0, dampers={"d": {"type": "linear", **ENDS, "law": {"table": [[-1, 1], [0, 0], [1, 1]]}}})
    assert "would drive what it is to slow down" in fault(drives)
    one_sided = straight(1.0, dampers={"d": {"type": "linear", **ENDS, "law": {"table": [[1, 1], [2, 2]]}}})
    assert "on both sides of 0" in fault(one_sided)
    over = straight(
        1.0, forces={"f": {"body": "load", "force": [1, 0, 0], "law": {"over": "y", "table": [[0, 1], [1, 2]]}}}
    )
    del over["responses"]["y"]
    assert fault(over).startswith("forces.f.law.over")
    assert "no such coordinate" in fault(over)
    itself = straight(1.0, forces={"f": {"body": "load", "against": "load", "force": [1, 0, 0]}})
    assert "two different bodies" in fault(itself)
