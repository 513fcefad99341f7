"""The files of pictures are real, say in words what they show, and need no network; numbers behind the drawing."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from campaign.pictures.animation import animate
from campaign.pictures.animation_figure import arrow_lengths, common_force, join_lines, limits, zigzag
from campaign.pictures.curves import cut_range, panels, plot
from campaign.pictures.gif import palette_of
from engine import read_trajectory, simulate
from tests.engine.small import block_on_floor, made

# --- curves


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


@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
def test_plot_is_a_picture_with_words(pendulum, tmp_path, ending):
    """PNG, SVG and PDF: sound files, with a description in their metadata; the same run makes the same bytes."""
    path = tmp_path / f"curves{ending}"
    plot(pendulum, path)
    content = path.read_bytes()
    said = r"Pendulum on a bolt with play: not_converged at t = 0\.1 s"
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


# --- animation


def test_gif_has_its_frames(pendulum, tmp_path):
    """As many frames as asked for, and something moves in them."""
    path = tmp_path / "pendulum.gif"
    animate(pendulum, path, frames=4)
    with Image.open(path) as image:
        assert image.n_frames == 4
        first = np.asarray(image.convert("RGB"), int)
        image.seek(3)
        assert (np.abs(np.asarray(image.convert("RGB"), int) - first) > 50).any()


def test_palette_keeps_areas_and_thin_things():
    """Colours of areas come out exactly, the hue of a few pixels nearly, among as many shades as there are pixels."""
    picture = np.full((100, 100, 3), 255, np.uint8)
    picture[:50] = (244, 246, 249)
    picture[60:80] = np.arange(20 * 100 * 3).reshape(20, 100, 3) % 251
    picture[90, 40:60] = (166, 28, 0)
    frame = Image.fromarray(picture)
    drawn = np.asarray(frame.quantize(palette=palette_of(frame), dither=Image.Dither.NONE).convert("RGB"), int)
    np.testing.assert_array_equal(drawn[:50], picture[:50])
    np.testing.assert_array_equal(drawn[95], picture[95])
    assert np.abs(drawn[90, 50] - [166, 28, 0]).max() < 30


def test_page_needs_no_network(slide, tmp_path):
    """HTML: the frames are in it, nothing is loaded from elsewhere, all buttons have signs, the picture has words."""
    path = tmp_path / "slide.html"
    animate(slide, path, frames=3)
    page = path.read_text("utf-8")
    assert page.count("data:image/png;base64") == 3
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", page)
    assert "<i " not in page
    assert '<html lang="en">' in page
    assert 'alt="3 frames of Block on a slope: ok at t = 0.2 s"' in page


RUINED = {"force": [1e308, 0, 0]}  # on a gram: the first step ends nowhere


@pytest.mark.parametrize("forces", [{}, {"push": {"body": "block", **RUINED}}], ids=["flies", "diverges"])
def test_runs_with_little_to_show(tmp_path, forces):
    """A body alone, without contacts or joints, also when its run diverges: pictures of what there is."""
    data = block_on_floor(origin=[0, 0, 0.5], mass=1e-3) | {"forces": forces}
    del data["contacts"], data["bodies"]["ground"], data["responses"]
    simulate(made(data), horizon=0.01, trajectory=tmp_path / "run.h5")
    run = read_trajectory(tmp_path / "run.h5")
    assert (run.status == "diverged") == bool(forces)
    plot(run, tmp_path / "run.svg")
    animate(run, tmp_path / "run.gif", frames=2)
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames == (1 if forces else 2)


def test_common_force_and_arrows():
    """The key is a round number not above the large forces; a peak is cut at twice the key's arrow."""
    forces = np.array([[[3.0, 4.0], [0.0, 0.0]], [[0.0, 6.0], [0.0, 600.0]]])
    assert common_force(forces[:1]) == 5
    assert common_force(np.zeros((2, 3, 2))) == 0
    assert [common_force(np.array([[[size, 0.0]]])) for size in (1.0, 1.9, 2.0, 0.049, 730)] == [1, 1, 2, 0.02, 500]
    arrows = arrow_lengths(forces, 5.0, 10.0)
    np.testing.assert_allclose(arrows[0], [[6, 8], [0, 0]])
    np.testing.assert_allclose(arrows[1], [[0, 12], [0, 20]])
    assert not arrow_lengths(forces, 0.0, 10.0).any()


def test_limits_hold_bodies_and_arrows():
    """A margin around both; something flat gets one too."""
    corners = limits(np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[[3.0, 0.5]]]))
    np.testing.assert_allclose(corners, [[-0.18, -0.18], [3.18, 1.18]])
    assert (np.ptp(limits(np.zeros((2, 2)), np.zeros((1, 2))), axis=0) > 0).all()


def test_springs_and_joined_lines():
    """A spring goes from end to end; joined lines have gaps between them."""
    spring = zigzag(np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(spring[[0, -1]], [[1, 1], [3, 1]])
    assert np.ptp(spring[:, 1]) == pytest.approx(0.24)
    lines = join_lines([np.zeros((2, 2)), np.ones((3, 2))])
    np.testing.assert_array_equal(np.isnan(lines[:, 0]), [1, 0, 0, 1, 0, 0, 0, 1])


# --- files
