"""The type of the report's arrays, columns at some rows, what is rounding, ranks, Gauss's points, a random order."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# The standard error of a share is below 0.002 with this many rows; more rows would not change a printed digit.
MOST_ROWS = 200_000
# Values at a time in a pass over millions of them: what is computed of so many stays in the processor's cache.
PIECE = 16_384
_FEW = 1000  # values that mostly show whether all of them vary
# A spread below this share of the largest value is rounding error: the values are a constant. A sum over some thousand
# steps loses about this many of the last bits.
ROUNDING = 1e-12


class Columns(Mapping[str, Array]):
    """Columns of a table at some of its rows; each is cut out when it is asked for, so that they are not all twice."""

    @classmethod
    def of(cls, columns: Mapping[str, ArrayLike]) -> "Columns":
        """Return columns as such, at all of their rows."""
        return columns if isinstance(columns, Columns) else cls(columns)

    def __init__(self, columns: Mapping[str, ArrayLike], rows: NDArray[np.intp] | None = None) -> None:
        self._columns = {name: np.asarray(column, np.float64) for name, column in columns.items()}
        self._rows = rows  # None: all

    def __getitem__(self, name: str) -> Array:
        """Return a column."""
        column = self._columns[name]
        return column if self._rows is None else column[self._rows]

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._columns)

    def __len__(self) -> int:
        """Return the number of columns."""
        return len(self._columns)

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a column."""
        return name in self._columns

    @property
    def sizes(self) -> set[int]:
        """Lengths of the columns; more than one if they are not of one table."""
        return {column.size if self._rows is None else self._rows.size for column in self._columns.values()}

    def take(self, name: str, rows: NDArray[np.intp]) -> Array:
        """Return a few rows of a column."""
        return self._columns[name][rows if self._rows is None else self._rows[rows]]

    def where(self, rows: NDArray[np.bool_]) -> "Columns":
        """Return the columns at the rows for which the mask is True."""
        if rows.all():
            return self
        return Columns(self._columns, np.flatnonzero(rows) if self._rows is None else self._rows[rows])

    def only(self, names: Iterable[str]) -> "Columns":
        """Return some of the columns."""
        return Columns({name: self._columns[name] for name in names}, self._rows)

    @cached_property
    def finite(self) -> NDArray[np.bool_] | None:
        """Whether all columns are finite at a row, shape (n,); None if they are at every row, or without columns."""
        known: NDArray[np.bool_] | None = None
        for column in self._columns.values():
            of_column = np.isfinite(column)
            if not of_column.all():
                known = of_column if known is None else known & of_column
        known = known if known is None or self._rows is None else known[self._rows]
        return None if known is None or known.all() else known

    @cached_property
    def varying(self) -> "Columns":
        """Return those of the columns that vary."""
        first = None if self._rows is None else self._rows[:_FEW]
        return self.only(
            [name for name, whole in self._columns.items() if _surely_varies(whole, first) or varies(self[name])]
        )


def varies(column: Array) -> bool:
    """Return whether a column varies by more than rounding errors."""
    if column.size < 2:
        return False
    return _surely_varies(column) or standard_deviation(column) > ROUNDING * magnitude(column)


def _surely_varies(column: Array, first: NDArray[np.intp] | None = None) -> bool:
    """Return whether a few of the rows, by default the first ones, already show that a column varies.

    Together with any other rows of the column they have at least a part of their own variance.
    """
    few = column[:_FEW] if first is None else column[first]
    if few.size < 2:
        return False
    return float(np.std(few)) * math.sqrt(few.size / column.size) > ROUNDING * magnitude(column)


def sums(x: Array, of: Callable[[Array], tuple[Array, ...]]) -> tuple[float, ...]:
    """Return the sums of functions of values, of many from pieces: no further column of millions is in memory."""
    found = [[float(np.sum(y)) for y in of(x[rows])] for rows in pieces(x.size)]
    return tuple(float(np.sum(each)) for each in zip(*found, strict=True))


def standard_deviation(x: Array, ddof: int = 0) -> float:
    """Return the standard deviation of more than `ddof` values, as `numpy.std` does, but of many from pieces."""
    mean = sums(x, lambda piece: (piece,))[0] / x.size
    return math.sqrt(sums(x, lambda piece: (np.square(piece - mean),))[0] / (x.size - ddof))


def magnitude(x: Array) -> float:
    """Return the largest absolute value of at least one."""
    return max(float(np.max(x)), -float(np.min(x)))


_GROWTH = 4  # moving numbers to fresh memory takes longer than reading them


class GrowingColumn:
    """Numbers that come table by table; what is reserved for further ones is no memory before they come.

    `most` numbers are expected at most, so that no more is reserved; if more come, they are stored too.
    """

    def __init__(self, kind: type[np.generic], most: int) -> None:
        self._reserved, self._size, self._most = np.empty(0, kind), 0, most

    def add(self, values: NDArray[Any]) -> None:
        """Add the numbers of a table."""
        end = self._size + values.size
        if end > self._reserved.size:
            room = min(_GROWTH * self._reserved.size, max(self._most, 2 * self._reserved.size))
            more = np.empty(max(end, room), self._reserved.dtype)
            more[: self._size] = self.array
            self._reserved = more
        self._reserved[self._size : end] = values
        self._size = end

    @property
    def array(self) -> NDArray[Any]:
        """All numbers."""
        return self._reserved[: self._size]


def pieces(n: int) -> Iterator[slice]:
    """Yield the rows of a pass over n of them: all, or of many so few at a time that they stay in the cache."""
    size = PIECE if n > MOST_ROWS else max(n, 1)
    for first in range(0, n, size):
        yield slice(first, first + size)


@lru_cache(maxsize=8)
def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return the Gauss-Legendre points and weights on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return points, weights


@lru_cache(maxsize=32)
def random_rows(n: int) -> NDArray[np.intp]:
    """Return the indices of at most 200,000 of `n` rows in random order; the order is the same for the same `n`.

    Consecutive samples of a Sobol' sequence or a grid are not independent; groups in random order represent all rows.
    """
    random = np.random.Generator(np.random.PCG64(n))
    # of many rows a few are drawn in the time of these few, not of all
    rows = random.permutation(n) if n <= MOST_ROWS else random.choice(n, MOST_ROWS, replace=False)
    rows.flags.writeable = False  # others get the same array
    return rows


def some_of(rows: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices of at most 200,000 of the rows for which a mask is True, in random order."""
    count = int(np.count_nonzero(rows))
    chosen = random_rows(count)
    if 8 * (rows.size - count) > rows.size:
        return np.flatnonzero(rows)[chosen]
    # Of nearly all rows the numbers need not be written down: those of the few others say how far each is moved.
    others = np.flatnonzero(~rows)
    return chosen + np.searchsorted(others - np.arange(others.size), chosen, side="right")


def extremes(x: Array, count: int, *, largest: bool) -> NDArray[np.intp]:
    """Return the indices of the smallest or the largest finite values in their order; of equal ones the first."""
    if x.size == 0:
        return np.zeros(0, np.intp)
    some = x[random_rows(x.size)]
    place = min(count, some.size)
    # An extreme of all values is at least as far out as the same one of some of them.
    if largest:
        far = np.flatnonzero(x >= np.partition(some, some.size - place)[some.size - place])
        return far[np.argsort(-x[far], kind="stable")][:count]
    far = np.flatnonzero(x <= np.partition(some, place - 1)[place - 1])
    return far[np.argsort(x[far], kind="stable")][:count]


def centred_ranks(values: Array) -> Array:
    """Return the ranks of finite values less their mean, shape (n,); equal values have their middle rank."""
    order = np.argsort(values)
    ordered = values[order]
    first = np.flatnonzero(np.append(True, ordered[1:] > ordered[:-1])) if values.size else np.zeros(0, np.intp)
    counts = np.diff(np.append(first, values.size))
    ranks = np.empty(values.size)
    # The middle of the ranks that equal values share; the first rank is 1.
    ranks[order] = np.repeat(first + 0.5 * (counts + 1), counts)
    return ranks - 0.5 * (values.size + 1)
