"""The picture of what is measured, as a file."""

import re

from PIL import Image

from clearcap.pictures.sketch import plot_measurements
from engine import load_mechanism
from tests.engine.small import block_on_floor, made


def test_what_is_said_of_a_response_stands_alone(tmp_path):
    """Whether or not the response has a title, and beside one that names the body."""
    data = block_on_floor(origin=[0, 0, 0.7])
    turn = {"type": "angle", "body": "block", "axis": [0, 0, 1], "at": "end"}
    data["responses"] = {"plain": turn, "titled": {**turn, "title": "angle of the block"}}
    plot_measurements(made(data), tmp_path / "block.png")
    with Image.open(tmp_path / "block.png") as image:
        image.load()
        said = image.text["Description"]
    assert said.endswith("plain: rotation of block; titled: angle of the block, rotation of block.")


def test_picture_has_words(tmp_path):
    """The file is an image and says what it shows; a mechanism without responses is drawn all the same."""
    plot_measurements(load_mechanism("c60"), tmp_path / "c60.png")
    with Image.open(tmp_path / "c60.png") as image:
        image.load()
        assert re.search(r"FC-2: needle to pin, X, 10\.6 mm here", image.text["Description"])
    data = block_on_floor(origin=[0, 0, 0.7])
    data["responses"] = {}
    plot_measurements(made(data), tmp_path / "block.svg")
    assert "FC" not in (tmp_path / "block.svg").read_text()
