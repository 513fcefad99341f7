"""Cost of a tolerance: reciprocal, power and exponential laws, and tables of processes.

The continuous laws are those of the literature on tolerance allocation (Chase and Greenwood 1988, table 1): reciprocal
``a + b / t`` (Chase), reciprocal squared ``a + b / t^2`` (Spotts), reciprocal power ``a + b / t^k`` (Sutherland and
Roth), exponential ``a + b exp(-t / c)`` (Speckhart). All are convex in the square of the tolerance, so the cheapest
set is unique. A table lists the processes that can be chosen, with nothing between them.
"""

import math
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array


@dataclass(frozen=True)
class PowerLaw:
    """The cost ``fixed + cost / tolerance^power``."""

    fixed: float  # in money
    cost: float  # above 0, in money times the unit of the tolerance to the power
    power: float = 1.0  # above 0; 1 and 2 are usual

    def at(self, tolerance: Array) -> Array:
        """Return the cost of tolerances."""
        return self.fixed + self.cost * tolerance**-self.power

    def saving(self, tolerance: Array) -> Array:
        """Return the decrease of the cost per unit of tolerance, above 0."""
        return self.power * self.cost * tolerance ** (-self.power - 1)

    def fault(self) -> str:
        """Return why the law is impossible; empty if it is possible."""
        numbers_fit = math.isfinite(self.fixed) and _positive(self.cost) and _positive(self.power)
        if numbers_fit:
            return ""
        return f"cost {self.cost:g} and power {self.power:g} must be finite and above 0, fixed {self.fixed:g} finite"


@dataclass(frozen=True)
class ExponentialLaw:
    """The cost ``fixed + cost exp(-tolerance / scale)``."""

    fixed: float  # in money
    cost: float  # in money, above 0
    scale: float  # above 0, in the unit of the tolerance: one wider by `scale` reduces the exponential part by 63 %

    def at(self, tolerance: Array) -> Array:
        """Return the cost of tolerances."""
        return np.asarray(self.fixed + self.cost * np.exp(-tolerance / self.scale))

    def saving(self, tolerance: Array) -> Array:
        """Return the decrease of the cost per unit of tolerance, above 0."""
        return np.asarray(self.cost / self.scale * np.exp(-tolerance / self.scale))

    def fault(self) -> str:
        """Return why the law is impossible; empty if it is possible."""
        if math.isfinite(self.fixed) and _positive(self.cost) and _positive(self.scale):
            return ""
        return f"cost {self.cost:g} and scale {self.scale:g} must be finite and above 0, fixed {self.fixed:g} finite"


@dataclass(frozen=True)
class Process:
    """One process to make a variable: the tolerance it achieves, its cost and its name."""

    tolerance: float
    cost: float
    name: str = ""


@dataclass(frozen=True)
class ProcessTable:
    """Processes from which one is chosen."""

    processes: tuple[Process, ...]

    def at(self, tolerance: float) -> Process | None:
        """Return the cheapest process whose tolerance is at most as wide; None if there is none."""
        fine = [p for p in self.processes if p.tolerance <= tolerance * (1 + 1e-9)]
        return min(fine, key=lambda p: (p.cost, p.tolerance), default=None)

    def between(self, lower: float, upper: float) -> tuple[Process, ...]:
        """Return the processes within bounds that are not dominated (wider is cheaper), the finest first."""
        within = [p for p in self.processes if lower <= p.tolerance <= upper]
        kept: list[Process] = []
        for process in sorted(within, key=lambda p: (p.tolerance, p.cost)):
            if not kept or process.cost < kept[-1].cost:
                kept.append(process)
        return tuple(kept)

    def fault(self) -> str:
        """Return why the table is impossible; empty if it is possible."""
        if self.processes and all(_positive(p.tolerance) and math.isfinite(p.cost) for p in self.processes):
            return ""
        return "a table of processes needs at least one, each with a tolerance above 0 and a finite cost"


CostLaw = PowerLaw | ExponentialLaw | ProcessTable


def _positive(number: float) -> bool:
    """Return whether a number is finite and above 0."""
    return math.isfinite(number) and number > 0
