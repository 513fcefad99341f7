"""The loop of a test bench: its strokes, and the command that draws it."""

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from campaign.cli import app
from campaign.pictures.hysteresis import strokes

BENCHED = """
[benches.pull]
title = "Pull test"
plot = { x = "lift", y = "pull" }
phases = [{ name = "up", duration = 0.1 }, { name = "down", duration = 0.1 }]
simulation = { horizon = 0.3 }

[benches.pull.motions.machine]
body = "block"
along = { direction = [0.0, 0.0, 1.0] }
law = { table = [[0.0, 0.0], [0.1, 0.01], [0.2, 0.0]] }

[benches.pull.responses.lift]
type = "position"
from = { body = "ground", point = [0.0, 0.0, 0.0] }
to = { body = "block", point = [0.0, 0.0, 0.0] }
direction = { vector = [0.0, 0.0, 1.0] }

[benches.pull.responses.pull]
type = "spring_force"
spring = "hanger"

[presets.soft]
title = "a softer spring"
values = { "springs.hanger.stiffness" = 10.0 }
"""
HANGING = """
format = 1
name = "hanging"
units = "SI"

[simulation]
step = 1e-3
horizon = 1.0
penetration = 1e-8
rest = { window = 0.05, drift = 1e-7 }

[bodies.ground]
fixed = true
[bodies.block]
mass = 1.0
inertia = [1.0, 1.0, 1.0]

[springs.hanger]
type = "linear"
a = { body = "ground", point = [0.0, 0.0, 1.0] }
b = { body = "block", point = [0.0, 0.0, 0.0] }
stiffness = 100.0
free_length = 1.0
"""


def test_strokes_of_a_way_forth_and_back():
    """Forward to the turn, back to the second, forward again; a stand at a turn belongs to the stroke before."""
    way = np.array([0.0, 1.0, 2.0, 2.0, 1.0, 0.5, 1.5])
    assert strokes(way) == [(1, 0, 3), (-1, 3, 5), (1, 5, 6)]
    assert strokes(np.zeros(4)) == [(1, 0, 3)]
    assert strokes(np.array([3.0, 2.0, 1.0])) == [(-1, 0, 2)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Stand in a folder with a mechanism that has a bench and a preset."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hanging.toml").write_text(HANGING + BENCHED)
    return tmp_path


def test_a_bench_draws_its_loop_unless_told_otherwise(folder):
    """Into a file named after mechanism and bench, which says in words what it shows; a JSON run writes none."""
    words = ["simulate", "hanging.toml", "--bench", "pull"]
    quiet = CliRunner().invoke(app, [*words, "--json"])
    assert quiet.exit_code == 0, quiet.output
    assert not list(folder.glob("*.png"))
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    with Image.open(folder / "hanging-pull.png") as picture:
        said = picture.info["Description"]
    assert said.startswith("Pull test: ok")
    assert "pull against lift: from 0 to 0.01 m" in said


def test_a_preset_is_set_before_single_values(folder):
    """10 N/m in the place of 100, and --set in the place of both."""
    words = ["simulate", "hanging.toml", "--bench", "pull", "--preset", "soft", "--plot"]
    for name, more in (("soft.svg", []), ("hard.svg", ["--set", "springs.hanger.stiffness=1000"])):
        assert CliRunner().invoke(app, [*words, name, *more]).exit_code == 0
    assert "largest 0.1 N" in (folder / "soft.svg").read_text()
    assert "largest 10 N" in (folder / "hard.svg").read_text()


@pytest.mark.parametrize(
    ("option", "said"), [("--bench", "no bench 'pul'; allowed: pull"), ("--preset", "no preset 'pul'; allowed: soft")]
)
def test_an_unknown_bench_or_preset_is_one_message(folder, option, said):
    """With what there is."""
    done = CliRunner().invoke(app, ["simulate", "hanging.toml", option, "pul"])
    assert said in str(done.exception)


def test_check_goes_through_all_benches(folder):
    """A bench that does not fit is found before it is used."""
    file = folder / "hanging.toml"
    file.write_text(file.read_text().replace('y = "pull"', 'y = "pll"'))
    done = CliRunner().invoke(app, ["mechanism", "check", "hanging.toml"])
    assert "plot.y = 'pll'" in str(done.exception)
