"""Three motions compared with Siconos' time stepping: a bouncing ball, a sliding mass, a pendulum with a stop."""

import subprocess
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.against_siconos import HOW, PYTHON
from engine import simulate
from tests.engine.oracles.reference import recorded
from tests.engine.small import GRAVITY, coordinates, made, shipped, small

SCRIPT = Path(__file__).with_name("siconos_motions.py")
STEPS = (1e-3, 1e-4)  # s
FLOOR = {"body": "ground", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}


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


def measure() -> list[dict[str, Any]]:
    """Return a row for each motion and step size; if Siconos is missing, one row on how to get it."""
    if subprocess.run([PYTHON, "-c", "import siconos.kernel"], capture_output=True).returncode:
        return [{"siconos": HOW.format(python=PYTHON)}]
    return [row for step in STEPS for row in _rows(step)]


def _rows(step: float) -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory(prefix="clearcap-siconos-") as folder:
        target = Path(folder) / "out.npz"
        subprocess.run([PYTHON, SCRIPT, target, str(step)], check=True, capture_output=True)
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
