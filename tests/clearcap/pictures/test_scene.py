"""The numbers behind an animation."""

import numpy as np

from clearcap.pictures.scene import scene_of


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
