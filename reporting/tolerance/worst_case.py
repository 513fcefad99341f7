"""Worst case over the corners of the tolerance box (paper, appendix A, eqs. 24-27)."""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.errors import ReportError


@dataclass(frozen=True)
class WorstCase:
    """The extremes of a response over the corners of the tolerance box; None if no corner has a value.

    Attributes
    ----------
    lowest, highest : float or None
        Smallest and largest value, LSL_Y and USL_Y of the paper (eqs. 24, 25).
    nominal, tolerance : float or None
        Mean and half the difference of the two, N_Y and T_Y (eqs. 26, 27).
    lowest_corner, highest_corner : dict of str to float
        Inputs at the extremes: each variable at an end of its range.
    corners, missing : int
        Number of simulated corners, and of corners without a value.
    within : bool or None
        Whether every corner has a value and keeps the limits; None without limits.
    """

    lowest: float | None
    highest: float | None
    nominal: float | None
    tolerance: float | None
    lowest_corner: dict[str, float]
    highest_corner: dict[str, float]
    corners: int
    missing: int
    within: bool | None


def worst_case(y: Array, inputs: dict[str, Array], lsl: float | None = None, usl: float | None = None) -> WorstCase:
    """Return the worst case of one response.

    The extremes lie at corners only if the response is monotone in every input. Other samples, such as the centre, are
    included; a response that is not monotone may still have larger extremes inside the box.

    Parameters
    ----------
    y : array, shape (n,)
        The response at each sample; NaN where it has no value.
    inputs : dict of str to array, each of shape (n,)
        The variables at each sample.
    lsl, usl : float or None
        Limits.

    Raises
    ------
    ReportError
        If the columns differ in length.
    """
    y = np.asarray(y, np.float64)
    wrong = [name for name, column in inputs.items() if np.shape(column) != y.shape]
    if wrong:
        raise ReportError(
            f"worst case: {', '.join(wrong)}: differs in length from the response; give columns of one table"
        )
    rows = np.flatnonzero(np.isfinite(y))
    missing = y.size - rows.size
    limited = lsl is not None or usl is not None
    if rows.size == 0:
        return WorstCase(None, None, None, None, {}, {}, y.size, missing, False if limited else None)
    low, high = (int(rows[choose(y[rows])]) for choose in (np.argmin, np.argmax))
    lowest, highest = float(y[low]), float(y[high])
    within = (lsl is None or lowest >= lsl) and (usl is None or highest <= usl) and missing == 0
    corner = {at: {name: float(column[at]) for name, column in inputs.items()} for at in (low, high)}
    return WorstCase(
        lowest=lowest,
        highest=highest,
        nominal=0.5 * (lowest + highest),
        tolerance=0.5 * (highest - lowest),
        lowest_corner=corner[low],
        highest_corner=corner[high],
        corners=y.size,
        missing=missing,
        within=within if limited else None,
    )
