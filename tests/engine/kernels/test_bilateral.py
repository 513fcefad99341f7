"""Bilateral rows by themselves: targets that follow a law, angles beyond half a turn, places among the unknowns."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly.bilateral import BilateralRow, bilateral_arrays
from engine.kernels.bilateral import row_targets, row_violations
from engine.kernels.model import SLIDE, TURN, TimeLaws

GROUND = 1
X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def violation(tie: BilateralRow, x=ORIGIN, turn: Rotation | None = None, target: float = 0.0) -> float:
    """Return the violation of one row between the ground (a) and a body (b) at a pose."""
    rotation = (turn or Rotation.identity()).as_matrix()
    found = np.zeros(1)
    pose = np.array([x, ORIGIN]), np.array([rotation, np.eye(3)])
    row_violations(bilateral_arrays([tie]), *pose, np.array([target]), found, np.zeros((1, 3)), np.zeros((1, 3)))
    return float(found[0])


def test_slide_is_the_way_along_its_direction_less_the_target():
    """A point at (1, 2, 3) of a body at (4, 5, 6), turned by 90 degrees about z, seen from (1, 1, 1)."""
    tie = BilateralRow("s", SLIDE, GROUND, 0, np.concatenate([X + Y + Z, Y, [1, 2, 3]]))
    quarter = Rotation.from_rotvec(np.pi / 2 * Z)
    assert violation(tie, np.array([4.0, 5, 6]), quarter, 0.5) == pytest.approx(5 + 1 - 1 - 0.5, abs=1e-14)


@pytest.mark.parametrize("target", [-9.0, -3.0, 0.0, 1.5, 3.1, 6.0, 100.0])
def test_turn_is_the_angle_off_the_target_whatever_the_number_of_turns(target):
    """0.01 rad beyond the target is seen as that, also where the angle itself jumps from pi to -pi."""
    tie = BilateralRow("t", TURN, GROUND, 0, np.concatenate([X, Z, X]), arm=3.0)
    for off in (0.01, -0.01, 1.0, -1.0):
        found = violation(tie, turn=Rotation.from_rotvec((target + off) * Z), target=target)
        assert found == pytest.approx(3.0 * off, abs=1e-12)


def test_target_is_offset_and_law():
    """At the start, at the end of a step and its rate there: here a law of 2 t from 0 to 3, then constant."""
    pieces = np.array([[0, 2.0, 0, 0], [6.0, 0, 0, 0]])
    laws = TimeLaws(
        np.array([0, 2]), np.array([0.0, 3.0]), pieces, np.zeros((1, 3)), np.zeros(1, np.int64), np.zeros(1)
    )
    geometry = np.concatenate([X, Z, X])
    rows = bilateral_arrays(
        [BilateralRow("t", TURN, 0, GROUND, geometry), BilateralRow("m", TURN, 0, GROUND, geometry, law=0)]
    )
    rows.offset[:] = 0.25, 1.0
    target = np.zeros((3, 2))
    for t, h, there, then, rate in ((0.0, 1.0, 0.0, 2.0, 2.0), (1.5, 0.5, 3.0, 4.0, 2.0), (2.0, 7.0, 4.0, 6.0, 0.0)):
        row_targets(rows, laws, t, h, target)
        assert target.tolist() == [[0.25, 1.0 + there], [0.25, 1.0 + then], [0.0, rate]]


def test_no_rows():
    """Arrays of the right shapes."""
    assert bilateral_arrays([]).geometry.shape == (0, 9)
