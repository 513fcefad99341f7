"""`clearcap mechanism plain`: the same mechanism without its CAD file."""

import json
import tomllib

import pytest
import tomli_w
from typer.testing import CliRunner

from clearcap.cli import app
from engine import load_mechanism
from tests.engine.mechanism.geometry.latch_file import latch_file

pytestmark = pytest.mark.processes


def test_plain(tmp_path, monkeypatch):
    """The file has the same digest, names no CAD file, and is what --json and the terminal show."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    drawn, written = tmp_path / "latch.toml", tmp_path / "plain.toml"
    drawn.write_text(tomli_w.dumps(latch_file()))
    assert CliRunner().invoke(app, ["mechanism", "plain", str(drawn), "-o", str(written)]).exit_code == 0
    plain = load_mechanism(written)
    assert plain.digest() == load_mechanism(drawn).digest()
    assert plain.geometry is None
    tables = tomllib.loads(written.read_text())
    assert not {"cad", "geometry"} & tables.keys()
    assert json.loads(CliRunner().invoke(app, ["mechanism", "plain", str(drawn), "--json"]).stdout) == tables
    assert tomllib.loads(CliRunner().invoke(app, ["mechanism", "plain", str(drawn)]).stdout) == tables


def test_another_ending(tmp_path):
    """Only a TOML file is written."""
    done = CliRunner().invoke(app, ["mechanism", "plain", "c60", "-o", str(tmp_path / "c60.txt")])
    assert "unknown ending" in str(done.exception)
