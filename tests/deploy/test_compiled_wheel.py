"""A wheel with machine code: who can install it, what is in it, and that a fresh installation compiles nothing."""

import base64
import csv
import hashlib
import json
import os
import re
import runpy
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest
from llvmlite import binding
from packaging.tags import sys_tags
from packaging.utils import parse_wheel_filename

from engine.jit.shipped import LEVELS, SEAL

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "deploy/compiled_wheel.py"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
LEVEL = "x86-64-v3"
LARGEST_LAYER = 7e6  # bytes, unpacked; half of it in the wheel
HERE = binding.get_host_cpu_features()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return a plain wheel, made without setuptools, which would have to be fetched."""
    [name, version] = PROJECT["project"]["name"], PROJECT["project"]["version"]
    path = tmp_path_factory.mktemp("dist") / f"{name}-{version}-py3-none-any.whl"
    info = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(path, "w") as wheel:
        for package in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]:
            for file in sorted((ROOT / package.rstrip("*")).rglob("*")):
                if file.is_file() and "__pycache__" not in file.parts and "documentation" not in file.parts:
                    wheel.write(file, file.relative_to(ROOT))
        wheel.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/RECORD", "")
    return path


def test_it_is_for_one_python_and_one_system(plain, tmp_path):
    """Name and content have the tags of Numba's wheel, which pip prefers to a plain one; RECORD has every file."""
    with zipfile.ZipFile(plain) as wheel:
        wheel.extractall(tmp_path / "wheel")
    made = runpy.run_path(str(SCRIPT))["pack"](tmp_path / "wheel", tmp_path, (2026, 1, 1, 0, 0, 0))
    name, version, _, tags = parse_wheel_filename(made.name)
    assert (name, str(version)) == ("clearcap", PROJECT["project"]["version"])
    numba = re.findall(r"^Tag: (.*)$", distribution("numba").read_text("WHEEL"), re.M)
    assert {str(tag) for tag in tags} == set(numba)
    assert tags & set(sys_tags())
    with zipfile.ZipFile(made) as wheel:
        info = f"clearcap-{version}.dist-info"
        text = wheel.read(f"{info}/WHEEL").decode()
        assert re.findall(r"^Tag: (.*)$", text, re.M) == numba
        assert "Root-Is-Purelib: false\n" in text
        assert wheel.namelist()[-1] == f"{info}/RECORD"
        recorded = {row[0]: row[1:] for row in csv.reader(wheel.read(f"{info}/RECORD").decode().splitlines())}
        assert recorded.pop(f"{info}/RECORD") == ["", ""]
        assert set(recorded) == set(wheel.namelist()) - {f"{info}/RECORD"}
        for file, (digest, size) in recorded.items():
            content = wheel.read(file)
            sha256 = base64.urlsafe_b64decode(digest.removeprefix("sha256=") + "=")
            assert (sha256, int(size)) == (hashlib.sha256(content).digest(), len(content))


@pytest.mark.processes
def test_a_level_that_this_processor_has_not(plain):
    """Kernels are compiled by running them, so it is refused before anything is compiled."""
    done = subprocess.run([sys.executable, SCRIPT, plain, "x86-64-v9"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("this processor runs ")
    assert done.stderr.endswith(", not x86-64-v9\n")
    assert list(plain.parent.iterdir()) == [plain]


def test_a_release_is_for_every_python_of_the_project():
    """The versions that pyproject.toml names."""
    named = [line.rpartition(" ")[2] for line in PROJECT["project"]["classifiers"] if "Python :: 3." in line]
    assert re.search(r"^RELEASED := (.*)$", (ROOT / "Makefile").read_text(), re.M)[1].split() == named


FIRST_RUN = """
import engine
from numba.core import event
assert not engine.missing_kernels()
with event.install_recorder("numba:compile") as compiled:
    assert engine.simulate(engine.load_mechanism("c60")).status == "ok"
print(engine.__file__, len(compiled.buffer))
"""


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.skipif(not all(HERE.get(name) for name in LEVELS[LEVEL]), reason=f"needs a processor of {LEVEL}")
def test_a_fresh_installation_compiles_nothing(plain, tmp_path):
    """Neither its first run nor its first campaign; the layer is as large as it may be, and only for that level."""
    cleaned = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTHON"))}

    def output(*words, home="home", **environment):
        given = cleaned | {"HOME": str(tmp_path / home)} | environment
        return subprocess.run(words, env=given, cwd=tmp_path, check=True, stdout=subprocess.PIPE, text=True).stdout

    made = Path(output(sys.executable, SCRIPT, plain, LEVEL).splitlines()[-1])
    with zipfile.ZipFile(made) as wheel:
        layer = [file for file in wheel.infolist() if file.filename.startswith("engine/jit/layers/")]
        assert {file.filename.split("/")[3] for file in layer} == {LEVEL}
        assert sum(file.file_size for file in layer) < LARGEST_LAYER
        listed = json.loads(wheel.read(f"engine/jit/layers/{LEVEL}/{SEAL}"))["files"]
        assert len(listed) == len(layer) - 1 > 20
    output(sys.executable, "-m", "venv", "--without-pip", "venv")
    python = tmp_path / "venv/bin/python"
    [packages] = (tmp_path / "venv/lib").glob("python*/site-packages")
    (packages / "others.pth").write_text(sysconfig.get_path("purelib"))
    output(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", made)
    assert output(python, "-c", FIRST_RUN, home="new") == f"{packages}/engine/__init__.py 0\n"
    words = ["run", "c60", "--samples", "2", "--workers", "1", "--no-report", "--json", "--store", "runs"]
    assert json.loads(output(python, "-m", "clearcap", *words, home="new"))["statuses"] == {"ok": 2}
    assert list((tmp_path / "new").rglob("*.nb?")) == []
    missing = "import engine; print(len(engine.missing_kernels()) > 5)"
    assert output(python, "-c", missing, NUMBA_CPU_NAME="generic") == "True\n"
