"""Where compiled code is kept, and what happens where it cannot be."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from engine.jit import Kernel

pytestmark = pytest.mark.processes

ROOT = Path(__file__).parents[3]
PRINT = "from engine.jit import decorators; print(decorators.numba.config.CACHE_DIR, flush=True)"
PRINT_TWICE = f"{PRINT}; import subprocess, sys; subprocess.run([sys.executable, '-c', {PRINT!r}], check=True)"


def run(code, tmp_path, **environment):
    """Run Python with a home and a temporary folder of its own."""
    for name in ("home", "temporary"):
        (tmp_path / name).mkdir(exist_ok=True)
    given = {"PYTHONPATH": str(ROOT), "HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "temporary")}
    words = [sys.executable, "-c", code]
    return subprocess.run(words, env=given | environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, "home/.cache/clearcap/numba"),
        ({"XDG_CACHE_HOME": "xdg"}, "xdg/clearcap/numba"),
        ({"XDG_CACHE_HOME": "xdg", "NUMBA_CACHE_DIR": "named"}, "named"),
    ],
)
def test_folder(environment, expected, tmp_path):
    """NUMBA_CACHE_DIR names it, or it is below XDG_CACHE_HOME or the home."""
    environment = {name: str(tmp_path / path) for name, path in environment.items()}
    done = run(PRINT, tmp_path, **environment)
    folder = Path(done.stdout.strip())
    assert folder.parent == tmp_path / expected, done.stderr
    assert folder.stat().st_mode & 0o777 == 0o700


def test_each_kind_of_processor_has_its_own_folder(tmp_path):
    """Machines of two kinds that share a home do not run each other's code."""
    here = Path(run(PRINT, tmp_path).stdout.strip())
    other = Path(run(PRINT, tmp_path, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="").stdout.strip())
    assert other.parent == here.parent == tmp_path / "home/.cache/clearcap/numba"
    assert other != here


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["open to all", "a file", "no home"])
def test_a_temporary_folder(fault, open_folder):
    """Where the usual folder is not to be used, one message says why; child processes share it, and it is removed."""
    home = open_folder / "home" if fault != "no home" else Path("/dev/null")
    if fault != "no home":
        home.mkdir()
    if fault == "a file":
        (home / ".cache").touch()
    elif fault == "open to all":
        home.chmod(0o777)
    done = run(PRINT_TWICE, open_folder, HOME=str(home))
    first, second = done.stdout.splitlines()
    assert first == second, done.stderr
    assert Path(first).parents[1] == open_folder / "temporary"
    assert done.stderr.count("compiled code is not kept") == done.stderr.count("\n") == 1
    assert str(home) in done.stderr
    assert os.listdir(open_folder / "temporary") == []


def test_a_folder_that_is_named_but_cannot_be_used(tmp_path):
    """It is an error that names the variable, the reason and the remedy."""
    (tmp_path / "file").touch()
    command = "import clearcap.cli, sys; sys.argv = ['clearcap', 'simulate', 'incline']; clearcap.cli.main()"
    done = run(command, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "file"))
    assert done.returncode == 2
    assert done.stderr.startswith(f"clearcap: error: NUMBA_CACHE_DIR={tmp_path}/file: clearcap does not run")
    assert "Name a folder in which only you can write" in done.stderr
    assert "Traceback" not in done.stderr


def test_no_unchecked_folder(tmp_path):
    """Numba looks nowhere else for compiled code."""
    done = run("from engine.jit import decorators; print(decorators.numba.config.CACHE_LOCATOR_CLASSES)", tmp_path)
    assert done.stdout == "engine.jit.kept_code.BuildLocator\n"


@pytest.mark.slow
def test_installations_of_a_build_share_compiled_code(tmp_path):
    """A copy of the engine in another folder loads what the first one has compiled; a changed copy compiles."""
    shutil.copytree(ROOT / "engine", tmp_path / "copy/engine")
    shutil.copytree(ROOT / "engine", tmp_path / "changed/engine")
    with (tmp_path / "changed/engine/arrays.py").open("a") as source:
        source.write("# another build\n")
    turn = (
        "import numpy as np; from engine.kernels.vectors import rotation_matrix as turn;"
        " turn(np.array([1.0, 0, 0, 0]), np.zeros((3, 3))); from engine.jit import decorators;"
        " print(sum(turn.compiled.stats.cache_hits.values()), decorators.__file__)"
    )
    places = (ROOT, tmp_path / "copy", tmp_path / "changed")
    hits = [run(turn, tmp_path, PYTHONPATH=str(place), PYTHONSAFEPATH="1").stdout for place in places]
    assert hits == [
        f"{count} {place}/engine/jit/decorators.py\n" for count, place in zip((0, 1, 0), places, strict=True)
    ]


def test_loaded_code_needs_nothing_of_the_compiler(tmp_path):
    """A kernel is loaded without what Numba compiles with, and without SciPy's algebra; then another compiles."""
    kernels = tmp_path / "kernels.py"
    kernels.write_text(
        "import numpy as np\nfrom engine.jit import inner, kernel\n"
        "@inner\ndef added(x):\n    return np.sum(x)\n"
        "@kernel\ndef size(x):\n    return added(x)\n"
        "@kernel\ndef product(x):\n    return np.dot(x, x)\n"
    )
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import numpy as np; import kernels;"
        " x = np.array([3.0, 4.0]); print(kernels.size(x), sum(kernels.size.compiled.stats.cache_hits.values()));"
        " print(sorted({'numba.cpython.listobj', 'numba.typed.typeddict', 'scipy.linalg'} & {*sys.modules}),"
        " 'compiled' in vars(kernels.added));"
        " print(kernels.product(x))"
    )
    first, second = (run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for _ in range(2))
    assert first.stdout.splitlines()[::2] == ["7.0 0", "25.0"], first.stderr
    assert second.stdout == "7.0 1\n[] False\n25.0\n", second.stderr


def test_a_kernel_is_prepared_once_for_each_variant():
    """A variant is known when its first call has ended: whoever comes before that waits, too."""
    prepared, asked = Kernel(lambda number: number), []
    prepared.compiled = asked.append

    def during():
        if len(asked) == 0:
            asked.append("within")
            prepared.prepare("mesh", lambda: ("another thread",))
        return ("first",)

    prepared.prepare("mesh", during)
    prepared.prepare("mesh", lambda: ("too late",))
    prepared.prepare("none", lambda: ("other variant",))
    assert asked == ["within", "another thread", "first", "other variant"]
