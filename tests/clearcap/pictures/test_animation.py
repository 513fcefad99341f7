"""Animations: files that open, with all frames, of any run."""

import re

import numpy as np
import pytest
from PIL import Image

from clearcap.pictures.animation import animate, join_lines
from clearcap.pictures.run_figure import plot
from clearcap.pictures.scene import HOLD, PER_SECOND, arrow_lengths, common_force, limits, zigzag
from engine import read_trajectory, simulate
from tests.engine.small import block_on_floor, made

RUINED = {"force": [1e100, 0, 0]}  # on 1e-97 kg: the first step ends nowhere


def test_gif_has_its_frames(pendulum, tmp_path):
    """As many frames as asked for, and something moves in them."""
    path = tmp_path / "pendulum.gif"
    animate(pendulum, path, frames=4)
    with Image.open(path) as image:
        assert image.n_frames == 4
        first = np.asarray(image.convert("RGB"), int)
        image.seek(3)
        assert (np.abs(np.asarray(image.convert("RGB"), int) - first) > 50).any()


def test_gif_holds_its_end(pendulum, tmp_path):
    """The last frame is shown longer than the others, as if it were drawn so many more times."""
    path = tmp_path / "pendulum.gif"
    animate(pendulum, path, frames=3)
    with Image.open(path) as image:
        shown = [image.seek(frame) or image.info["duration"] for frame in range(image.n_frames)]
    each = round(1000 / PER_SECOND)
    assert shown == [time // 10 * 10 for time in (each, each, each * (1 + HOLD))]  # ms; a GIF counts hundredths


def test_page_needs_no_network(slide, tmp_path):
    """HTML: the frames are in it, nothing is loaded from elsewhere, all buttons have signs, the picture has words."""
    path = tmp_path / "slide.html"
    animate(slide, path, frames=3)
    page = path.read_text("utf-8")
    assert page.count("data:image/png;base64") == 3
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", page)
    assert """<meta http-equiv="Content-Security-Policy" content="default-src 'none';""" in page
    assert "<i " not in page
    assert '<html lang="en">' in page
    assert 'alt="3 frames of Block on a slope: ok at t = 0.2 s"' in page


@pytest.mark.parametrize("forces", [{}, {"push": {"body": "block", **RUINED}}], ids=["flies", "diverges"])
def test_runs_with_little_to_show(tmp_path, forces):
    """A body alone, without contacts or joints, also when its run fails at once: pictures of what there is."""
    data = block_on_floor(origin=[0, 0, 0.5], mass=1e-97) | {"forces": forces}
    del data["contacts"], data["bodies"]["ground"], data["responses"]
    simulate(made(data), horizon=0.01, trajectory=tmp_path / "run.h5")
    run = read_trajectory(tmp_path / "run.h5")
    assert run.status in ("diverged", "not_converged", "not_at_rest") or not forces
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
