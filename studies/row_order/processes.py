"""Processes whose values come one after the other: stable ones of several shapes, and others that are not stable."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from reporting.arrays import Array

Draw = Callable[[np.random.Generator, int], Array]


@dataclass(frozen=True)
class Process:
    """A process."""

    name: str  # row of the table
    draw: Draw  # in the order in which they are made; undisturbed values have mean 0 and sigma 1
    stable: bool = False  # an alarm would be false


def drift(total: float) -> Draw:
    """Return normal values whose mean moves evenly by `total` sigmas from the first to the last."""
    return lambda rng, n: rng.normal(size=n) + total * np.linspace(-0.5, 0.5, n)


def step(height: float) -> Draw:
    """Return normal values whose mean jumps by `height` sigmas after half of them."""
    return lambda rng, n: rng.normal(size=n) + height * (np.arange(n) >= n // 2)


def cycle(amplitude: float, periods: float) -> Draw:
    """Return normal values whose mean swings by `amplitude` sigmas to each side, `periods` times over the values."""
    return lambda rng, n: rng.normal(size=n) + amplitude * np.sin(2 * np.pi * periods * np.arange(n) / n)


def neighbours(correlation: float) -> Draw:
    """Return normal values, each correlated with the one before (first-order autoregression)."""

    def drawn(rng: np.random.Generator, n: int) -> Array:
        # The first value has sigma 1 as all others have: the process needs no time to become stationary.
        start = np.array([rng.normal() * correlation])
        shocks = rng.normal(size=n) * np.sqrt(1 - correlation**2)
        return np.asarray(lfilter([1.0], [1.0, -correlation], shocks, zi=start)[0])

    return drawn


def readjusted(shocks: Array) -> Array:
    """Return values of sigma 1 from which 0.6 of the deviation before has been taken: a moving average."""
    return np.asarray((shocks[1:] - 0.6 * shocks[:-1]) / np.hypot(1.0, 0.6))


STABLE = (
    Process("normal", lambda rng, n: rng.normal(size=n), stable=True),
    Process("lognormal (0.5)", lambda rng, n: rng.lognormal(0.0, 0.5, n), stable=True),
    Process("Student's t, 5 degrees of freedom", lambda rng, n: rng.standard_t(5, n), stable=True),
    Process("normal, rounded to half a sigma", lambda rng, n: np.round(2 * rng.normal(size=n)) / 2, stable=True),
)
UNSTABLE = (
    Process("mean drifts by 1 sigma", drift(1.0)),
    Process("mean drifts by 2 sigmas", drift(2.0)),
    Process("mean jumps by 1 sigma after half", step(1.0)),
    Process("mean swings by 0.7 sigma, five periods", cycle(0.7, 5.0)),
)
CORRELATED = {rho: Process(f"neighbours correlated by {rho}", neighbours(rho)) for rho in (0.2, 0.4, 0.6)}
ALTERNATING = (
    Process("two spindles in turn, 2 sigmas apart", lambda rng, n: rng.normal(size=n) + (-1.0) ** np.arange(n)),
    Process("readjusted by 0.6 of each deviation", lambda rng, n: readjusted(rng.normal(size=n + 1))),
)
PROCESSES = (*STABLE, *UNSTABLE, *CORRELATED.values(), *ALTERNATING)
