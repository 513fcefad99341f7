"""Mean and standard deviation of responses while a campaign runs, from the moments that each batch reports."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc


@dataclass(frozen=True)
class Moments:
    """Number, mean and sum of squared deviations of a set of values; a sum of two describes both sets together.

    The formula of Chan, Golub and LeVeque (1983) loses no digits if the mean is large.
    """

    n: int = 0
    mean: float = 0.0  # 0 if there are no values
    squares: float = 0.0  # sum of squared deviations from the mean

    def __add__(self, other: "Moments") -> "Moments":
        n = self.n + other.n
        if not self.n or not other.n:
            return self if self.n else other
        difference = other.mean - self.mean
        mean = self.mean + difference * other.n / n
        return Moments(n, mean, self.squares + other.squares + difference * difference * self.n * other.n / n)

    @property
    def std(self) -> float | None:
        """Standard deviation with divisor n - 1; None for fewer than two values."""
        return math.sqrt(self.squares / (self.n - 1)) if self.n > 1 else None


def moments(table: pa.Table, responses: Iterable[str]) -> dict[str, Moments]:
    """Return the moments of each response over the plain rows of a table; rows without a value do not count."""
    moments_of, table = {}, plain_rows(table)
    for name in responses:
        x = table[name].drop_null().to_numpy()
        mean = float(x.sum()) / x.size if x.size else 0.0
        deviations = x - mean
        moments_of[name] = Moments(x.size, mean, float((deviations * deviations).sum()))
    return moments_of


def plain_rows(table: pa.Table) -> pa.Table:
    """Return the rows drawn from the distributions themselves: all rows, except with importance sampling."""
    return table.filter(pc.field("component") == 0) if "component" in table.column_names else table


def add_moments(total: dict[str, Moments], more: dict[str, Moments]) -> None:
    """Add the moments of further rows to a total, response by response."""
    for name, m in more.items():
        total[name] = total.get(name, Moments()) + m
