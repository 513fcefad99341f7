"""The reference, the time of one dense solve on this machine; and a description of the machine."""

import os
import platform
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks import ROOT

UNKNOWNS = 42


def quickest_us(
    call: Callable[[], object],
    before: Callable[[], object] = lambda: None,
    repeats: int = 20,
    clock: Callable[[], float] = perf_counter,
) -> float:
    """Return the shortest of several times of ``call`` [us]; ``before`` is called before each and not timed."""
    best = np.inf
    for _ in range(repeats):
        before()
        start = clock()
        call()
        best = min(best, clock() - start)
    return 1e6 * best


def solve_us() -> float:
    """Return the time of `numpy.linalg.solve` with 42 unknowns [us]."""
    rng = np.random.default_rng(1)
    A, b = rng.standard_normal((UNKNOWNS, UNKNOWNS)) + UNKNOWNS * np.eye(UNKNOWNS), rng.standard_normal(UNKNOWNS)
    return quickest_us(lambda: np.linalg.solve(A, b), repeats=500)


def processor_s() -> float:
    """Return the processor time of this process and of its finished child processes [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def command_s(*words: str) -> float:
    """Return the time of the command `clearcap` with these words, the start of its process included [s]."""
    start, environment = perf_counter(), {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-m", "clearcap", *words], env=environment, check=True, capture_output=True)
    return perf_counter() - start


def most_memory_mib() -> float:
    """Return the peak memory of this process [MiB]; NaN if the system does not report it."""
    # `resource.getrusage` would include the memory that the parent process had when it started this one.
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), np.nan)


def description() -> dict[str, Any]:
    """Return a description of the machine used for the measurement."""
    from campaign.processes import cores
    from engine import build_id

    return {
        "processor": platform.processor() or platform.machine(),
        "cores": cores(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "engine_build": build_id(),
        "solve_42_us": solve_us(),
    }
