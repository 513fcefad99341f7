"""The command in a folder where others have put files: none is executed, none changes a row, nobody is blamed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker import batch as computing
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress
from engine import simulate
from engine.platform.child import python_environment
from tests.campaign import fake_engine
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits
from tests.until import until

COMMAND = Path(sys.executable).with_name("clearcap")

MODULES = (
    *(
        "campaign",
        "clearcap",
        "engine",
        "reporting",
        "signal",
        "socket",
        "numpy",
        "numba",
        "pickle",
        "multiprocessing",
        "yaml",
    ),
    *("dask", "distributed", "typing", "json", "sitecustomize", "usercustomize", "conftest", "rich", "typer"),
    *("matplotlib", "scipy", "pyarrow", "evil"),
)

SETTINGS = {
    # for Numba: other instructions, and so other bits
    ".numba_config.yaml": "opt: 3\nboundscheck: 1\ndisable_jit: 1\nenable_avx: 0\ncpu_name: generic\n",
    # for matplotlib: a program and a module of this folder
    "matplotlibrc": "animation.ffmpeg_path: ./evil\nbackend: module://evil\nfigure.hooks: evil:run\nfont.size: 40\n",
    "dask.yaml": "distributed:\n  worker:\n    preload: evil\n  nanny:\n    preload: evil\n",
    ".env": "PYTHONPATH=.\nNUMBA_DISABLE_JIT=1\n",
    "pyproject.toml": "[tool.pytest.ini_options]\naddopts = '-p evil'\n",
    "setup.cfg": "[tool:pytest]\naddopts = -p evil\n",
    "pytest.ini": "[pytest]\naddopts = -p evil\n",
    "pyvenv.cfg": "home = .\n",
}

CAMPAIGN = """
format = 1
name = "slope"
mechanism = "incline"
samples = 12

[failures]
min_ok = 0                           # half of the blocks slide

[simulation]
horizon = 0.2
step = 1e-6

[variables.friction]
target = "materials.block_slope.friction"
distribution = "uniform"
lower = 0.4
upper = 0.8
"""


@pytest.fixture
def hostile(tmp_path):
    """Return a folder with files that leave a trace beside it when they are executed, and the folder of the traces."""
    folder, traces = tmp_path / "hostile", tmp_path / "traces"
    traces.mkdir()
    (folder / ".dask").mkdir(parents=True)
    for name in MODULES:
        code = f"import os\nopen({str(traces / name)!r}, 'a').close()\nraise ImportError('hostile {name}')\n"
        (folder / f"{name}.py").write_text(code)
    for name, text in SETTINGS.items():
        (folder / name).write_text(text)
    (folder / ".dask" / "dask.yaml").write_text(SETTINGS["dask.yaml"])
    for name in ("evil", "ffmpeg", "python", "python3", "lscpu"):
        (folder / name).write_text(f"#!/bin/sh\necho > {traces / name}\n")
        (folder / name).chmod(0o755)
    return folder, traces


def command(folder, *words, program=(str(COMMAND),)):
    """Run the command in a folder, without what the environment of this test says of paths."""
    words = [*program, *words]
    done = subprocess.run(words, cwd=folder, env=environment(), capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def environment():
    """Return this environment without what it says of Python's path."""
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


@pytest.mark.processes
@pytest.mark.slow
def test_a_run_is_the_same_there(hostile, tmp_path):
    """One run and its picture; also as ``python -m clearcap``, which has found its package before we can act."""
    folder, traces = hostile
    clean = tmp_path / "clean"
    clean.mkdir()
    words = ["simulate", "incline", "--plot", "motion.svg", "--json"]
    here, there = (json.loads(command(where, *words)) for where in (clean, folder))
    for document in (here, there):
        document["certificate"].pop("wall_s")
    assert there == here
    assert (folder / "motion.svg").read_bytes() == (clean / "motion.svg").read_bytes()
    (folder / "clearcap.py").unlink()
    again = json.loads(command(folder, *words, program=(sys.executable, "-m", "clearcap")))
    assert again["responses"] == here["responses"]
    assert list(traces.iterdir()) == []


@pytest.mark.processes
def test_an_isolated_child_imports_nothing_there(hostile, store, plan, monkeypatch):
    """Neither its own modules nor those of Python's library come from the current folder."""
    folder, traces = hostile
    monkeypatch.setattr(computing, "STARTS", 1)
    monkeypatch.chdir(folder)
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    assert [row["status"] for row in rows_in_subprocess(address, range(3), 1)] == ["ok"] * 3
    assert list(traces.iterdir()) == []


@pytest.mark.processes
def test_a_child_imports_what_its_parent_can(tmp_path):
    """The folder of a script stays on the path, for functions that live there; the current folder is no part of it."""
    (tmp_path / "beside.py").write_text("answer = 42\n")
    script = tmp_path / "script.py"
    script.write_text(
        "import subprocess, sys\nfrom engine.platform.child import python_environment\n"
        "code = 'import beside, sys; print(beside.answer, sys.flags.safe_path)'\n"
        "subprocess.run([sys.executable, '-c', code], env=python_environment(), check=True)\n"
    )
    done = subprocess.run(
        [sys.executable, script],
        cwd="/",
        env={**environment(), "PYTHONPATH": python_environment()["PYTHONPATH"]},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.stdout == "42 True\n", done.stderr


@pytest.mark.processes
@pytest.mark.slow
def test_a_campaign_is_the_same_there(hostile, tmp_path):
    """``clearcap run`` whose worker is killed once: the rows of a clean folder to the bit, nothing executed."""
    folder, traces = hostile
    (folder / "slope.toml").write_text(CAMPAIGN)
    reference, plan = computed(tmp_path / "clean", load_campaign(str(folder / "slope.toml")), 6, simulate)
    words = ["run", "slope.toml", "--workers", "1", "--batch-size", "6", "--store", "runs"]
    running = subprocess.Popen([COMMAND, *words], cwd=folder, env=environment(), stderr=subprocess.PIPE, text=True)
    try:
        kill_worker_after(folder / "runs" / plan.campaign_id / "parts" / "part-000000.parquet", running)
        _, messages = running.communicate(timeout=600)
    finally:
        running.kill()
        running.wait()
    assert running.returncode == 0, messages
    assert "was given to a worker that ended" in messages
    assert bits(open_store(str(folder / "runs")), plan).equals(bits(reference, plan))
    assert list(traces.iterdir()) == []


def kill_worker_after(part, running):
    """Kill -9 the worker of a running command as soon as it has written a part and computes the next one."""
    until(lambda: part.exists() or running.poll() is not None, "the first part", pause=0.02)
    children = psutil.Process(running.pid).children(recursive=True)
    workers = [child for child in children if any("spawn_main" in word for word in child.cmdline())]
    max(workers, key=lambda worker: sum(worker.cpu_times()[:2])).kill()


@pytest.mark.processes
def test_numba_takes_no_settings_from_there(hostile):
    """They would choose other instructions, and so other bits."""
    folder, _ = hostile
    code = (
        "import engine.jit, numba.core.config as c; c.reload_config(); print(c.DISABLE_JIT, c.CPU_NAME, c.BOUNDSCHECK)"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=folder, env=environment(), capture_output=True, text=True, timeout=600
    )
    assert done.stdout == "0 None None\n", done.stderr
