"""What the plain scheme lets drift: a pin sinks in at an impact and no further, an ideal joint by second order."""

import numpy as np

from engine.trajectory import contact_forces
from tests.engine.oracles.reference import order, recorded
from tests.engine.oracles.test_clearance_pendulum import pendulum
from tests.engine.small import shipped, small

Z = [0.0, 0.0, 1.0]
BASE, CRANK, COUPLER, ROCKER = 3.0, 1.0, 4.0, 2.5  # m
AT_START = {  # centre of mass and angle, every pin in the middle of its bore
    "crank": (CRANK, [-1.3723e-5, 0.5], 1.570823772407980),
    "coupler": (COUPLER, [1.876454585097650, 1.691962091335582], 0.3532842020624460),
    "rocker": (ROCKER, [3.3764686197082958, 1.191962183453451], 1.264872058968431),
}


def plain(name):
    """Return a shipped mechanism with the plain scheme."""
    data = shipped(name)
    data["simulation"]["scheme"] = "moreau_jean"
    return data


def loose_four_bar(step, duration):
    """Describe the four-bar of Siconos' examples: rods of 1 kg, 5 mm of play in three joints, friction 0.1.

    There a controller lets the crank follow 6 sin(3 pi t/4), from 1.57 rad away; here it goes that way whatever comes.
    """
    t = np.linspace(0.0, 1.2, 1201)
    slow, fast = 1.58825, -0.01745  # rad: the start is off by their sum, at rest
    angle = 6 * np.sin(0.75 * np.pi * t) + slow * np.exp(-10 * t) + fast * np.exp(-100 * t)

    def joint(bearing, at, journal, pin):
        return {
            "type": "clearance_revolute",
            "bearing": {"body": bearing, "point": [at, 0.0, 0.0], "axis": Z},
            "journal": {"body": journal, "point": [pin, 0.0, 0.0], "axis": Z, "radius": 0.055},
            "rings": [0.0],
            "radial_clearance": 0.005,
            "friction": 0.1,
        }

    def flat(body):
        return {
            "type": "planar",
            "a": {"body": "ground", "point": [0.0, 0.0, 0.0], "normal": Z},
            "b": {"body": body, "point": [0.0, 0.0, 0.0], "normal": Z},
        }

    drive = {
        "type": "revolute",
        "bearing": {"body": "crank", "point": [-CRANK / 2, 0.0, 0.0], "axis": Z},
        "journal": {"body": "ground", "point": [0.0, 0.0, 0.0], "axis": Z},
    }
    return small(
        gravity=[0.0, -9.81, 0.0],
        simulation={"scheme": "moreau_jean", "step": step, "horizon": duration},
        phases=[{"name": "turn", "duration": duration}],
        bodies={"ground": {"fixed": True}}
        | {
            name: {"mass": 1.0, "inertia": [length**2 / 12] * 3, "origin": [*place, 0.0], "angle": angle}
            for name, (length, place, angle) in AT_START.items()
        },
        joints={"drive": drive, "plane_1": flat("coupler"), "plane_2": flat("rocker")}
        | {
            "J1": joint("coupler", -COUPLER / 2, "crank", CRANK / 2),
            "J2": joint("rocker", ROCKER / 2, "coupler", COUPLER / 2),
            "J3": joint("rocker", -ROCKER / 2, "ground", BASE),
        },
        motions={
            "crank": {
                "body": "crank",
                "about": {"axis": Z},
                "law": {"table": np.stack([t, angle - angle[0]], 1).tolist(), "interpolation": "smooth"},
            }
        },
    )


def test_a_loose_four_bar_sinks_in_at_impacts_only():
    """At 0.1 ms by 0.13 mm of 5 mm of play; closed contacts do not sink on by more than 1e-6 m in the half turn after.

    No pin sinks in deeper than it comes in one step. Siconos with its controller: 0.046 mm. With the normals of the
    middle of a step it would be 1.3 mm, and grow with every turn.
    """
    step = 1e-4
    run = recorded(loose_four_bar(step, 0.5))
    for contact in run.contacts.values():
        gap, closed = contact.gap, contact.impulse[:, 0] > 0
        assert -gap.min() <= np.maximum(-np.diff(gap), 0.0).max()
        late = gap[closed & (run.time > 0.1)]
        assert len(late) > 3000
        assert late[0] - late.min() < 1e-6
    assert min(contact.gap.min() for contact in run.contacts.values()) > -1.3e-4


def test_joints_drift_by_second_order():
    """The double pendulum opens by 4.5e-5 m in 5 s with 1 ms, a quarter of it with half the step.

    With the joints' directions of the middle of a step: 0.021 m, of first order.
    """
    steps = [2e-3, 1e-3, 5e-4]
    opened = [recorded(plain("double_pendulum"), h).certificate["max_violation"] for h in steps]
    assert opened[1] < 5e-5
    assert order(steps, opened) > 1.8


def test_forces_have_the_frames_of_the_step():
    """While the pin slides in its bore, the sum of the contact forces in the world is m (dv/dt - g), up to 0.024 N.

    It would be 1.9e-4 N off with the frames of the middle of a step; what is left stems from
    impacts, which no frame foresees.
    """
    run = recorded(pendulum(1, "moreau_jean"))
    rows = np.arange(len(run.time))
    _, forces = contact_forces(run, rows.tolist())
    wanted = np.diff(run.bodies["L0"].velocity, axis=0) / run.step[1:, None] - [0.0, -0.00981, 0.0]
    closed = run.contacts["J0.ring1"].impulse[1:, 0] > 0
    settled = closed & np.roll(closed, 1)
    assert settled.sum() > 2000
    np.testing.assert_allclose(forces[1:].sum(axis=1)[settled], wanted[settled], atol=3e-5)
