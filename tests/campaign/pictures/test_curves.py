"""Curves over time: what they show, and files with words."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from campaign.pictures.curves import cut_range, panels, plot
from tests.counts import some


def test_panels_of_the_pendulum(pendulum):
    """Each response, energy from its start, active contacts, the largest force: with units, and the run's numbers."""
    shown = panels(pendulum)
    axes = [(panel.axis, panel.unit) for panel in shown]
    assert axes == [("drop", "m"), ("tip", "m"), ("energy", "J"), ("number", "1"), ("force", "N")]
    drop, _, energy, number, force = shown
    assert drop.title == "drop: drop of the bore below the bolt"
    np.testing.assert_array_equal(drop.curves["drop"], pendulum.responses["drop"])
    assert list(energy.curves) == ["kinetic", "potential", "sum"]
    assert energy.curves["sum"][0] == 0
    assert (np.diff(energy.curves["sum"]) < 1e-9).all()  # it is damped
    assert (number.curves["active contacts"][0], number.curves["active contacts"][-1]) == (0, 2)
    largest = np.linalg.norm(pendulum.force("J1.ring1"), axis=1)
    assert force.curves["largest force"].max() == pytest.approx(largest.max())


def test_cut_range():
    """A single high peak is cut, what belongs to the curve is not."""
    wave = np.sin(np.linspace(0, 20, 1000))
    assert cut_range(wave) is None
    assert cut_range(np.ones(10)) is None
    low, high = cut_range(np.append(wave, 500.0))
    assert low == pytest.approx(-1, abs=1e-5)
    assert 1 < high < 10


@pytest.mark.parametrize("ending", some([".png", ".svg", ".pdf"]))
def test_plot_is_a_picture_with_words(pendulum, tmp_path, ending):
    """PNG, SVG and PDF: sound files, with a description in their metadata; the same run makes the same bytes."""
    path = tmp_path / f"curves{ending}"
    plot(pendulum, path)
    content = path.read_bytes()
    said = r"Pendulum on a bolt with play: not_at_rest at t = 0\.1 s"
    if ending == ".png":
        with Image.open(path) as image:
            image.load()
            assert min(image.size) > 500
            assert re.match(said, image.text["Description"])
            assert "tip ends at" in image.text["Description"]
    elif ending == ".svg":
        texts = " ".join(text for text in ET.fromstring(content).itertext())
        assert re.search(said, texts)
        for label in ("time [s]", "drop [m]", "energy [J]", "force [N]", "kinetic", "potential"):
            assert label in texts
    else:
        assert content.startswith(b"%PDF")
    plot(pendulum, path)
    assert path.read_bytes() == content
