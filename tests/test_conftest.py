"""What holds for all tests."""

import gc
import os
import subprocess
import sys

import pytest

from tests.conftest import LONGEST, TESTS

TWO_TESTS = """\
import pathlib
import pytest

pytestmark = pytest.mark.filterwarnings("ignore")

def fails_once(name):
    path = pathlib.Path(__file__).with_name(name)
    before = path.exists()
    path.touch()
    assert before

@pytest.mark.processes
def test_with_a_process():
    fails_once("one")

def test_with_none():
    fails_once("other")
"""


def test_the_longest_files_are_where_they_are_said_to_be():
    """A file that was moved would no longer start first."""
    assert [path for path in LONGEST if not (TESTS / path).exists()] == []


def test_garbage_is_looked_for_again_after_collection():
    """What was there by then is not looked at any more."""
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


@pytest.mark.processes
@pytest.mark.parametrize(
    ("reruns", "failed"), [("1", {"test_with_none"}), ("", {"test_with_none", "test_with_a_process"})]
)
def test_a_flaky_test_of_processes_is_named(tmp_path, reruns, failed):
    """Only a test that starts processes is run again, and only where that is asked for; the summary names it."""
    (tmp_path / "test_two.py").write_text(TWO_TESTS)
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("CI", "PYTEST", "CLEARCAP"))}
    environment |= {"CLEARCAP_RERUNS": reruns} if reruns else {}
    command = [sys.executable, "-m", "pytest", "-c", os.devnull, "-q", "-rA", "-p", "tests.conftest", "test_two.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert {line.split()[1].split("::")[1] for line in lines if line.startswith("FAILED")} == failed, done.stdout
    flaky = [lines[i + 1] for i, line in enumerate(lines) if "flaky: " in line]
    assert flaky == (["test_two.py::test_with_a_process"] if reruns else [])
