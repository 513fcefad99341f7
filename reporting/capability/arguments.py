"""Checks of limits, confidence and production batches given by a caller; other values raise `ReportError`."""

import math
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reporting.errors import ReportError


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
