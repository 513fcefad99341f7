"""Mean and spread of responses while a campaign runs, from what each batch reports."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import pyarrow as pa


@dataclass(frozen=True)
class Moments:
    """Number, mean and sum of squared deviations of values; two of them add up to that of both sets of values.

    The sum is that of Chan, Golub and LeVeque (1983), which loses no digits to large means.
    """

    n: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def __add__(self, other: "Moments") -> "Moments":
        n = self.n + other.n
        if not self.n or not other.n:
            return self if self.n else other
        apart = other.mean - self.mean
        mean = self.mean + apart * other.n / n
        return Moments(n, mean, self.squares + other.squares + apart * apart * self.n * other.n / n)

    @property
    def std(self) -> float | None:
        """Standard deviation, from n - 1; None of fewer than two values."""
        return math.sqrt(self.squares / (self.n - 1)) if self.n > 1 else None


def moments(table: pa.Table, responses: Iterable[str]) -> dict[str, Moments]:
    """Return the moments of each response of a table; rows without a value do not count."""
    found = {}
    for name in responses:
        x = table[name].drop_null().to_numpy()
        mean = float(x.sum()) / x.size if x.size else 0.0
        apart = x - mean
        found[name] = Moments(x.size, mean, float((apart * apart).sum()))
    return found


def add(total: dict[str, Moments], more: dict[str, Moments]) -> None:
    """Add moments to those there are, response by response."""
    for name, m in more.items():
        total[name] = total.get(name, Moments()) + m


def running_cpk(m: Moments, lsl: float | None, usl: float | None) -> float | None:
    """Return Cpk of the values so far; None where it is not defined."""
    if not m.std or (lsl is None and usl is None):
        return None
    sides = [usl - m.mean] if usl is not None else []
    sides += [m.mean - lsl] if lsl is not None else []
    return min(sides) / (3.0 * m.std)
