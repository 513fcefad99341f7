"""Waiting times at first use: import of the engine, compilation, start of a compiled run and of a campaign.

Every number is measured in a separate process; the folder of compiled code is empty where a row says first. A wheel is
a copy of the packages with compiled kernels, as `make wheel` adds them. The time of a campaign ends with its first
part; its processor time is that of all its processes until they end.
"""

import os
import resource
import runpy
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks import ROOT
from benchmarks.machine import processor_s

REPEATS = 3
SIMULATE = ("-m", "clearcap", "simulate")
RUN = ("-m", "clearcap", "run", "c60", "--samples", "20", "--no-report")
PACKAGES = ("engine", "campaign", "reporting", "clearcap")
LOOK_EVERY = 0.02  # s


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return wall and processor time of each start, and the latter as a multiple of a bare start of Python."""
    # ``unit_us`` [us], the reference of the other tables, scales the last column.
    with (
        tempfile.TemporaryDirectory(prefix="clearcap-cache-") as empty,
        tempfile.TemporaryDirectory(prefix="clearcap-cache-") as cache,
        tempfile.TemporaryDirectory(prefix="clearcap-cache-") as unused,
        tempfile.TemporaryDirectory(prefix="clearcap-wheel-") as wheel,
    ):
        for package in PACKAGES:
            shutil.copytree(ROOT / package, Path(wheel, package))
        runpy.run_path(str(ROOT / "deploy/compiled_wheel.py"))["add_layers"](Path(wheel))
        alone = _quickest("-c", "pass", cache=cache)
        # In this order: the first start of each kind leaves compiled code in the cache for the next.
        rows = {
            "python alone": alone,
            "import engine": _quickest("-c", "import engine", cache=cache),
            "clearcap --help": _quickest("-m", "clearcap", "--help", cache=cache),
            "simulate incline, first": _time(*SIMULATE, "incline", cache=cache),
            "simulate incline": _quickest(*SIMULATE, "incline", cache=cache),
            "simulate c60, first": _time(*SIMULATE, "c60", cache=cache),
            "simulate c60": _quickest(*SIMULATE, "c60", cache=cache),
            "a worker's engine": _quickest("-c", "from engine import warm_up; warm_up()", cache=cache),
            "run c60, first part, first": _time_to_first_part(empty),
            "run c60, first part": min(_time_to_first_part(cache) for _ in range(REPEATS)),
            "simulate c60, first, wheel": _quickest(*SIMULATE, "c60", cache=unused, root=wheel),
            "run c60, first part, first, wheel": min(_time_to_first_part(unused, wheel) for _ in range(REPEATS)),
        }
        if any(Path(unused).rglob("*.nbc")):
            raise RuntimeError("the wheel does not have all kernels")
    return [
        {"start": name, "wall s": wall, "cpu s": cpu, "to python": wall / alone[0], "in solves": 1e6 * wall / unit_us}
        for name, (wall, cpu) in rows.items()
    ]


def _quickest(*words: str, cache: str, root: Path | str = ROOT) -> tuple[float, float]:
    return min(_time(*words, cache=cache, root=root) for _ in range(REPEATS))


def _time(*words: str, cache: str, root: Path | str = ROOT) -> tuple[float, float]:
    """Return wall and processor time of a Python process [s]."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run([sys.executable, *words], env=_environment(cache, root), check=True, capture_output=True)
    wall, after = perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _time_to_first_part(cache: str, root: Path | str = ROOT) -> tuple[float, float]:
    """Return the wall time of a campaign until its first part, and the processor time of all its processes [s]."""
    with tempfile.TemporaryDirectory(prefix="clearcap-store-") as store:
        before, start = processor_s(), perf_counter()
        command = [sys.executable, *RUN, "--store", store]
        with subprocess.Popen(
            command, env=_environment(cache, root), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as run:
            while run.poll() is None and not any(Path(store).glob("*/parts/*.parquet")):
                time.sleep(LOOK_EVERY)
            wall = perf_counter() - start
        if run.returncode:
            raise subprocess.CalledProcessError(run.returncode, command)
        return wall, processor_s() - before


def _environment(cache: str, root: Path | str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(root), "PYTHONSAFEPATH": "1", "NUMBA_CACHE_DIR": cache}
