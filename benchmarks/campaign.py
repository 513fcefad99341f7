"""The cost of dask, store and command: `clearcap run` against bare processes that compute the same samples.

Both are measured for two numbers of samples. The difference excludes the start of both: imports, loading of the
compiled engine, and for the command the cluster. Bare processes take the next sample as soon as they are free, so none
waits for another and no scheduler can be faster. Both are run alternately, and the shortest time of each is used.
Varying other load on the machine distorts the ratio of times; the ratio of processor times is less affected, but does
not include idle workers.
"""

import math
import os
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from benchmarks.machine import processor_s
from campaign.processes import cores

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

FEW, MANY, ROUNDS = 100, 500, 2
ROOT = Path(__file__).parents[1]


def measure() -> dict[str, Any]:
    """Return times of both [s], and their ratios (1 if the campaign adds no cost)."""
    taken: dict[str, dict[int, float]] = {"bare": {}, "command": {}}
    processor: dict[str, dict[int, float]] = {"bare": {}, "command": {}}
    for samples in (FEW, MANY) * ROUNDS:  # alternately, so that other load affects both
        for name, compute in (("bare", _bare), ("command", _command)):
            before = processor_s()
            wall = compute(samples)
            taken[name][samples] = min(wall, taken[name].get(samples, math.inf))
            processor[name][samples] = min(processor_s() - before, processor[name].get(samples, math.inf))
    slope = {name: _slope(seconds) for name, seconds in taken.items()}
    busy = {name: _slope(seconds) for name, seconds in processor.items()}
    return {
        "workers": cores(),
        "samples": MANY,
        "bare_s": taken["bare"][MANY],
        "command_s": taken["command"][MANY],
        "bare_sample_s": slope["bare"],
        "command_sample_s": slope["command"],
        "efficiency": slope["bare"] / slope["command"],
        "processor_efficiency": busy["bare"] / busy["command"],
        "load": os.getloadavg()[0],
        "start_s": taken["command"][FEW] - FEW * slope["command"],
    }


def _slope(taken: dict[int, float]) -> float:
    """Return the time of one additional sample [s]."""
    return (taken[MANY] - taken[FEW]) / (MANY - FEW)


def _bare(samples: int) -> float:
    """Compute the samples in one process per core without anything else; return the time [s]."""
    spawn, start = get_context("spawn"), perf_counter()
    taken = spawn.Value("q", 0)
    processes = [spawn.Process(target=_compute, args=(taken, samples)) for _ in range(cores())]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise RuntimeError("a bare process failed; its message is above")
    return perf_counter() - start


def _compute(taken: "Synchronized[int]", samples: int) -> None:
    from campaign.plan import make_plan
    from campaign.spec.load import load_campaign
    from campaign.worker.row import sample_values
    from engine import simulate

    plan = make_plan(load_campaign("c60"))
    while (sample := _next(taken)) < samples:
        simulate(plan.mechanism, sample_values(plan, sample))


def _next(taken: "Synchronized[int]") -> int:
    """Take the next sample."""
    with taken.get_lock():
        taken.value += 1
        return taken.value - 1


def _command(samples: int) -> float:
    """Return the time of `clearcap run` for the samples, without the report [s]."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as store:
        words = ["run", "c60", "--samples", str(samples), "--store", store, "--no-report", "--json"]
        start = perf_counter()
        subprocess.run(
            [sys.executable, "-m", "clearcap", *words],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            check=True,
            capture_output=True,
        )
        return perf_counter() - start
