"""How often the test of the order of rows raises an alarm: on stable processes, and on those that drift.

`python -m studies.row_order` prints the tables of studies/row_order.md.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from reporting.arrays import Array
from reporting.capability.row_order import row_order
from reporting.capability.summary import capability
from studies import head, show

SIZES = (30, 50, 125, 500)
STABLE_DRAWS, OTHER_DRAWS = 20_000, 2_000
LIMIT = 4.0  # sigmas from the mean, on both sides: Cpk 1.33
HEAD = head("process", *(f"{n} values" for n in SIZES))
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


def alarms(process: Process, n: int, draws: int) -> float:
    """Return the share of samples of a process that raise an alarm."""
    rng = np.random.default_rng((n, draws))
    found = (row_order(process.draw(rng, n)) for _ in range(draws))
    return sum(bool(order and order.finding) for order in found) / draws


def coverage(process: Process, n: int, draws: int) -> float:
    """Return how often the 95 % interval of Cpk contains the true value."""
    rng = np.random.default_rng((n, draws))
    intervals = (capability(process.draw(rng, n), -LIMIT, LIMIT, ordered=False).cpk_interval for _ in range(draws))
    return sum(ends is not None and ends[0] <= LIMIT / 3 <= ends[1] for ends in intervals) / draws


def lines(scale: float) -> Iterator[str]:
    """Yield the lines of both tables, with a share of the draws."""
    yield HEAD
    for process in PROCESSES:
        draws = round(scale * (STABLE_DRAWS if process.stable else OTHER_DRAWS))
        decimals = 1 if process.stable else 0
        yield f"| {process.name} | {' | '.join(f'{100 * alarms(process, n, draws):.{decimals}f} %' for n in SIZES)} |"
    yield ""
    yield HEAD
    for process in (STABLE[0], *CORRELATED.values()):
        shown = (f"{100 * coverage(process, n, round(scale * OTHER_DRAWS)):.0f} %" for n in SIZES)
        yield f"| {process.name} | {' | '.join(shown)} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="share of the draws; default: 1")
    show(lines(parser.parse_args().share))


if __name__ == "__main__":
    main()
