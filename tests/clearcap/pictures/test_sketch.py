"""The sketch of a mechanism: every response has a name on it or a word in the legend, and no name covers another."""

from itertools import combinations

import numpy as np
import pytest

from clearcap.pictures.canvas import LETTER, LINE
from clearcap.pictures.sketch import sketch_mechanism
from clearcap.pictures.view import choose_view
from engine import load_mechanism
from tests.each import each
from tests.engine.small import block_on_floor, made
from tests.engine.test_bushings import hung, leaf
from tests.engine.test_couplings import wheels


def boxes(sketch):
    """Return left, top, right and bottom of all words."""
    found = []
    for word in sketch.words:
        wide = 0.5 * LETTER * sketch.text * max(map(len, word.lines))
        tall = 0.5 * LINE * sketch.text * len(word.lines)
        found.append((word.x - wide, word.y - tall, word.x + wide, word.y + tall))
    return found


def crowded(count, vertical):
    """Return a block with many lengths from one point to one corner, in space."""
    data = block_on_floor(origin=[0, 0, 0.7])
    directions = [[0, 0, 1]] * count if vertical else [[i % 3 == j for j in range(3)] for i in range(count)]
    data["responses"] = {
        f"height_of_the_corner_{i}": {
            "type": "position",
            "from": {"body": "ground", "point": [0, 0, 0]},
            "to": {"body": "block", "point": [0.1, 0.2, 0.3 + 0.01 * (i % 20)]},
            "direction": {"vector": [float(x) for x in direction]},
        }
        for i, direction in enumerate(directions)
    }
    return made(data)


@each(
    "mechanism",
    [
        *(load_mechanism(name) for name in ("c60", "four_bar", "chain", "sphere_roll", "spinning_top", "incline")),
        *(crowded(count, vertical) for count in (10, 40) for vertical in (True, False)),
    ],
)
def test_names_are_on_the_canvas_and_not_on_each_other(mechanism):
    """Also with 40 responses of one point, in the plane of the picture and along the line of sight."""
    sketch = sketch_mechanism(mechanism)
    for (a, b, c, d), (e, f, g, h) in combinations(boxes(sketch), 2):
        assert c <= e or g <= a or d <= f or h <= b
    for left, top, right, bottom in boxes(sketch):
        assert left >= -1
        assert top >= -1
        assert right <= sketch.width + 1
        assert bottom <= sketch.height + 1
    for stroke in sketch.strokes:
        assert all(0 <= x <= sketch.width for x, _ in stroke.points)


@pytest.mark.parametrize("name", ["c60", "four_bar", "sphere_roll", "spinning_top", "slider_crank"])
def test_every_response_is_marked_or_explained(name):
    """Its name is in the picture; what has no place is in the legend without a colour."""
    sketch = sketch_mechanism(load_mechanism(name))
    written = {line for word in sketch.words if word.bold for line in word.lines}
    assert [each[0] for each in sketch.legend] == list(load_mechanism(name).responses)
    for response, _, value, colour in sketch.legend:
        assert value
        assert (response in written) == bool(colour), response


def test_a_reference_far_away_does_not_shrink_the_mechanism():
    """What is measured from 1 km away is cut at the edge of the picture."""
    data = block_on_floor(origin=[0, 0, 0.7])
    plain = sketch_mechanism(made({**data, "responses": {}}))
    data["responses"] = {
        "far": {
            "type": "position",
            "from": {"body": "ground", "point": [-1e6, 0, 0]},
            "to": {"body": "block", "point": [0, 0, 0]},
            "direction": {"vector": [1, 0, 0]},
        }
    }
    sketch = sketch_mechanism(made(data))
    width = [max(x for x, _ in s.areas[0][0]) - min(x for x, _ in s.areas[0][0]) for s in (plain, sketch)]
    assert width[1] > 0.4 * width[0]


def test_a_beam_is_drawn_from_end_to_end_and_a_bushing_as_a_dot():
    """A thick line as long as the beam on the canvas, and one dot more than without the bushing."""
    beam = sketch_mechanism(made(leaf(responses={})))
    (line,) = [stroke for stroke in beam.strokes if stroke.style == "thick"]
    assert np.hypot(*np.subtract(*line.points)) > 10.0
    data = hung()
    sketch = sketch_mechanism(made(data))
    (turn,) = [each.value for each in sketch.legend if each.name == "torque"]
    assert "torque on load" in turn
    bare = sketch_mechanism(made({**data, "responses": {}}))
    assert len(bare.dots) == 1


def test_a_spring_is_drawn_between_its_ends():
    """A zigzag from a post at (0.3, 0, 0.1) to the side of a block, 0.2 m long; without the spring it is not there."""
    data = block_on_floor(origin=[0, 0, 0.1])
    plain = len(sketch_mechanism(made(data)).strokes)
    ends = [{"body": "ground", "point": [0.3, 0, 0.1]}, {"body": "block", "point": [0.1, 0, 0]}]
    data["springs"] = {"push": {"type": "linear", "a": ends[0], "b": ends[1], "stiffness": 1.0, "free_length": 0.2}}
    mechanism = made(data)
    strokes = sketch_mechanism(mechanism).strokes
    assert len(strokes) == plain + 1
    (zigzag,) = [stroke.points for stroke in strokes if len(stroke.points) == 12]
    view = choose_view(mechanism)
    way = np.diff(view.project(np.array([[0.3, 0.0, 0.1], [0.1, 0.0, 0.1]])), axis=0)[0]
    drawn = np.subtract(zigzag[-1], zigzag[0]) * [1.0, -1.0]
    assert np.linalg.norm(drawn) > 20.0
    assert drawn / np.linalg.norm(drawn) == pytest.approx(way / np.linalg.norm(way), abs=1e-2)


def test_a_coupling_is_drawn_from_joint_to_joint():
    """A dashed line between the two shafts, which are 1 m apart, as long as that on the canvas."""
    mechanism = made(wheels())
    view = choose_view(mechanism)
    (line,) = [stroke for stroke in sketch_mechanism(mechanism).strokes if stroke.style == "dashed"]
    way = np.diff(view.project(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])), axis=0)[0]
    drawn = np.diff(np.array(line.points), axis=0)[0] * [1.0, -1.0]
    assert np.linalg.norm(drawn) > 20.0
    assert drawn / np.linalg.norm(drawn) == pytest.approx(way / np.linalg.norm(way), abs=1e-2)
