"""What an animation shows, as numbers: the plane, poses, shapes, forces, and the play of joints."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from campaign.pictures.body_shapes import body_shape, hull
from campaign.pictures.play import plays
from campaign.pictures.polylines import circle, patch, square
from campaign.pictures.poses import poses, progress, spread_rows
from campaign.pictures.scene import scene_of
from campaign.pictures.view import choose_view
from engine import load_mechanism
from tests.engine.small import block_on_floor, made, shipped, turned

X, Y, Z = np.eye(3)

# --- the plane


@pytest.mark.parametrize(
    ("name", "right", "up"),
    [("clearance_pendulum", X, Y), ("c60", X, Y), ("incline", X, Z)],
)
def test_plane_of_the_shipped_mechanisms(name, right, up):
    """Along the joints' axes; without joints across gravity and the planes' normals. Exactly, where it is an axis."""
    view = choose_view(load_mechanism(name))
    np.testing.assert_array_equal([view.right, view.up], [right, up])
    np.testing.assert_array_equal(np.cross(view.right, view.up), view.normal)


def test_plane_turns_with_the_mechanism():
    """A turned pendulum is seen along its axis, up against its gravity; the picture is the same or its mirror."""
    rotation = Rotation.from_rotvec([0.4, -1.1, 0.7])
    view = choose_view(made(turned(shipped("clearance_pendulum"), rotation, np.zeros(3))))
    assert abs(view.normal @ rotation.apply(Z)) == pytest.approx(1)
    np.testing.assert_allclose(view.up, rotation.apply(Y), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm([view.right, view.up, view.normal], axis=1), 1)


def test_plane_without_any_hint():
    """A brick above a level floor is seen from the front; without gravity and planes along z."""
    data = block_on_floor(origin=[0, 0, 0.5])
    np.testing.assert_array_equal(choose_view(made(data)).up, Z)
    del data["contacts"], data["gravity"]
    np.testing.assert_array_equal(choose_view(made(data)).normal, Z)


def test_projection():
    """Points and vectors of any shape lose what is along the line of sight."""
    view = choose_view(load_mechanism("incline"))
    np.testing.assert_array_equal(view.project(np.array([[[1.0, 2.0, 3.0]]])), [[[1.0, 3.0]]])


# --- instants and poses


def test_rows_are_spread_in_time():
    """Evenly in time, not in rows; first and last are there, and none twice."""
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 1.0, 2.0])
    np.testing.assert_array_equal(spread_rows(time, 3), [0, 5, 6])
    np.testing.assert_array_equal(spread_rows(time, 100), np.arange(7))
    np.testing.assert_array_equal(spread_rows(np.zeros(1), 10), [0])


def test_progress_is_time_and_way(pendulum):
    """A body that falls freely, then swings: 0 to 1, growing; at rest time alone counts, and turning is way."""
    mechanism, n = pendulum.mechanism(), len(pendulum.time)
    done = progress(pendulum, mechanism, n)
    assert (done[0], done[-1]) == pytest.approx((0, 1))
    assert (np.diff(done) > 0).all()
    link = pendulum.bodies["link"]
    held = {"position": np.tile(link.position[0], (n, 1)), "quaternion": np.tile(link.quaternion[0], (n, 1))}
    still = replace(pendulum, bodies={"link": replace(link, **held)})
    np.testing.assert_allclose(progress(still, mechanism, n), pendulum.time / pendulum.time[-1], atol=1e-12)
    turn = np.where(np.arange(n)[:, None] < n // 2, 0.0, 0.3) * [[0, 0, 1]]  # at once, in the middle
    held["quaternion"] = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
    jump = np.diff(progress(replace(pendulum, bodies={"link": replace(link, **held)}), mechanism, n))
    assert jump.max() == pytest.approx(0.7 + 0.3 / (n - 1))


def test_poses_of_moving_and_fixed_bodies(pendulum):
    """A point of the link moves as the response says; the ground stays; world and local are inverse."""
    mechanism, rows = pendulum.mechanism(), np.array([0, 250, 500])
    at = poses(pendulum, mechanism, rows)
    tip = at["link"].world(np.array([[0, -0.2, 0.0]]))
    np.testing.assert_allclose(tip[:, 0, 0], pendulum.responses["tip"][rows], atol=1e-15)
    np.testing.assert_array_equal(at["ground"].world(np.eye(3)), np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_allclose(at["link"].local(tip[:, 0]), np.tile([0, -0.2, 0], (3, 1)), atol=1e-15)


# --- play


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


# --- shapes


def test_circle_and_arc():
    """All points at the radius in the plane; an arc from -half to +half about its middle."""
    points = circle([1, 2, 3], Z, 2.0)
    np.testing.assert_allclose(np.linalg.norm(points - [1, 2, 3], axis=1), 2)
    np.testing.assert_allclose(points[:, 2], 3)
    np.testing.assert_allclose(points[0], points[-1])
    arc = circle([0, 0, 0], Z, 1.0, X, np.pi / 2)
    np.testing.assert_allclose(arc[[0, 24, -1]], [-Y, X, Y], atol=1e-15)


def test_patch_covers_what_is_touched():
    """The square of a plane reaches beyond all touched points, and lies in the plane."""
    touched = np.array([[0, 0, 1.0], [4, 0, 1.0], [np.nan] * 3])
    corners = patch(Z, touched, -Y, 0.5)
    np.testing.assert_allclose(corners[:, 2], 1)
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-0.5, 4.5))
    np.testing.assert_array_equal(square([0, 0, 0], X, Y)[[0, 2]], [[1, 1, 0], [-1, -1, 0]])


def test_outline():
    """The convex hull in order; two ends of a line; one point; nothing."""
    corners = np.array([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2.0]])
    assert sorted(hull(corners)) == [0, 1, 3, 4]
    line = np.linspace(0, 1, 5)[:, None] * [[3, 4]]
    assert sorted(hull(line)) == [0, 4]
    assert hull(np.zeros((1, 2))) == [0]
    assert hull(np.zeros((0, 2))) == []


def test_outline_of_the_file_comes_first():
    """In place of the hull; then of contact primitives only working faces are drawn: arcs and rectangles."""
    data = shipped("clearance_pendulum")
    corners = [[0.0, 0.0], [0.1, -0.1], [0.0, -0.2, 0.01]]
    link = body_shape(made(data), "link", choose_view(made(data)), {}, 1.0)
    assert len(link.outline) > 3
    data["bodies"]["link"]["outline"] = corners
    drawn = body_shape(made(data), "link", choose_view(made(data)), {}, 1.0)
    np.testing.assert_array_equal(drawn.outline, [[0, 0, 0], [0.1, -0.1, 0], [0, -0.2, 0.01]])
    assert len(drawn.lines) == len(link.lines) == 1  # its bore
    mechanism = load_mechanism("c60")
    touched = {name: np.zeros((1, 3)) for name in mechanism.contacts}
    contact = body_shape(mechanism, "moving_contact", choose_view(mechanism), touched, 1.0)
    assert all(np.ptp(line, axis=0).max() < 5 for line in contact.lines)  # not the whole cylinder of C7, 10.4 wide


# --- the scene


def test_scene_of_the_slide(slide):
    """Frames, bodies, one patch for the four contacts on the slope, forces that carry the weight across the slope."""
    scene = scene_of(slide, 5)
    share = np.linspace(0, 1, 5)  # of what happens: 0.3 of it time t, 0.7 the way t^2 down the slope
    np.testing.assert_allclose(scene.time / 0.2, (np.sqrt(0.09 + 2.8 * share) - 0.3) / 1.4, atol=0.01)
    assert (scene.bodies["slope"].fixed, scene.bodies["block"].fixed) == (True, False)
    (face,) = scene.bodies["slope"].faces
    along = np.array([np.cos(np.pi / 6), -np.sin(np.pi / 6)])
    across = np.array([-along[1], along[0]])
    np.testing.assert_allclose(face @ across, 0, atol=1e-12)
    corners = scene.points[-1]
    assert (face[0] @ along).max() > (corners @ along).max()
    np.testing.assert_allclose(scene.bodies["block"].outline[0].min(axis=0), (-0.1 * along)[0], atol=0.05)
    carried = scene.forces[1:].sum(axis=1)
    np.testing.assert_allclose(carried @ across, 9.81 * np.cos(np.pi / 6), rtol=1e-6)
    np.testing.assert_allclose(carried @ along, -0.3 * 9.81 * np.cos(np.pi / 6), rtol=1e-6)
    assert scene.plays == ()


def test_box_holds_all_bodies(pendulum):
    """Every corner of the moving body in every frame is inside the box; one frame is the start."""
    scene = scene_of(pendulum, 4)
    outline = scene.bodies["link"].outline
    assert (outline >= scene.box[0]).all()
    assert (outline <= scene.box[1]).all()
    start = np.array([0.2 * np.sin(0.5), -0.2 * np.cos(0.5)])
    assert np.linalg.norm(outline[0] - start, axis=1).min() < 1e-12  # the tip, which a response names
