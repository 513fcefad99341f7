"""Phases as arrays: their durations, the events that end them, and the loads that act in them."""

from collections.abc import Sequence

import numpy as np

from engine.arrays import Array
from engine.kernels.model import Phases
from engine.mechanism.models import Mechanism
from engine.mechanism.readout import Event


def phase_arrays(mechanism: Mechanism) -> Phases:
    """Return the phases of a run, in order."""
    names, phases = list(mechanism.responses), mechanism.phases
    return Phases(
        duration=np.array([np.inf if p.duration is None else p.duration for p in phases], float),
        trigger=np.array([names.index(p.until.response) if p.until else -1 for p in phases], np.int64),
        limit=np.array([event_limit(p.until) if p.until else (0.0, 1.0) for p in phases], float),
        damping=np.array([p.damping for p in phases], float),
    )


def event_limit(event: Event) -> tuple[float, float]:
    """Return the limit of an event and its side: 1 above it, -1 below it."""
    return (event.above, 1.0) if event.above is not None else (event.below or 0.0, -1.0)


def active_phases(mechanism: Mechanism, phases: Sequence[str] | None) -> Array:
    """Return the phases in which a load or motion acts, shape (n_phase,) bool; ``phases`` None means all."""
    return np.array([phases is None or phase.name in phases for phase in mechanism.phases], bool)
