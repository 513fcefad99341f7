"""``clearcap bench``: no stage of a step is forgotten, the timed loop computes the same, the command prints it."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from engine import load_mechanism
from engine.jit import Callee, Kernel
from engine.kernels import step, time_loop
from engine.profile import step_times, timed_loop
from engine.profile.step_times import StepTimes, measure_step_times

MEASURED = StepTimes(
    mechanism="incline",
    status="ok",
    message="",
    step=1e-3,
    bodies=1,
    contacts=4,
    ties=0,
    steps=20,
    repeated=0,
    step_us=12.34567,
    iterations_per_step=0.5,
    shares={"solver": 0.25, "other": 0.75},
    max_residual=1e-9,
    max_penetration=0.0,
    max_violation=0.0,
)
KERNELS = (Callee, Kernel)


def kernels_called_by(dispatcher):
    """Return the names of the kernels a kernel calls."""
    function = dispatcher.py_func
    return {name for name in function.__code__.co_names if isinstance(function.__globals__.get(name), KERNELS)}


def test_every_stage_of_a_step_has_a_clock():
    """What a step calls is in the table of stages, and nothing else; what is timed of the loop, the loop calls."""
    assert kernels_called_by(step.step) == set(timed_loop.STAGES_OF_STEP)
    assert set(timed_loop.STAGES_OF_LOOP) < kernels_called_by(time_loop.run_to_end)
    assert {*timed_loop.STAGES_OF_STEP.values(), *timed_loop.STAGES_OF_LOOP.values()} == set(timed_loop.STAGES)


@pytest.mark.slow  # compiles the loop once more
def test_shares_and_numbers_of_a_run():
    """Shares are positive and make 1; the numbers are those of as many steps as were asked for."""
    measured = measure_step_times(load_mechanism("clearance_pendulum"), steps=200)
    assert measured.status == "ok"
    assert measured.steps - measured.repeated == 200
    assert (measured.bodies, measured.contacts, measured.ties) == (1, 2, 0)
    assert sum(measured.shares.values()) == pytest.approx(1)
    assert all(measured.shares[stage] > 0 for stage in ("solver", "contacts", "loads", "projection"))
    assert 0 < measured.max_residual <= 1e-8
    assert 0 < measured.max_penetration <= 1e-8
    assert measured.step_us > 0


def test_command(monkeypatch):
    """A table, or the same numbers as JSON; exit status 1 when a run failed, with its reason."""
    monkeypatch.setattr(step_times, "measure_step_times", lambda mechanism, steps: replace(MEASURED, steps=steps))
    done = CliRunner().invoke(app, ["bench", "incline", "--steps", "30", "--json"])
    assert done.exit_code == 0
    (entry,) = json.loads(done.stdout)
    assert (entry["steps"], entry["step_us"], entry["shares"]["solver"]) == (30, 12.34567, 0.25)
    table = CliRunner().invoke(app, ["bench", "incline", "--steps", "30"]).stdout
    assert "12.3" in table
    assert "25.0" in table
    failed = replace(MEASURED, status="not_converged", message="friction problem: residual 0.1")
    monkeypatch.setattr(step_times, "measure_step_times", lambda mechanism, steps: failed)
    done = CliRunner().invoke(app, ["bench", "incline"])
    assert done.exit_code == 1
    assert "incline: friction problem: residual 0.1" in done.stdout
