"""Exit status: 4 where a store or a disk fails, 2 for what the user wrote wrong, 130 for Ctrl-C at any time."""

import errno
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from campaign.errors import SpecError, StoreError, unwritable
from campaign.store import open_store
from tests.campaign.commands import ROOT, clearcap_here
from tests.campaign.store.files.test_files import small_disk
from tests.campaign.store.test_store import fill
from tests.each import each
from tests.until import until

__all__ = ["small_disk"]


@each("code", ["ENOSPC", "EDQUOT", "EROFS", "EIO", "ESTALE", "ETIMEDOUT", "ENOTCONN", "EMFILE"])
def test_a_disk_that_fails(code):
    """Full, read-only, broken, out of reach."""
    number = getattr(errno, code)
    assert isinstance(unwritable("x", OSError(number, "x")), StoreError)


@each("code", ["EACCES", "EPERM", "ENOENT", "ENOTDIR", "EISDIR", "EEXIST", "ENAMETOOLONG", "ELOOP"])
def test_a_wrong_place(code):
    """Not there, of another kind, another's."""
    assert isinstance(unwritable("x", OSError(getattr(errno, code), "x")), SpecError)


def remount(disk, how):
    """Mount a disk read-only or for writing."""
    subprocess.run(["mount", "-o", f"remount,{how}", str(disk)], check=True)


@pytest.mark.parametrize("verb", ["run", "submit"])
def test_read_only_from_the_start(small_disk, campaign_file, capsys, monkeypatch, verb):
    """A store on a disk that cannot be written is no fault of the input."""
    remount(small_disk, "ro")
    code, output, messages = clearcap_here(capsys, monkeypatch, verb, campaign_file, "--store", small_disk / "runs")
    assert (code, output) == (4, ""), messages
    assert "Read-only file system" in messages


def test_a_server_that_is_not_there(campaign_file, capsys, monkeypatch):
    """A URL that is well formed, and no answer."""
    code, _, messages = clearcap_here(capsys, monkeypatch, "run", campaign_file, "--store", "ftp://127.0.0.1:1/runs")
    assert code == 4, messages
    code, _, messages = clearcap_here(capsys, monkeypatch, "run", campaign_file, "--store", "nosuch://127.0.0.1/runs")
    assert code == 2, messages


@pytest.mark.slow
def test_report_and_pictures(small_disk, plan, capsys, monkeypatch, tmp_path):
    """A report, a trajectory and a picture that do not fit on the disk, or may not be written."""
    store = open_store(str(small_disk / "runs"))
    store.create_plan(plan)
    fill(store, plan)
    words = ["report", "--store", store.url, "--no-excel"]
    subprocess.run(["dd", "if=/dev/zero", f"of={small_disk / 'full'}"], capture_output=True, check=False)
    code, _, messages = clearcap_here(capsys, monkeypatch, *words)
    assert code == 4, messages
    assert "No space left" in messages
    for option, name in (("--trajectory", "a.h5"), ("--plot", "a.png")):
        once = ["simulate", "incline", "--set", "simulation.horizon=0.05", option, small_disk / name]
        code, _, messages = clearcap_here(capsys, monkeypatch, *once)
        assert code == 4, messages
    remount(small_disk, "ro")
    for again in (words, ["simulate", "incline", "--plot", small_disk / "a.png"]):
        code, _, messages = clearcap_here(capsys, monkeypatch, *again)
        assert code == 4, messages
        assert "Read-only" in messages


INTERRUPTED = """
import ctypes, os, signal, sys, time
from campaign.interrupts import exit_at_interrupt

@ctypes.CFUNCTYPE(None)
def callback():  # as LLVM calls Python: an exception cannot leave it
    os.kill(os.getpid(), signal.SIGINT)

with exit_at_interrupt():
    {what}
    time.sleep(60)
print("went on")
"""

PLACES = {
    "in a callback of compiled code": "callback()",
    "in plain code": "os.kill(os.getpid(), signal.SIGINT)",
    "twice": """try:
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        os.kill(os.getpid(), signal.SIGINT)""",
    "turned into another error": """try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        raise RuntimeError('compilation failed')""",
    "in code that was text": """exec("os.kill(os.getpid(), signal.SIGINT)")""",
    "in a destructor": "class A:\n        def __del__(self): callback(); time.sleep(0.2)\n    A()",
}


@pytest.mark.processes
@pytest.mark.parametrize("what", PLACES.values(), ids=PLACES)
def test_ctrl_c_anywhere(what, tmp_path):
    """Status 130 and one message, whatever code it interrupts, also of ``python -m``: not the signal as the status."""
    (tmp_path / "interrupted.py").write_text(INTERRUPTED.format(what=what))
    # with its folder in the path: what clearcap has started in this process before may keep the current one out
    words, paths = [sys.executable, "-m", "interrupted"], os.pathsep.join((str(ROOT), str(tmp_path)))
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "clearcap: interrupted\n")


AGAIN_AFTER = 0.1  # s of processor time after the first Ctrl-C, if the command lives so long


def processor_time(process):
    """Return the processor time that a process and those below it, such as the compiler, have used so far [s]."""
    own, used = psutil.Process(process.pid), 0.0
    for one in (own, *own.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            used += one.cpu_times().user
    return used


@pytest.fixture(scope="module")
def starting():
    """Return the processor time within which Python surely has started, and the command takes Ctrl-C for itself [s]."""
    code = "import campaign.interrupts, campaign.safe_path, os; print(os.times().user)"
    return 3.0 * float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize("after", [0.1, 0.3, 0.6, 1.0, 2.0, 4.0, 7.0])
def test_ctrl_c_of_the_command(after, starting, tmp_path):
    """While it imports, compiles anew, simulates: status 130, no traceback; a second Ctrl-C changes nothing."""
    command = Path(sys.executable).with_name("clearcap")
    cache = tmp_path / "compiled"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    words = [command, "simulate", "c60"]
    # A shell has its background jobs ignore Ctrl-C, and so would the command if these tests are one.
    heeds = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731
    running = subprocess.Popen(
        words, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True, preexec_fn=heeds
    )
    try:
        for used in (after, after + AGAIN_AFTER):
            until(lambda used=used: running.poll() is not None or processor_time(running) >= used, "work", pause=0.01)
            running.send_signal(signal.SIGINT)
        _, messages = running.communicate(timeout=600)
    finally:
        running.kill()
        running.wait()
    if after > starting:
        assert running.returncode == 130, messages
        assert "Traceback" not in messages
