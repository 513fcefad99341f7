"""That the engine is compiled is said when it is, and never otherwise."""

import logging
import os
import shutil
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from typer.testing import CliRunner

from campaign import compiling
from campaign.compiling import announced_compilation, compile_engine
from campaign.errors import SpecError
from campaign.spec import load
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.questions import mechanisms
from clearcap.questions.mechanisms import mechanism_warnings
from engine import MechanismError, load_mechanism, missing_kernels, warm_up
from engine.jit import CACHE_FOLDER
from tests.campaign.commands import ROOT
from tests.until import until


@pytest.fixture
def quick(monkeypatch, caplog):
    """Look and speak often; return the messages so far."""
    monkeypatch.setattr(compiling, "LOOK_EVERY", 0.01)
    monkeypatch.setattr(compiling, "SAY_EVERY", 0.05)
    caplog.set_level(logging.INFO, logger="campaign")
    return lambda: [record.getMessage() for record in caplog.records]


def announcers():
    """Return how many threads look whether something is compiled."""
    return [thread.name for thread in threading.enumerate()].count("compiling")


def test_slow_start_is_no_compilation(quick, tmp_path, monkeypatch):
    """Nothing is said of a block that takes long and writes nothing, nor where nothing is missing."""
    looks = []
    monkeypatch.setattr(compiling, "_is_written", lambda *_: bool(looks.append(True)))
    with announced_compilation(()):
        assert announcers() == 0
    with announced_compilation([str(tmp_path / "never.nbi")]):
        until(lambda: len(looks) > 3, "nobody looks")
    assert quick() == []
    assert announcers() == 0


def test_compilation_is_said_with_its_progress(quick, tmp_path):
    """From the first kernel that is written: that it compiles, then for how long it has."""
    missing = [str(tmp_path / f"{n}.nbi") for n in range(3)]
    with announced_compilation(missing):
        (tmp_path / "1.nbi").write_text("x")
        until(lambda: len(quick()) > 1, "nothing is said")
    first, second, *_ = quick()
    assert first.startswith("compiling the engine, once for this version and this processor")
    assert second.startswith("compiling the engine: ")
    assert second.endswith(" s so far")


def test_a_block_within_a_block_says_it_once(quick, caplog, tmp_path):
    """As where a campaign is opened to estimate the time of its runs; afterwards it may be said again."""
    missing = [str(tmp_path / "0.nbi")]
    for _ in range(2):
        with announced_compilation(missing), announced_compilation(missing):
            (tmp_path / "0.nbi").write_text("x")
            until(lambda: quick() and quick()[-1].endswith("so far"), "nothing is said")
            assert announcers() == 1
        assert len([text for text in quick() if "once" in text]) == 1
        caplog.clear()


@pytest.mark.processes
def test_a_compiled_engine_misses_nothing(tmp_path):
    """After it was compiled nothing is missing, in this process and in another one; in an empty cache all is.

    A cache in which one kernel has no code misses that one, though the time loop is there.
    """
    warm_up()
    assert missing_kernels() == ()
    code = "from engine import missing_kernels; print(len(missing_kernels()))"

    def missing(**environment):
        command = [sys.executable, "-c", code]
        variables = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), **environment, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, env=variables, capture_output=True, text=True, check=True)
        return int(done.stdout)

    cache = tmp_path / "cache"
    cache.mkdir(mode=0o700)
    assert missing(NUMBA_CACHE_DIR=str(cache)) > 5
    assert missing(**os.environ) == 0
    part = tmp_path / "part"
    shutil.copytree(CACHE_FOLDER.parent, part)
    (index,) = part.glob(f"{CACHE_FOLDER.name}/**/responses.measure-*.nbi")
    index.unlink()
    assert missing(NUMBA_CACHE_DIR=str(part)) > 0


@pytest.fixture
def compiled(monkeypatch):
    """Return what happens in a process with an empty cache: ``compiled`` for all kernels, ``checked`` for a check."""
    happened = []
    for module in (compiling, load):
        monkeypatch.setattr(module, "missing_kernels", lambda: () if "compiled" in happened else ("0.nbi",))
    monkeypatch.setattr(compiling, "_compile_apart", lambda: happened.append("compiled"))
    for module in (load, mechanisms):
        monkeypatch.setattr(module, "check", lambda *_: happened.append("checked"))
    return happened


def test_all_is_compiled_before_a_check_compiles_a_part(compiled):
    """A check needs few kernels; compiled alone they would cost ten seconds more than together with the others."""
    load_campaign("c60")
    assert compiled == ["compiled", *["checked"] * (len(compiled) - 1)]
    assert len(compiled) > 10
    compiled.clear()
    mechanism_warnings(load_mechanism("c60"))
    assert compiled[:2] == ["compiled", "checked"]


def test_a_misspelt_name_is_told_before_anything_is_compiled(compiled):
    """On a new machine the answer would otherwise take a minute; what only an assembly shows is checked after it."""
    drawn = {"distribution": "uniform", "lower": 0.06, "upper": 0.08}
    tables = {"format": 1, "name": "new", "mechanism": "c60", "samples": 10, "seed": 1, "variables": {"J1": drawn}}
    wrong = {
        "variables.J11": tables | {"variables": {"J11": drawn}},
        "variables.J1": tables | {"variables": {"J1": drawn | {"lower": -1.0}}},
        "sample": tables | {"sample": 3},
    }
    for key, campaign in wrong.items():
        with pytest.raises(SpecError) as error:
            load_campaign(campaign)
        assert [fault.key for fault in error.value.faults][:1] == [key]
    done = CliRunner().invoke(app, ["simulate", "c60", "--set", "J11=0.07"])
    assert isinstance(done.exception, MechanismError)
    assert compiled == []
    load_campaign(tables)
    assert compiled[:2] == ["compiled", "checked"]


def test_nothing_is_compiled_again(compiled):
    """Nor is the engine loaded where nothing is missing, which would take a second."""
    compile_engine()
    compile_engine()
    assert compiled == ["compiled"]


@pytest.mark.processes
@pytest.mark.parametrize(("code", "here"), [("0", 0), ("7", 1)])
def test_the_compiler_stays_in_a_process_of_its_own(monkeypatch, tmp_path, code, here):
    """Its memory goes with it; only if it fails this process compiles, and raises what is to be raised."""
    python, calls = tmp_path / "python", []
    python.write_text(f'#!/bin/sh\necho "$*" > {tmp_path}/words\nexit {code}\n')
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(compiling, "missing_kernels", lambda: ("0.nbi",))
    monkeypatch.setattr(compiling, "warm_up", lambda: calls.append(1))
    compile_engine()
    assert "engine.warm_up()" in (tmp_path / "words").read_text()
    assert len(calls) == here


def peak_of(process):
    """Return the largest memory that a process has held so far [MB]; 0 if it has ended."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return next((float(line.split()[1]) / 1e3 for line in status.splitlines() if line.startswith("VmHWM")), 0.0)


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").exists(), reason="needs the peak of memory that Linux keeps")
def test_the_memory_of_the_compiler_is_not_that_of_the_coordinator(tmp_path):
    """It is in a process that has ended before the first run; the command would keep it for as long as it computes."""
    cache, peaks = tmp_path / "cache", {}
    cache.mkdir(mode=0o700)
    words = ["run", "c60", "--samples", "4", "--workers", "1", "--no-report", "--store", tmp_path / "runs"]
    command = [sys.executable, "-m", "clearcap", *map(str, words)]
    with (tmp_path / "said").open("w") as log:
        run = psutil.Popen(command, env=os.environ | {"NUMBA_CACHE_DIR": str(cache)}, stdout=log, stderr=log)
        while run.poll() is None:
            with suppress(psutil.NoSuchProcess):
                for process in [run, *run.children(recursive=True)]:
                    peaks[process.pid] = max(peak_of(process), peaks.get(process.pid, 0.0))
            time.sleep(0.05)
    assert run.returncode == 0, (tmp_path / "said").read_text()
    assert "compiling the engine" in (tmp_path / "said").read_text()
    own = peaks.pop(run.pid)
    assert own < 0.6 * max(peaks.values()), (own, peaks)
