"""The cost of dask, store and command: `clearcap run` against bare processes, and with runs that take no time.

The bare processes compute the same samples. Both are measured for two numbers of samples. The difference excludes the
start of both: imports, loading of the compiled engine, and for the command the cluster. Bare processes take the next
sample as soon as they are free, so none waits for another and no scheduler can be faster. Both are run alternately, and
the shortest time of each is used. Varying other load on the machine distorts the ratio of times; the ratio of processor
times is less affected, but does not include idle workers.
"""

import math
import os
import tempfile
from multiprocessing import get_context
from time import perf_counter
from typing import TYPE_CHECKING, Any

from benchmarks.machine import command_s, processor_s
from campaign.processes import cores

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

FEW, MANY, ROUNDS = 100, 500, 2
BATCH, STAND_INS = 50, (10_000, 100_000)  # size of a batch and numbers of runs that take no time


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
        return command_s("run", "c60", "--samples", str(samples), "--store", store, "--no-report", "--json")


def measure_overhead(batch: int = BATCH) -> dict[str, Any]:
    """Return the overhead of a run at a batch size, and the time of `clearcap status` on the rows [s]."""
    # The runs use the tests' stand-in for the engine, so everything else is measured: drawing, making rows, writing
    # parts, dask, counting. The overhead [us] is the time that a run adds; and the processor time that it adds divided
    # by the number of cores, which depends less on other load on the machine.
    from campaign.cluster.cluster import Cluster  # here, because the bare processes import this module
    from campaign.coordinator.coordinate import coordinate
    from campaign.coordinator.submit import submit
    from campaign.spec.load import load_campaign
    from campaign.store import open_store
    from tests.campaign.fake_engine import simulate

    few, many = STAND_INS
    taken, processor = dict[int, float](), dict[int, float]()
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        for samples in STAND_INS:
            store = open_store(f"{folder}/{samples}")
            plan = submit(store, load_campaign("c60", samples=samples), batch, simulate)
            start, before = perf_counter(), processor_s()
            coordinate(store, plan, Cluster(), simulate=simulate)
            taken[samples], processor[samples] = perf_counter() - start, processor_s() - before
        status = min(command_s("status", "--store", store.url, "--json") for _ in range(3))
    return {
        "workers": cores(),
        "batch": batch,
        "samples": many,
        "wall_s": taken[many],
        "overhead_us": 1e6 * (taken[many] - taken[few]) / (many - few),
        "processor_us": 1e6 * (processor[many] - processor[few]) / (many - few) / cores(),
        "status_s": status,
        "load": os.getloadavg()[0],
    }
