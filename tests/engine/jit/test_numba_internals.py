"""What becomes of the engine where a private name of Numba is gone: a saving is off, or the import is refused."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from engine.jit import numba_internals
from engine.jit.numba_internals import ESSENTIAL, OF_A_KERNEL, SAVINGS, SUPPORTED

ROOT = Path(__file__).parents[3]
PRIVATE = {name.rpartition(":")[2] for name in (*ESSENTIAL, *(name for names in SAVINGS.values() for name in names))}
PROGRAM = Path(__file__).with_name("without_a_name.py")


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Return, by the name that is gone, what the engine logs, what its kernel computes, or why it is not imported."""
    program = [sys.executable, "-m", "tests.engine.jit.without_a_name", str(tmp_path_factory.mktemp("cache"))]
    done = subprocess.run(program, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True, timeout=300)
    return json.loads(done.stdout)


@pytest.mark.slow
def test_nothing_is_lost_with_a_supported_numba(outcomes):
    """The kernel computes what it should, and nothing is logged."""
    assert outcomes[""] == {"logged": [], "result": (2.0 * 0.5 + 3.0 + 7.0).hex(), "missing": True}


@pytest.mark.slow
@pytest.mark.parametrize("saving", SAVINGS)
def test_a_saving_that_misses_a_name_is_off(outcomes, saving):
    """For each name: one line says what is lost and which name is gone; the kernel computes the same bits."""
    for name in SAVINGS[saving]:
        outcome = outcomes[name]
        [line] = outcome["logged"]
        assert line.startswith(saving), name
        assert name.rpartition(":")[2] in line
        assert SUPPORTED in line
        assert outcome["result"] == outcomes[""]["result"], name


@pytest.mark.parametrize("name", OF_A_KERNEL)
def test_code_on_disk_that_cannot_be_seen(outcomes, name):
    """Whatever part of the way to a kernel's index is gone: one line says so, and the kernel counts as missing."""
    for part in name.split("."):
        outcome = outcomes[part]
        [line] = outcome["logged"]
        assert line.startswith(numba_internals.INDEX)
        assert part in line
        assert outcome["missing"]
        assert outcome["result"] == outcomes[""]["result"]


@pytest.mark.parametrize("name", ESSENTIAL)
def test_what_is_essential_ends_the_import(outcomes, name):
    """The error is one of the engine's and an ImportError; it names the name and the versions that have it."""
    outcome = outcomes[name]
    assert outcome["error"] == ["UnsupportedNumbaError", "EngineError", "ImportError"]
    assert name.replace(":", ".") in outcome["message"]
    assert SUPPORTED in outcome["message"]


def test_an_array_that_is_described_otherwise(outcomes):
    """Tuples of arrays are passed by value where Numba has changed the order of an array's parts."""
    [line] = outcomes["order"]["logged"]
    assert line.startswith(numba_internals.TUPLES)
    assert outcomes["order"]["result"] == outcomes[""]["result"]


def test_the_page_lists_every_name():
    """The table at the top of the module has all names."""
    missing = {name for name in PRIVATE if f"`{name.rpartition('.')[2]}`" not in numba_internals.__doc__}
    assert missing - {"_env_reloader.reset", "_final_module.link_in"} == set()


def test_the_range_is_that_of_the_project():
    """What messages say is supported is what pip installs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    [numba] = [needed for needed in map(Requirement, project["dependencies"]) if needed.name == "numba"]
    assert str(numba.specifier) == str(Requirement(f"numba{SUPPORTED}").specifier)
    assert not numba.specifier.contains("0.69.0")
