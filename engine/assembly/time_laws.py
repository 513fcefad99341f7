"""Time laws as arrays: cubic pieces plus a sine."""

from typing import Any

import numpy as np

from engine.arrays import Array
from engine.kernels.model import TimeLaws
from engine.mechanism.models import Mechanism
from engine.mechanism.motions import Led
from engine.mechanism.time_laws import FactorSine, Law, Sine, TableLaw


def time_law_arrays(mechanism: Mechanism) -> tuple[TimeLaws, dict[str, int]]:
    """Return all time laws as arrays, and the number of each by the key of its owner, such as ``"forces.push"``."""
    owners = {
        f"{table}.{name}": entry
        for table in ("forces", "torques", "motions")
        for name, entry in getattr(mechanism, table).items()
        if entry.law is not None
    }
    laws: dict[str, Law] = {key: entry.law for key, entry in owners.items()}
    pieces = [_pieces(law) for law in laws.values()]
    rows = np.concatenate([np.zeros((0, 5)), *pieces])
    arrays = TimeLaws(
        first=np.cumsum([0, *map(len, pieces)], dtype=np.int64),
        time=rows[:, 0].copy(),
        piece=rows[:, 1:].copy(),
        sine=np.array([_sine(law) for law in laws.values()], float).reshape(-1, 3),
        since=np.array([_since(mechanism, entry) for entry in owners.values()], np.int64),
        begun=np.array([0.0, *(np.inf for _ in mechanism.phases[1:])]),
    )
    return arrays, {owner: number for number, owner in enumerate(laws)}


def _since(mechanism: Mechanism, entry: Any) -> int:
    """Return the phase at whose start a law's time begins: the named one, or the first in which a motion acts."""
    phases = [phase.name for phase in mechanism.phases]
    if entry.since is None and isinstance(entry, Led) and entry.phases:
        return min(phases.index(phase) for phase in entry.phases)
    return phases.index(entry.since or phases[0])


def _pieces(law: Law) -> Array:
    """Return the start time of each piece and its four coefficients, shape (pieces, 5)."""
    if isinstance(law, TableLaw):
        return _table(law)
    if isinstance(law, Sine):
        mean = law.mean + law.amplitude * np.sin(law.phase) if isinstance(law, FactorSine) else 0.0
        return np.array([[0.0, mean, 0.0, 0.0, 0.0]])
    # a second piece that never begins, because a law is constant from its last piece on
    return np.array([[0.0, 0.0, law.speed, 0.0, 0.0], [np.inf, 0.0, 0.0, 0.0, 0.0]])


def _table(law: TableLaw) -> Array:
    """Return the pieces of a table; a smooth one is flat at both ends, where it continues as a constant."""
    t, y = np.array(law.points).T
    rows = np.zeros((t.size, 5))
    rows[:, 0], rows[:, 1] = t, y
    if law.interpolation == "smooth":
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # 0.3 s to load

        slopes = PchipInterpolator(t, y).derivative()(t)
        slopes[[0, -1]] = 0.0
        rows[:-1, 2:] = CubicHermiteSpline(t, y, slopes).c[2::-1].T
    else:
        rows[:-1, 2] = np.diff(y) / np.diff(t)
    return rows


def _sine(law: Law) -> tuple[float, float, float]:
    """Return amplitude, angular frequency and phase; zeros for a law that is not a sine."""
    if not isinstance(law, Sine):
        return 0.0, 0.0, 0.0
    return law.amplitude, law.angular_frequency, law.phase  # type: ignore[attr-defined]
