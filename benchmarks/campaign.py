"""What dask, the store and the command cost: `clearcap run` against bare processes that compute the same samples.

Both are measured for two numbers of samples. The difference is free of what both spend on
starting: importing, loading the compiled engine, and for the command the cluster.
"""

import os
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

from campaign.local import cores

FEW, MANY = 40, 160
ROOT = Path(__file__).parents[1]


def measure() -> dict[str, Any]:
    """Return times of both [s], and their ratios (1: the campaign costs nothing)."""
    bare, command = {}, {}
    for samples in (FEW, MANY):  # in turn: what else the machine does hits both
        bare[samples], command[samples] = _bare(samples), _command(samples)
    slope = {name: (t[MANY] - t[FEW]) / (MANY - FEW) for name, t in (("bare", bare), ("command", command))}
    return {
        "workers": cores(),
        "samples": MANY,
        "bare_s": bare[MANY],
        "command_s": command[MANY],
        "bare_sample_s": slope["bare"],
        "command_sample_s": slope["command"],
        "efficiency": slope["bare"] / slope["command"],
        "start_s": command[FEW] - FEW * slope["command"],
    }


def _bare(samples: int) -> float:
    """Compute the samples in one process a core, each its share and nothing else; return how long it took [s]."""
    spawn, start = get_context("spawn"), perf_counter()
    processes = [spawn.Process(target=_share, args=(first, samples, cores())) for first in range(cores())]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise RuntimeError("a bare process failed; its message is above")
    return perf_counter() - start


def _share(first: int, samples: int, stride: int) -> None:
    from campaign.load import load_campaign
    from campaign.plan import make_plan
    from campaign.task import sample_values
    from engine import simulate

    plan = make_plan(load_campaign("c60"))
    for sample in range(first, samples, stride):
        simulate(plan.mechanism, sample_values(plan, sample))


def _command(samples: int) -> float:
    """Return how long `clearcap run` takes for the samples, without the report [s]."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as store:
        words = ["run", "c60", "--samples", str(samples), "--store", store, "--no-report", "--json"]
        start = perf_counter()
        subprocess.run(
            [sys.executable, "-m", "campaign", *words],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            check=True,
            capture_output=True,
        )
        return perf_counter() - start
