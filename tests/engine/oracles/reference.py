"""Tables of reference data, and runs recorded at every step."""

import gzip
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine import Trajectory, read_trajectory, simulate
from tests.engine.small import made

Array = NDArray[np.float64]


def table(name: str) -> dict[str, Array]:
    """Return a table of `data`, a column for each name."""
    with gzip.open(Path(__file__).parent / "data" / f"{name}.csv.gz", "rt", encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        return dict(zip(names, np.loadtxt(file, delimiter=",").T, strict=True))


def recorded(data: dict[str, Any], step: float | None = None) -> Trajectory:
    """Simulate a description to its horizon, which it must reach, and return the motion."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        run = simulate(made(data), step=step, full_horizon=True, trajectory=path)
        assert run.status == "ok", run.message
        return read_trajectory(path)


def at(run: Trajectory, times: Array, values: Array) -> Array:
    """Return the rows of ``values`` at recorded instants that are among the ``times``."""
    rows = np.searchsorted(run.time, times - 1e-9)
    np.testing.assert_allclose(run.time[rows], times, rtol=0, atol=1e-9)
    return np.asarray(values[rows])


def order(steps: list[float], errors: list[float]) -> float:
    """Return the order at which errors vanish with the step: the slope in logarithms, by least squares."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
