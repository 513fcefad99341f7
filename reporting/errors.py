"""The exception that reporting raises, and checks of what a caller gives, which raise it."""

import math
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ReportError(Exception):
    """The input of a report is wrong; the message names the place, the value, what is allowed and the remedy."""


def real_number(name: str, value: object) -> float:
    """Return a number as a float; raise ReportError if the value is not a real number."""
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:  # a whole number beyond the range of floats
            return math.inf
    raise ReportError(f"{name} = {value!r}: must be a number")


def finite_or_none(name: str, value: object) -> float | None:
    """Return a limit or a target as a float; None stays None."""
    number = None if value is None else real_number(name, value)
    if number is not None and not math.isfinite(number):
        raise ReportError(f"{name} = {number}: must be a finite number; use None where there is no {name}")
    return number


def check_limits(lsl: float | None, usl: float | None, confidence: float) -> None:
    """Raise ReportError if limits or confidence are impossible."""
    if lsl is not None and usl is not None:
        if lsl >= usl:
            raise ReportError(f"lsl = {lsl:.15g} is not below usl = {usl:.15g}; exchange or correct the limits")
        if not 0 < (usl - lsl) / 2 < math.inf:
            far = "far from" if usl - lsl > 1 else "close to"
            raise ReportError(f"lsl = {lsl:.15g} is too {far} usl = {usl:.15g} for double numbers; use another unit")
    if not 0 < confidence < 1:
        raise ReportError(f"confidence = {confidence}: must lie between 0 and 1; 0.95 is usual")


def series(x: ArrayLike) -> NDArray[np.float64]:
    """Return `x` as an array of floats, shape (n,); raise ReportError unless it holds a series of numbers."""
    try:
        given = np.asanyarray(x)
        if given.dtype.kind not in "biufO":
            raise TypeError(f"they are of type {given.dtype}")
        if given.dtype.kind == "O" and any(isinstance(value, str | bytes) for value in given.flat):
            raise TypeError("one is a text")
        with np.errstate(over="ignore"):  # an extended float beyond the largest double is infinite and left out
            if isinstance(given, np.ma.MaskedArray):  # a masked value is missing, like one that is not finite
                given = np.ma.filled(given.astype(np.float64), np.nan)
            values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ReportError(f"values are not numbers: {error}") from error
    if values.ndim != 1:
        raise ReportError(f"values have shape {values.shape}: a one-dimensional array of numbers is needed")
    return values


def finite_in_order(x: ArrayLike) -> NDArray[np.float64]:
    """Return the finite values in ascending order; ReportError: they are not a series of numbers."""
    values = series(x)
    is_finite = np.isfinite(values)
    values = values if is_finite.all() else values[is_finite]
    # Several methods ask for the same order: a comparison takes a fortieth of the time of sorting again.
    return values if np.all(values[1:] >= values[:-1]) else np.sort(values)


def production_batches(batches: ArrayLike | None, n: int) -> NDArray[np.generic] | None:
    """Return the production batch of each of `n` values as an array."""
    if batches is None:
        return None
    try:
        if isinstance(batches, np.ma.MaskedArray):
            raise TypeError("some are masked")
        groups = np.asarray(batches)
        np.unique(groups)
    except (TypeError, ValueError) as error:
        raise ReportError(f"batches are not numbers or names that can be ordered: {error}") from error
    if groups.shape != (n,):
        raise ReportError(f"batches have shape {groups.shape}: one batch for each of the {n} values is needed")
    return groups
