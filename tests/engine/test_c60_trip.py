"""The C-60 tripped out of ON by a torque on its bar: what lets go, where it ends, what it does not pass through."""

import numpy as np
import pytest

from engine import read_trajectory, simulate
from tests.engine.small import made, shipped

ANGLES = ("handle", "plate", "moving_contact", "tripping_bar")
TRIPPED = 1.0  # ms, how long the torque acts


def with_trip(torque: float) -> dict:
    """Describe the C-60 with a torque [N mm] that opens its bar after it has come to rest in ON, then 14 ms more."""
    data = shipped("c60")
    data["phases"] += [{"name": "trip", "duration": TRIPPED}, {"name": "open", "duration": 14.0}]
    data["torques"]["trip"] = {"body": "tripping_bar", "torque": [0.0, 0.0, torque], "phases": ["trip"]}
    del data["validity"], data["responses"]["FC-1_low"], data["responses"]["FC-1_high"]  # of forces at rest in ON
    for body in ANGLES:
        data["responses"][body] = {"type": "angle", "body": body, "axis": [0.0, 0.0, 1.0]}
    return data


@pytest.fixture(scope="module", params=[0.01, 0.07, 0.13])
def tripped(request, tmp_path_factory):
    """Trip the C-60 with some clearance in all joints; return its certificate and its motion."""
    path = tmp_path_factory.mktemp("trip") / "trip.h5"
    run = simulate(made(with_trip(25.0)), {f"J{i}": request.param for i in range(1, 8)}, trajectory=path)
    assert run.status == "ok", run.message
    return run.certificate, read_trajectory(path)


def open_gap(motion, stop: str) -> float:
    """Return the least gap of a stop's points at the end."""
    return min(float(c.gap[-1]) for name, c in motion.contacts.items() if name.startswith(stop))


@pytest.mark.slow
def test_nothing_passes_through_anything(tripped):
    """All signed gaps of all steps."""
    certificate, motion = tripped
    assert certificate.max_penetration <= 1e-8
    assert min(contact.gap.min() for contact in motion.contacts.values()) >= -1e-8


@pytest.mark.slow
def test_it_ends_in_the_tripped_position(tripped):
    """Handle on C2, plate on C3, moving contact on the plate (C6), C7 open; these three at rest."""
    _, motion = tripped
    assert [open_gap(motion, stop) < 1e-3 for stop in ("C1", "C2", "C3", "C6", "C7")] == [
        False,
        True,
        True,
        True,
        False,
    ]
    assert 4.5 < open_gap(motion, "C7") < 5.5
    for body, turned in (("handle", 1.50), ("plate", 0.425), ("moving_contact", 0.276)):
        angle = motion.responses[body]
        assert angle[-1] == pytest.approx(turned, abs=0.02)
        assert abs(angle[-1] - angle[np.searchsorted(motion.time, motion.time[-1] - 0.5)]) < 5e-3


@pytest.mark.slow
def test_nothing_is_lost(tripped):
    """Every pin in its bore, every part between case and cover, the bar not past its stop."""
    _, motion = tripped
    start = {name: body.origin[0] for name, body in motion.bodies.items()}
    for name, body in motion.bodies.items():
        assert np.abs(body.origin[:, 2] - start[name][2]).max() < 1.7, name
        assert np.linalg.norm(body.origin - start[name], axis=1).max() < 8.0, name
    assert motion.responses["tripping_bar"].max() < 1.1


def test_springs_pay_for_what_moves_and_rubs(tripped):
    """Once the torque has ended energy only goes, but for what a step of an impact may add."""
    _, motion = tripped
    energy = motion.kinetic + motion.potential
    after = energy[np.searchsorted(motion.time, motion.time[-1] - 14.0) :]
    change = np.diff(after)
    assert change[change > 0].sum() < 0.01 * (after[0] - after[-1])
    assert after[0] - after[-1] > 20.0, "mJ of the springs"
    assert motion.kinetic[-1] < 0.5


def test_a_torque_that_friction_bears_does_not_trip():
    """With 8 N mm on the bar the latch holds: friction there takes three times as much."""
    run = simulate(made(with_trip(8.0)))
    assert run.status == "ok", run.message
    assert run.measured["latch_overlap"] > 0.4
    assert run.measured["FC-1"] > 9.0
