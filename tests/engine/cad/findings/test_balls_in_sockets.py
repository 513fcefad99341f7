"""Balls in sockets that hold them are found; from any other socket a ball can leave."""

import numpy as np
import pytest

from engine.cad.findings.facing_planes import triangles_by_face
from engine.cad.findings.joints import balls_in_sockets
from tests.engine.cad.ball_joints import BALL, SOCKET, ball_joint, cup, stem


def found(assembly):
    """Return the joints of an assembly, and why others are none."""
    joints, refused = balls_in_sockets(assembly, triangles_by_face(assembly))
    return joints, [each.reason for each in refused]


@pytest.mark.parametrize("unit", ["MM", "INCH"])
@pytest.mark.parametrize("depth", [1.0, 2.5])
def test_a_socket_that_goes_past_the_middle(read, unit, depth):
    """Radii, centres and clearance are those of the drawing."""
    [joint], refused = found(read(ball_joint(cup(depth), stem(), x=0.01), unit=unit))
    assert refused == []
    assert (joint.socket_part, joint.ball_part) == ("cup", "stem")
    sizes = joint.socket_radius, joint.ball_radius, joint.radial_clearance
    assert sizes == pytest.approx((SOCKET, BALL, SOCKET - BALL), abs=1e-9)
    np.testing.assert_allclose(joint.ball_centre - joint.centre, [0.01, 0.0, 0.0], atol=1e-9)
    assert joint.overlap == 0.0


def test_equal_radii(read):
    """The clearance is 0, for a person to say, and so is what overlaps; an offset is an overlap."""
    [joint], _ = found(read(ball_joint(cup(2.0, BALL), stem()), unit="INCH"))
    assert (joint.radial_clearance, joint.overlap) == (0.0, 0.0)
    [moved], _ = found(read(ball_joint(cup(2.0, BALL), stem(), x=0.05)))
    assert moved.overlap == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize(
    ("bearing", "ball", "said"),
    [
        (cup(0.0), stem(), "the ball can leave the socket"),
        (cup(-2.0), stem(), "the ball can leave the socket"),
        (cup(0.3), stem(BALL - 0.2), "the ball can leave the socket"),  # opens at 5.02, the ball has 4.8
        (cup(2.0), stem(SOCKET - 0.5), "the radii differ by 0.5 mm"),
        (cup(2.0), stem(SOCKET + 0.1), "the ball is 0.1 mm larger in radius"),
    ],
)
def test_decoys(read, bearing, ball, said):
    """What only looks like a joint is refused with the reason."""
    joints, [reason] = found(read(ball_joint(bearing, ball)))
    assert joints == []
    assert reason.startswith(said)


def test_a_ball_elsewhere_is_nothing(read):
    """Nor is it named."""
    assert found(read(ball_joint(cup(2.0), stem(), x=30.0))) == ([], [])
