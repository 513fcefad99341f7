"""A pin in the middle of its hole that crosses its play within one step: the side ahead holds it, whichever that is."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.engine.histories import history
from tests.engine.small import made, small

PLAY, STEP, SPEED = 1e-4, 1e-3, 1.0  # SI; ten times the play in a step
AXIS = np.array([0.0, 0.0, 1.0])
WAYS = [Rotation.from_rotvec(angle * AXIS).apply([1.0, 0.0, 0.0]) for angle in (0.0, 1.1, 2.6, 4.4)]
RING = {
    "type": "clearance_revolute",
    "bearing": {"body": "part", "point": [0.0, 0.0, 0.0], "axis": AXIS.tolist()},
    "journal": {"body": "ground", "point": [0.0, 0.0, 0.0], "axis": AXIS.tolist(), "radius": 0.01},
    "rings": [-0.01, 0.01],
}
BALL = {
    "type": "clearance_spherical",
    "socket": {"body": "ground", "point": [0.0, 0.0, 0.0]},
    "ball": {"body": "part", "point": [0.0, 0.0, 0.0], "radius": 0.01},
}
PLACES = [(RING, way) for way in WAYS] + [(BALL, np.array(way) / 3) for way in ([1, 2, 2], [-2, 1, -2], [2, -2, -1])]


def in_the_middle(joint: dict[str, Any], **tables: Any) -> dict[str, Any]:
    """Describe a part that is centred in a joint with play, for one step."""
    part = {"mass": 1.0, "inertia": [1.0] * 3}
    tables["bodies"] = {"ground": {"fixed": True}, "part": part} | tables.get("bodies", {})
    joint = joint | {"radial_clearance": PLAY, "friction": 0.3}
    return small(**tables, joints={"J": joint}, simulation={"step": STEP, "horizon": STEP, "theta": 1.0})


def ends_at_the_side_ahead(data: dict[str, Any], way: np.ndarray) -> None:
    """Check that the part has crossed its play, has the velocity that this takes, and is pushed back, not aside."""
    run = history(made(data))
    part = np.argmin(np.linalg.norm(run.x[0], axis=1))
    np.testing.assert_allclose(run.x[-1, part], PLAY * way, rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.v[-1, part, :3], PLAY / STEP * way, rtol=0, atol=1e-6)
    np.testing.assert_allclose(run.v[-1, part, 3:], 0.0, atol=1e-6)


@pytest.mark.parametrize(("joint", "way"), PLACES)
def test_a_part_in_flight(joint, way):
    """It flies along its own way; a rotation about the middle chooses no side."""
    data = in_the_middle(joint)
    data["bodies"]["part"]["velocity"] = (SPEED * way).tolist()
    ends_at_the_side_ahead(data, way)


@pytest.mark.parametrize(("joint", "way"), PLACES)
def test_a_part_that_another_one_pushes(joint, way):
    """It is at rest until, within the step, another body hits it: the way is that after the impact."""
    hammer = {"mass": 1.0, "inertia": [1.0] * 3, "origin": (-way).tolist(), "velocity": (SPEED * way).tolist()}
    head = {"a": {"body": "hammer", "point": way.tolist()}, "friction": 0.0}
    head["b"] = {"body": "part", "plane": {"point": (1e-6 * way).tolist(), "normal": (-way).tolist()}}
    ends_at_the_side_ahead(in_the_middle(joint, bodies={"hammer": hammer}, contacts={"head": head}), way)
