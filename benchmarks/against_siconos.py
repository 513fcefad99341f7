"""The friction solver compared with two solvers of Siconos, and three motions with its time stepping.

The solvers have the same problems and tolerance, and a cold start, in one run. The motions are a bouncing ball, a
sliding mass, and a pendulum with a stop.

Siconos is searched in the Python given by the environment variable CLEARCAP_SICONOS_PYTHON; Debian's package
`python3-siconos` installs it for /usr/bin/python3. Each solver stops by its own error measure, relative to velocities;
whether a problem is solved is decided for all solvers by clearcap's residual (`engine.friction.complementarity`).
"""

import os
import subprocess
import tempfile
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.friction import time_solver
from engine import simulate
from engine.friction import FrictionProblem, solve
from tests.engine.friction.problems import natural_map_residual, random_problem
from tests.engine.oracles.reference import recorded
from tests.engine.small import GRAVITY, coordinates, made, shipped, small

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
MOTION_SCRIPT = Path(__file__).with_name("siconos_motions.py")
STEPS = (1e-3, 1e-4)  # s
FLOOR = {"body": "ground", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}


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


def slider() -> dict[str, Any]:
    """Describe a mass that slides at 2 m/s on a floor with friction, and stops after about 1 s."""
    body = {"mass": 1.0, "inertia": [1.0] * 3, "velocity": [2.0, 0.0, 0.0]}
    contact = {"a": {"body": "mass", "point": [0.0, 0.0, 0.0]}, "b": FLOOR, "friction": 0.2}
    return _described(1.5, body, {"contacts": {"floor": contact}, "responses": {"x": coordinates("mass")["x"]}})


def pendulum() -> dict[str, Any]:
    """Describe a pendulum that swings from 1 rad against a stop at its lowest point, and bounces."""
    body = {"mass": 1.0, "inertia": [0.01] * 3, "center_of_mass": [0.0, 0.0, -1.0], "axis": [0, -1, 0], "angle": 1.0}
    sides = {"bearing": "mass", "journal": "ground"}
    pivot = {side: {"body": name, "point": [0, 0, 0], "axis": [0, 1, 0]} for side, name in sides.items()}
    stop = {"point": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}
    contact = {"a": {"body": "mass", "point": [0.0, 0.0, -1.0]}, "b": {"body": "ground", "plane": stop}}
    angle = {"type": "angle", "body": "mass", "axis": [0.0, -1.0, 0.0], "offset": 1.0}
    tables = {"joints": {"pivot": {"type": "revolute", **pivot}}, "responses": {"angle": angle}}
    return _described(3.0, body, tables | {"contacts": {"stop": contact | {"friction": 0.0, "restitution": 0.7}}})


def _described(duration: float, body: dict[str, Any], tables: dict[str, Any]) -> dict[str, Any]:
    simulation = {"horizon": duration}
    return small(
        gravity=[0, 0, -GRAVITY],
        bodies={"ground": {"fixed": True}, "mass": body},
        phases=[{"name": "motion", "duration": duration}],
        simulation=simulation,
        **tables,
    )


MOTIONS = {"bouncing_ball": lambda: shipped("bouncing_ball"), "slider": slider, "pendulum": pendulum}


def measure_motions() -> list[dict[str, Any]]:
    """Return a row for each motion and step size; if Siconos is missing, one row on how to get it."""
    if subprocess.run([PYTHON, "-c", "import siconos.kernel"], capture_output=True).returncode:
        return [{"siconos": HOW.format(python=PYTHON)}]
    return [row for step in STEPS for row in _motion_rows(step)]


def _motion_rows(step: float) -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory(prefix="clearcap-siconos-") as folder:
        target = Path(folder) / "out.npz"
        subprocess.run([PYTHON, MOTION_SCRIPT, target, str(step)], check=True, capture_output=True)
        found = dict(np.load(target))
    rows = []
    for name, describe in MOTIONS.items():
        data = describe()
        data["simulation"] = {**data["simulation"], "step": step}
        own = next(iter(recorded(data).responses.values()))[1:]
        mechanism, began = made(data), process_time()
        steps = simulate(mechanism, full_horizon=True).certificate.steps
        off = np.abs(own - found[name])
        rows.append(
            {
                "motion": name,
                "step ms": 1e3 * step,
                "largest way": float(np.ptp(own)),
                "off, largest": float(off.max()),
                "off, median": float(np.median(off)),
                "us a step": 1e6 * (process_time() - began) / steps,
                "Siconos us": float(found[f"{name}_us"]),
            }
        )
    return rows
