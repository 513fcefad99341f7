"""A cam and its roller, from a STEP file to a run: the candidate that is found is the contact that lifts the roller."""

import json
from math import cos, sin

import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from tests.engine.cad import stops

pytestmark = pytest.mark.processes

TURN, ROLLER, GAP = 0.1, 2.0, 0.2

ANSWERS = {
    "# fixed = true": "",
    "# gravity = [0.0, 0.0, -0.00981]": "gravity = [-0.00981, 0.0, 0.0]",
    "# [contacts.stop-1]": "[contacts.stop-1]",
    "# a = ": "a = ",
    "# b = ": "b = ",
    "# material = ": "material = ",
}
LINES = f"""
[bodies.ground]
fixed = true

[joints.axle]
type = "revolute"
bearing = {{ body = "ground", point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
journal = {{ body = "cam-frame", point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}

[joints.guide]
type = "prismatic"
guide = {{ body = "ground", point = [0.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
slider = {{ body = "cam-mover", point = [0.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}

[motions.turn]
body = "cam-frame"
about = {{ axis = [0.0, 0.0, 1.0] }}
law = {{ table = [[0.0, 0.0], [40.0, {TURN}]], interpolation = "smooth" }}

[responses.lift]
type = "position"
from = {{ body = "ground", point = [0.0, 0.0, 0.0] }}
to = {{ body = "cam-mover", point = [0.0, 0.0, 0.0] }}
direction = {{ vector = [1.0, 0.0, 0.0] }}
"""


def clearcap(*words):
    """Return what a command prints."""
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.exception
    return done.stdout


@pytest.mark.slow
def test_from_a_step_file_to_the_lift_of_a_cam(tmp_path, monkeypatch):
    """Import, remove the marks of the candidate, check, simulate: the roller rests where the turned nose holds it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    stops.drawing({"cam": stops.roller_on_cam(GAP)}).write(tmp_path / "cam.step")
    printed = clearcap("mechanism", "import", "cam.step", "-o", "cam.toml", "--no-pictures")
    assert "facing stop-1: cam-frame and cam-mover, 0.2 mm apart, along 4 mm\n" in printed
    text = (tmp_path / "cam.toml").read_text()
    for mark, answer in ANSWERS.items():
        assert mark in text
        text = text.replace(mark, answer)
    answered = "\n".join(line for line in text.splitlines() if not line.startswith("#?"))
    (tmp_path / "cam.toml").write_text(f"{answered}\n{LINES}")
    assert clearcap("mechanism", "check", "cam.toml").endswith("cam.toml: no errors\n")
    run = json.loads(clearcap("simulate", "cam.toml", "--json"))
    across = stops.NOSE_AT * sin(TURN)
    centre = stops.NOSE_AT * cos(TURN) + ((stops.NOSE + ROLLER) ** 2 - across**2) ** 0.5
    drawn = stops.NOSE_AT + stops.NOSE + GAP + ROLLER
    assert run["status"] == "ok"
    assert run["responses"]["lift"] == pytest.approx(centre - drawn, abs=1e-6)
