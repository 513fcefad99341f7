"""Machine code that came with the package: for which processor and installation it is used, and what is not used."""

import json
import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

from engine.jit import shipped
from engine.jit.shipped import LEVELS, SEAL, layers, ship

ROOT = Path(__file__).parents[3]
HERE = binding.get_host_cpu_features()
LOADER = Path("/lib64/ld-linux-x86-64.so.2")
ALL = dict.fromkeys(LEVELS["x86-64-v4"], True)
KERNEL = "engine/kernels/turn.turn-7.py311"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder of layers, one for each level, with the code of two kernels."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "layers")
    for name in (f"{KERNEL}.nbi", f"{KERNEL}.1.nbc", f"{KERNEL.replace('-7', '-77')}.nbi"):
        path = tmp_path / "cache" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    for level in LEVELS:
        ship(tmp_path / "cache", level)
    return tmp_path / "layers"


@pytest.fixture
def said(caplog):
    """Return what was logged so far."""
    caplog.set_level(logging.DEBUG, logger=shipped.__name__)
    return lambda: [(record.levelname, record.getMessage()) for record in caplog.records]


def levels(processor, level=None):
    """Return the names of the layers for a processor."""
    return [layer.level for layer in layers(processor, level)]


@pytest.mark.skipif(not LOADER.exists(), reason="the loader of programs for x86-64 with glibc knows levels")
def test_levels_are_those_of_the_system():
    """The loader of programs asks the processor by itself which levels it has."""
    said = subprocess.run([LOADER, "--help"], capture_output=True, text=True, check=True).stdout
    known = dict(re.findall(r"^  (x86-64-v\d)(.*)$", said, re.M))
    if not known:
        pytest.skip("glibc before 2.33 does not say")
    here = {level for level, needed in LEVELS.items() if all(HERE.get(name) for name in needed)}
    assert here == {level for level in LEVELS if "supported" in known[level]}


def test_a_processor_runs_only_what_it_has(folder, said):
    """The best level comes first; with one instruction less the next one is used, or none."""
    assert levels(ALL | {"another": True}) == ["x86-64-v4", "x86-64-v3"]
    assert levels(ALL, "x86-64-v3") == ["x86-64-v3"]
    assert said() == []
    for name in LEVELS["x86-64-v4"]:
        assert levels(ALL | {name: False}) == [level for level, needed in LEVELS.items() if name not in needed]
    assert levels({}) == []
    assert {level for level, _ in said()} == {"DEBUG"}
    assert ("DEBUG", "no compiled code of the package for x86-64-v4 is used: the processor has no avx512vl") in said()


def test_an_installation_without_layers(tmp_path, monkeypatch, said):
    """There is nothing to be used, and nothing to be said."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    assert levels(ALL) == said() == []


@pytest.mark.parametrize("what", ["engine", "numba", "llvmlite", "numpy", "python"])
def test_code_of_another_installation(what, folder, said):
    """Other sources, libraries or another Python: one line says which."""
    path = folder / "x86-64-v4" / SEAL
    seal = json.loads(path.read_text())
    seal["compiled_from"][what] = "another"
    path.write_text(json.dumps(seal))
    assert levels(ALL) == ["x86-64-v3"]
    [(level, line)] = said()
    assert level == "DEBUG"
    assert f"for x86-64-v4 is used: {what} another there" in line


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"[]", b"{}", b'{"compiled_from": 1, "files": {}}'])
def test_a_damaged_seal(content, folder, said):
    """The layer counts for nothing, and one line says so."""
    (folder / "x86-64-v4" / SEAL).write_bytes(content)
    assert levels(ALL) == ["x86-64-v3"]
    [(level, line)] = said()
    assert level == "DEBUG"
    assert SEAL in line


@pytest.mark.parametrize("name", [f"{KERNEL}.nbi", f"{KERNEL}.1.nbc"])
@pytest.mark.parametrize("damage", ["shorter", "changed", "gone", "a folder"])
def test_a_damaged_file(name, damage, folder, said):
    """Code is used only if each of its files is as it was shipped; another kernel's is not concerned."""
    [layer] = layers(ALL, "x86-64-v3")
    assert layer.folder_of(KERNEL) == folder / "x86-64-v3/engine/kernels"
    assert layer.folder_of("engine/kernels/turn.turn-8.py311") is None
    assert said() == []
    path = folder / "x86-64-v3" / name
    content = path.read_bytes()
    path.unlink()
    if damage == "a folder":
        path.mkdir()
    elif damage != "gone":
        path.write_bytes(content[:-1] if damage == "shorter" else b"x" + content[1:])
    assert layer.folder_of(KERNEL) is None
    [(level, line)] = said()
    assert level == "DEBUG"
    assert name.rpartition("/")[2] in line
    assert layer.folder_of(KERNEL.replace("-7", "-77"))


def test_nothing_compiled_is_no_layer(folder, tmp_path):
    """As where the package has the layer already, so that nothing had to be compiled."""
    with pytest.raises(FileNotFoundError, match="nothing was compiled for x86-64-v3"):
        ship(tmp_path / "empty", "x86-64-v3")


TURN = """
import sys
from pathlib import Path
from engine.jit import CACHE_FOLDER, shipped
shipped.FOLDER = Path(sys.argv[1])
from numba.core import event
import numpy as np
from engine.jit.kept_code import index_file
from engine.kernels.vectors import rotation_matrix
known, turned = index_file(rotation_matrix.compiled)[1], np.zeros((3, 3))
with event.install_recorder("numba:compile") as compiled:
    rotation_matrix(np.array([0.5, 0.5, 0.5, 0.5]), turned)
assert turned.tolist() == [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
print(known, len(compiled.buffer) // 2, len(list(CACHE_FOLDER.rglob("*.nbc"))))
if sys.argv[2:]:
    shipped.ship(CACHE_FOLDER, sys.argv[2])
"""


@pytest.mark.processes
@pytest.mark.skipif(not all(HERE.get(name) for name in LEVELS["x86-64-v3"]), reason="needs a processor of x86-64-v3")
def test_a_kernel_from_the_package(tmp_path):
    """Nothing is compiled or written; a damaged file is as none; the user's own code comes before the package's."""
    level = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
    folder = tmp_path / "layers"

    def turned(cache, *arguments, **environment):
        """Return whether the kernel's code was there, how often a kernel was compiled, and how many files are kept."""
        given = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / cache)}
        command = [sys.executable, "-c", TURN, str(folder), *arguments]
        return subprocess.run(command, env=given | environment, check=True, stdout=subprocess.PIPE, text=True).stdout

    assert turned("made", "x86-64-v3", **level) == "False 1 1\n"
    assert turned("native") == turned("same level", **level) == "True 0 0\n"
    generic = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert turned("generic", **generic) == "False 1 1\n"
    assert turned("more features", NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="+fma") == "False 1 1\n"
    [code] = folder.rglob("*rotation_matrix*.nbc")
    code.write_bytes(code.read_bytes()[:-1])
    assert turned("native") == "False 1 1\n"
    assert turned("native") == "True 0 1\n"
