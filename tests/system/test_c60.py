"""The main job with real physics: the C-60 campaign by the command, few samples."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from campaign import open_store

pytestmark = [pytest.mark.processes, pytest.mark.bits]

ROOT = Path(__file__).parents[2]
SAMPLES = 6


def clearcap(*words, cwd):
    """Run the command in a process of its own and return its JSON document and its messages."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "clearcap", *map(str, words), "--json"]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two stores: the same campaign on one worker and on two, in other batches."""
    folder = tmp_path_factory.mktemp("c60")
    common = ("run", "c60", "--samples", SAMPLES)
    clearcap(*common, "--store", "one", "--workers", 1, "--batch-size", 4, cwd=folder)
    clearcap(*common, "--store", "two", "--workers", 2, cwd=folder)
    return folder


def test_every_run_is_there_and_certified(folder):
    """All rows, all ok, each with the residual and penetration asked for, at rest."""
    rows = open_store(str(folder / "one")).table().to_pylist()
    assert [row["sample"] for row in rows] == list(range(SAMPLES))
    for row in rows:
        assert (row["status"], row["message"], row["settled"]) == ("ok", "", True)
        assert row["max_residual"] <= 1e-6
        assert row["max_penetration"] <= 1e-6
        assert 9.0 < row["FC-1"] < 16.0
        assert row["latch_overlap"] > 0.0


def test_workers_and_batches_do_not_change_a_bit(folder):
    """One worker and two, batches of 4 and of 1: the same campaign id and the same bits."""
    stores = [open_store(str(folder / name)) for name in ("one", "two")]
    assert stores[0].campaigns() == stores[1].campaigns()
    one, two = (store.table().drop_columns(["wall_s", "attempts"]) for store in stores)
    assert one.equals(two)


def test_same_command_again_computes_nothing(folder):
    """A finished campaign is found, its report written again, and nothing noisy is said."""
    document, messages = clearcap("run", "c60", "--samples", SAMPLES, "--store", "two", cwd=folder)
    assert (document["samples"], document["ok"], document["computed"]) == (SAMPLES, SAMPLES, 0)
    *said, progress = messages.splitlines()
    assert all(line.startswith("clearcap: ") for line in said)
    assert progress == f"{SAMPLES}/{SAMPLES} runs, 0 failed, completed"


def test_a_row_is_a_single_run(folder):
    """``simulate`` with a row's inputs gives the row's responses, bit for bit."""
    row = open_store(str(folder / "one")).table().to_pylist()[3]
    changes = [word for i in range(1, 8) for word in ("--set", f"J{i}={row[f'J{i}']!r}")]
    document, _ = clearcap("simulate", "c60", *changes, cwd=folder)
    assert document["status"] == "ok"
    assert document["responses"] == {name: row[name] for name in document["responses"]}
    assert document["certificate"]["steps"] == row["steps"]
