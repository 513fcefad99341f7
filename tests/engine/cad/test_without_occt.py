"""Without the extra everything else works: nothing imports OCP but the process that reads."""

import os
import subprocess
import sys

import pytest

from tests.house import ROOT, modules

pytestmark = pytest.mark.processes

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name == "OCP" or name.startswith("OCP."):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""


def run(program):
    """Run a program in a process that has no OCP; return what it prints."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", BLOCKED + program], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_block_blocks():
    """The tests below can fail."""
    with pytest.raises(AssertionError, match="No module named 'OCP'"):
        run("import OCP")


@pytest.mark.slow
def test_every_module_but_those_of_the_process_that_reads():
    """Whatever a command or a worker imports, it is none of OCP."""
    names = [name for name in modules() if not name.startswith("engine.cad.occt.") and not name.endswith("__main__")]
    assert len(names) > 300  # it finds them
    program = f"import importlib\nfor name in {names!r}: importlib.import_module(name)\n"
    assert run(program + "print([n for n in sys.modules if n.startswith('engine.cad.occt.')])").strip() == "[]"


@pytest.mark.parametrize("words", [["mechanism", "show", "lever"], ["mechanism", "list"]])
def test_commands(words):
    """They do what they do with the extra."""
    program = f"from clearcap.cli import main; sys.argv = ['clearcap', *{words!r}]; main()"
    assert "lever" in run(program)
