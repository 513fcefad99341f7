"""The friction solver compared with two solvers of Siconos: same problems, same tolerance, cold start, in one run.

Siconos is searched in the Python given by the environment variable CLEARCAP_SICONOS_PYTHON; Debian's package
`python3-siconos` installs it for /usr/bin/python3. Each solver stops by its own error measure, relative to velocities;
whether a problem is solved is decided for all solvers by clearcap's residual (`engine.friction.complementarity`).
"""

import os
import subprocess
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.friction import time_solver
from engine.friction import FrictionProblem, solve
from tests.engine.friction.problems import natural_map_residual, random_problem

PYTHON = os.environ.get("CLEARCAP_SICONOS_PYTHON", "/usr/bin/python3")
HOW = (
    "not measured: {python} has no siconos.numerics. On Debian and Ubuntu: apt install python3-siconos; elsewhere name "
    "a Python that has it in CLEARCAP_SICONOS_PYTHON"
)
SCRIPT = Path(__file__).with_name("siconos_solvers.py")
SOLVERS = ("NSGS", "NSN_AC")
CONTACTS = (6, 12, 24, 48)
KINDS = ("static", "moving")
SEEDS = range(4)
TOLERANCE, SOLVED, REPEATS = 1e-8, 1e-6, 3


def measure() -> list[dict[str, Any]]:
    """Return a row for each kind of problem and number of contacts; if Siconos is missing, one row on how to get it."""
    if subprocess.run([PYTHON, "-c", "import siconos.numerics"], capture_output=True).returncode:
        return [{"siconos": HOW.format(python=PYTHON)}]
    return [_row(kind, contacts) for kind in KINDS for contacts in CONTACTS]


def _row(kind: str, contacts: int) -> dict[str, Any]:
    problems = [random_problem(seed, contacts, kind=kind) for seed in SEEDS]
    own = [time_solver(problem, np.zeros(3 * contacts))[0] for problem in problems]
    found = solve_with_siconos(problems)
    row = {"kind": kind, "contacts": contacts, "clearcap us": median(own)}
    row["solved"] = _count(natural_map_residual(problem, solve(problem, TOLERANCE).r) for problem in problems)
    for name in SOLVERS:
        times = [float(found[f"{name}_us{i}"]) for i in range(len(problems))]
        row[f"{name} us"] = median(times)
        row[f"{name} ratio"] = median(a / b for a, b in zip(times, own, strict=True))
        row[f"{name} solved"] = _count(
            natural_map_residual(problem, found[f"{name}_r{i}"]) for i, problem in enumerate(problems)
        )
    return row


def solve_with_siconos(problems: list[FrictionProblem]) -> dict[str, np.ndarray]:
    """Solve the problems with Siconos in its own Python; see `siconos_solvers.main`."""
    arrays: dict[str, Any] = {"count": len(problems)}
    for i, problem in enumerate(problems):
        # Siconos' solvers take the problem reduced to the contacts; the reduction is not in their times.
        arrays[f"W{i}"] = problem.H @ np.linalg.solve(problem.M, problem.H.T)
        arrays[f"q{i}"], arrays[f"mu{i}"] = problem.q, problem.mu
    with tempfile.TemporaryDirectory(prefix="clearcap-siconos-") as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(source, **arrays)
        subprocess.run([PYTHON, SCRIPT, source, target, str(TOLERANCE), str(REPEATS)], check=True, capture_output=True)
        return dict(np.load(target))


def _count(residuals: Any) -> str:
    """Return how many of the residuals belong to a solution, as text."""
    judged = [bool(residual <= SOLVED) for residual in residuals]
    return f"{sum(judged)} of {len(judged)}"
