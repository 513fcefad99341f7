"""The play of joints, against the gaps of their contacts."""

import numpy as np

from clearcap.pictures.play import plays
from clearcap.pictures.view import choose_view, poses
from tests.engine.small import block_on_floor, made, shipped


def test_play_is_what_the_gap_leaves(pendulum):
    """In units of the clearance the journal's way from the centre is 1 - gap / clearance, at each ring and row."""
    mechanism = pendulum.mechanism()
    at = poses(pendulum, mechanism, np.arange(len(pendulum.time)))
    (play,) = plays(mechanism, at, choose_view(mechanism))
    assert (play.joint, play.clearance, play.eccentricity.shape) == ("J1", 5e-4, (501, 2, 2))
    for ring in range(2):
        gap = pendulum.contacts[f"J1.ring{ring + 1}"].gap
        np.testing.assert_allclose(np.linalg.norm(play.eccentricity[:, ring], axis=1), 1 - gap / 5e-4, atol=1e-9)
    np.testing.assert_allclose(play.eccentricity[0], 0, atol=1e-12)
    drop = pendulum.responses["drop"]
    np.testing.assert_allclose(play.eccentricity[:, 0, 1], drop / 5e-4, atol=1e-9)  # low bore: high bolt


def test_play_across_an_axis_in_the_picture(pendulum):
    """Seen from the side, the play is still drawn whole: as seen along the axis."""
    mechanism = pendulum.mechanism()
    view = choose_view(made(block_on_floor(origin=[0, 0, 0.5])))  # from the front: the joint's axis is up in it
    at = poses(pendulum, mechanism, np.arange(len(pendulum.time)))
    (play,) = plays(mechanism, at, view)
    gap = pendulum.contacts["J1.ring1"].gap
    np.testing.assert_allclose(np.linalg.norm(play.eccentricity[:, 0], axis=1), 1 - gap / 5e-4, atol=1e-9)


def test_ideal_joints_have_no_play():
    """One word in the file, and there is no circle to draw."""
    data = shipped("clearance_pendulum")
    data["joints"]["J1"]["type"] = "revolute"
    mechanism = made(data)
    assert list(plays(mechanism, {}, choose_view(mechanism))) == []
