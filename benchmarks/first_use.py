"""What a newcomer waits for: importing the engine, compiling it once, and starting a run with all compiled.

Every number is of a process of its own; the folder of compiled code is empty at the first compilation.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

ROOT = Path(__file__).parents[1]
REPEATS = 3
SIMULATE = ("-m", "campaign", "simulate")


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return real and processor time of each start, and that as a multiple of starting Python alone.

    ``unit_us`` [us], the reference of the other tables, scales the last column.
    """
    with tempfile.TemporaryDirectory(prefix="clearcap-cache-") as cache:
        alone = _quickest("-c", "pass", cache=cache)
        rows = {
            "python alone": alone,
            "import engine": _quickest("-c", "import engine", cache=cache),
            "clearcap --help": _quickest("-m", "campaign", "--help", cache=cache),
            "simulate incline, first": _time(*SIMULATE, "incline", cache=cache),
            "simulate incline": _quickest(*SIMULATE, "incline", cache=cache),
            "simulate c60, first": _time(*SIMULATE, "c60", cache=cache),
            "simulate c60": _quickest(*SIMULATE, "c60", cache=cache),
        }
    return [
        {"start": name, "wall s": wall, "cpu s": cpu, "to python": wall / alone[0], "in solves": 1e6 * wall / unit_us}
        for name, (wall, cpu) in rows.items()
    ]


def _quickest(*words: str, cache: str) -> tuple[float, float]:
    return min(_time(*words, cache=cache) for _ in range(REPEATS))


def _time(*words: str, cache: str) -> tuple[float, float]:
    """Return wall and processor time of a process of Python [s]."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": cache}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True)
    wall, after = perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
