"""The friction solver on generated problems: cold start, and start from the solution of a neighbouring problem.

The hard problems combine all known difficulties.
"""

from collections.abc import Callable
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from benchmarks.machine import quickest_us
from engine.friction import FrictionProblem, solve
from engine.friction.problem import solver_arrays
from engine.friction.solver import solve_friction
from tests.engine.friction.problems import HARD_KINDS, hard_problem, random_problem

CONTACTS = (6, 12, 24, 48, 70)
KINDS = ("static", "moving")
SEEDS = range(8)
CHANGE = 0.01  # relative change of the velocities from one problem to its neighbour
TOLERANCE = 1e-8
HARD_SEEDS = range(10_000, 12_000)  # not the seeds used to choose the order of the solver's attempts
SIZES = ((6, 30), (31, 60), (61, 90), (91, 120))  # contacts of hard problems


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return a row for each kind of problem and number of contacts; ``unit_us`` is the reference [us]."""
    return [_row(kind, contacts, unit_us) for kind in KINDS for contacts in CONTACTS]


def _row(kind: str, contacts: int, unit_us: float) -> dict[str, Any]:
    problems = [random_problem(seed, contacts, kind=kind) for seed in SEEDS]
    cold = [time_solver(problem, np.zeros(3 * contacts)) for problem in problems]
    warm = [time_solver(_neighbour(problem), solve(problem, TOLERANCE).r) for problem in problems]
    return {
        "kind": kind,
        "contacts": contacts,
        "cold us": median(us for us, *_ in cold),
        "in solves": median(us for us, *_ in cold) / unit_us,
        "slowest us": max(us for us, *_ in cold),
        "iterations": median(n for _, n, *_ in cold),
        "warm us": median(us for us, *_ in warm),
        "warm iterations": median(n for _, n, *_ in warm),
        "solved": f"{sum(residual <= TOLERANCE for _, _, residual, _ in cold + warm)} of {len(cold + warm)}",
    }


def _neighbour(problem: FrictionProblem) -> FrictionProblem:
    """Return a neighbouring problem: the free velocities of the bodies are changed by a hundredth."""
    change = problem.H @ np.random.default_rng(0).standard_normal(problem.M.shape[0])
    change *= CHANGE * np.linalg.norm(problem.q) / np.linalg.norm(change)
    return FrictionProblem(problem.M, problem.H, problem.q + change, problem.mu)


def measure_hard() -> list[dict[str, Any]]:
    """Return a row for each kind of problem, for each range of the number of contacts, and for all problems."""
    # Processor times are used, because other load on the machine would distort the time of a problem of a few ms.
    kinds, sizes, cold, warm = [], [], [], []
    for seed in HARD_SEEDS:
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
    return [_hard_row(name, np.array(cold)[there], np.array(warm)[there]) for name, there in classes.items()]


def _hard_row(name: str, cold: np.ndarray, warm: np.ndarray) -> dict[str, Any]:
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


def time_solver(
    problem: FrictionProblem, start: np.ndarray, clock: Callable[[], float] = perf_counter
) -> tuple[float, int, float, np.ndarray]:
    """Return time [us], iterations and residual of the bare compiled solver, and the impulses."""
    nc = problem.mu.size
    arrays, _ = solver_arrays(problem)
    arrays.q[:], arrays.mu[:] = problem.q.reshape(nc, 3), problem.mu

    def begin() -> None:
        arrays.r[:] = start.reshape(nc, 3)

    begin()
    _, iterations, residual = solve_friction(nc, arrays, TOLERANCE)
    us = quickest_us(lambda: solve_friction(nc, arrays, TOLERANCE), begin, 5, clock)
    return us, iterations, residual, arrays.r.ravel().copy()
