"""Whether clearcap runs with the packages of this environment: ``make oldest``, ``make newest``.

All modules are imported, two kernels are compiled and called, and a campaign of 50 samples is run to its report, with a
store and a cache of compiled code of its own.
"""

import json
import os
import pkgutil
import platform
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
OURS = ("clearcap", "engine", "campaign", "reporting")
# what our modules import only when they need it, WeasyPrint excepted, which needs libraries of the system
LATE = ("OCP", "dask_jobqueue", "dask_kubernetes.operator", "httptools", "s3fs", "uvloop", "xlsxwriter")
SAMPLES = 50


def main() -> None:
    """Print what is installed and do everything; what goes wrong ends with a traceback and exit status 1."""
    packages = asked_for()
    print(f"Python {platform.python_version()}:", ", ".join(f"{name} {version(name)}" for name in packages), flush=True)
    with TemporaryDirectory(prefix="clearcap-") as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        os.environ["PYTHONWARNINGS"] = "error:Pydantic serializer warnings:UserWarning"  # it wrote what it did not know
        print(f"{import_all()} modules are imported", flush=True)
        call_kernels()
        print("two kernels compute what they should", flush=True)
        print(run_campaign(Path(folder, "runs")))


def asked_for() -> list[str]:
    """Return the packages that pyproject.toml names for users."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = list(project["dependencies"])
    for extra, requirements in project["optional-dependencies"].items():
        asked += requirements if extra not in ("docs", "test", "dev") else []
    return sorted({re.match(r"[\w-]+", requirement)[0] for requirement in asked})


def import_all() -> int:
    """Import every module that users can import or start; return how many there are."""
    names = list(LATE)
    for package in OURS:
        modules = pkgutil.walk_packages(import_module(package).__path__, f"{package}.")
        names += [module.name for module in modules if not module.name.endswith(".__main__")]
    for name in names:
        import_module(name)
    return len(names)


def call_kernels() -> None:
    """Compile two kernels and check what they compute."""
    import numpy as np

    from engine.friction.whitening import factorise_mass
    from engine.kernels.vectors import rotation_matrix

    turned = np.zeros((3, 3))
    rotation_matrix(np.array([0.5, 0.5, 0.5, 0.5]), turned)
    assert turned.tolist() == [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    mass, factor, first = np.array([[4.0, 0.0], [6.0, 25.0]]), np.zeros((2, 2)), np.zeros(2, np.int64)
    assert factorise_mass(mass, factor, first)
    assert factor.tolist() == [[0.5, 0.0], [3.0, 0.25]]


def run_campaign(store: Path) -> str:
    """Run a small campaign of the C-60 by the command, check its end and its report, and return the verdict."""
    command = [sys.executable, "-m", "clearcap", "run", "c60", "--samples", str(SAMPLES)]
    command += ["--store", str(store), "--json"]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    result = json.loads(done.stdout)
    assert result["statuses"] == {"ok": SAMPLES}, result
    page = Path(result["report"]["html"])
    assert page.is_relative_to(store)
    assert page.stat().st_size > 100_000
    return f"{SAMPLES} of {SAMPLES} runs ok: {result['headline']}"


if __name__ == "__main__":
    main()
