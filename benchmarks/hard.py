"""The friction solver on deliberately hard problems: how many it solves, and the cost of the hardest ones."""

from time import process_time
from typing import Any

import numpy as np

from benchmarks.friction import CHANGE, TOLERANCE, time_solver
from tests.engine.friction.problems import HARD_KINDS, hard_problem

SEEDS = range(10_000, 12_000)  # not the seeds used to choose the order of the solver's attempts
SIZES = ((6, 30), (31, 60), (61, 90), (91, 120))  # contacts


def measure() -> list[dict[str, Any]]:
    """Return a row for each kind of problem, for each range of the number of contacts, and for all problems.

    Processor times are used, because other load on the machine would distort the time of a problem of a few ms.
    """
    kinds, sizes, cold, warm = [], [], [], []
    for seed in SEEDS:
        problem = hard_problem(seed)
        us, steps, residual, impulses = time_solver(problem, np.zeros(problem.q.size), process_time)
        cold.append((us / 1e3, steps, residual <= TOLERANCE))
        us, steps, residual, _ = time_solver(hard_problem(seed, CHANGE), impulses, process_time)
        warm.append((us / 1e3, steps, residual <= TOLERANCE))
        kinds.append(seed % len(HARD_KINDS))
        sizes.append(problem.mu.size)
    kind, size = np.array(kinds), np.array(sizes)
    classes = {name: kind == number for number, name in enumerate(HARD_KINDS)}
    classes |= {f"{low} to {high} contacts": (low <= size) & (size <= high) for low, high in SIZES}
    classes["all"] = np.ones(len(size), bool)
    return [_row(name, np.array(cold)[there], np.array(warm)[there]) for name, there in classes.items()]


def _row(name: str, cold: np.ndarray, warm: np.ndarray) -> dict[str, Any]:
    """Summarise the (ms, steps, solved) of some problems."""
    return {
        "problems": name,
        "number": len(cold),
        "solved %": 100 * cold[:, 2].mean(),
        "steps, median": np.median(cold[:, 1]),
        "99 %": np.percentile(cold[:, 1], 99),
        "most": cold[:, 1].max(),
        "ms, median": np.median(cold[:, 0]),
        "ms, 99 %": np.percentile(cold[:, 0], 99),
        "ms, most": cold[:, 0].max(),
        "warm solved %": 100 * warm[:, 2].mean(),
        "warm steps": np.median(warm[:, 1]),
        "warm ms": np.median(warm[:, 0]),
        "warm ms, most": warm[:, 0].max(),
    }
