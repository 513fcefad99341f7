"""The figure of a run: curves over time, or the loop of a test bench, with the command that draws it."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from clearcap.cli import app
from clearcap.pictures.run_figure import cut_range, panels, plot, strokes
from tests.counts import some

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
