"""Animations: files that open, with all frames, of any run."""

import re

import numpy as np
import pytest
from PIL import Image

from campaign.pictures.animation import HOLD, PER_SECOND, animate
from campaign.pictures.curves import plot
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
