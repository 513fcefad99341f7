"""A run as a drawing that moves: what a page computes of it is what the scene shows."""

import json
import re

import numpy as np
import pytest

from clearcap.pictures.moving_drawing import LARGER_SIDE, arrow_data, moving_drawing, path_data
from clearcap.pictures.scene import scene_of

NUMBER = r"-?\d+\.\d"


@pytest.mark.parametrize("name", ["pendulum", "slide"])
def test_every_point_is_drawn_where_the_scene_has_it(name, request):
    """Outlines times places are the scene's polylines on the drawing, y downwards, to a thousandth of its size."""
    trajectory = request.getfixturevalue(name)
    scene = scene_of(trajectory, 6)
    drawing = moving_drawing(scene)
    assert max(drawing.width, drawing.height) == LARGER_SIDE
    ends, drawn = [], []
    for body, moved in zip(scene.bodies.values(), drawing.frames["bodies"], strict=True):
        outline = () if body.fixed else (body.outline,)
        shown = {"outline": outline, "lines": body.lines, "faces": body.faces}
        for part, lines in shown.items():
            assert len(moved["parts"][part]) == len(lines)
            for numbers, line in zip(moved["parts"][part], lines, strict=True):
                for frame, place in enumerate(np.array(moved["places"])):
                    ends.append(line[frame])
                    drawn.append(np.reshape(numbers, (-1, 3)) @ place[:6].reshape(2, 3).T + place[6:])
    ends, drawn = np.vstack(ends), np.vstack(drawn)
    assert np.ptp(ends, axis=0).max() > 0
    scale = np.ptp(drawn[:, 0]) / np.ptp(ends[:, 0])
    expected = (ends - ends[0]) * [scale, -scale]
    np.testing.assert_allclose(drawn - drawn[0], expected, atol=0.001 * LARGER_SIDE)
    assert drawn.min() >= 0
    assert (drawn <= [drawing.width, drawing.height]).all()


def test_it_stands_at_its_end(pendulum):
    """The paths are those of the last frame, also of the journal; one mark for each ring, inside its clearance."""
    scene = scene_of(pendulum, 6)
    drawing = moving_drawing(scene)
    moved = drawing.frames["bodies"][list(scene.bodies).index("link")]
    place = np.array(moved["places"][-1])
    corners = np.reshape(moved["parts"]["outline"][0], (-1, 3)) @ place[:6].reshape(2, 3).T + place[6:]
    link = next(body for body in drawing.bodies if body.name == "link")
    assert link.parts["outline"] == path_data([corners], closed=True)
    (play,) = drawing.plays
    assert play["joint"] == "J1"
    for ring, drawn in enumerate(play["rings"]):
        at = scene.plays[0].eccentricity[-1, ring]
        x, y = map(float, re.fullmatch(r"M(\S+) (\S+)h0", drawn["dot"]).groups())
        np.testing.assert_allclose([x, -y], at, atol=1e-3)
        assert np.hypot(x, y) < 1.01
    assert drawing.arrows == drawing.frames["arrows"][-1]
    assert len(drawing.frames["time"]) == len(moved["places"]) == len(scene.time)


def test_arrows_of_the_slide(slide):
    """Four contacts carry the block: four arrows of a shaft and a head each; the key is as long as it says."""
    drawing = moving_drawing(scene_of(slide, 5))
    assert drawing.frames["arrows"][-1].count("M") == 8
    assert drawing.common == "2 N"  # of 8.5 N on four corners
    assert drawing.key.startswith(f"M0.0 0.0L{drawing.key_length} 0.0M")
    assert drawing.springs == ""


def test_it_is_plain_data(slide):
    """It travels as JSON without a number that is not finite."""
    frames = moving_drawing(scene_of(slide, 5)).frames
    assert json.loads(json.dumps(frames, allow_nan=False)) == frames


def test_paths():
    line = np.array([[0.0, 1.0], [2.0, 3.0]])
    assert path_data([line]) == "M0.0 1.0L2.0 3.0"
    assert path_data([line], closed=True) == "M0.0 1.0L2.0 3.0Z"
    assert path_data([line[:1]]) == "M0.0 1.0L0.0 1.0"
    assert path_data([]) == ""
    assert arrow_data(line, line + np.array([[0.0, 0.5], [10.0, 0.0]])) == "M2.0 3.0L12.0 3.0M8.0 5.0L12.0 3.0L8.0 1.0"
