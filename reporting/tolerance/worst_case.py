"""Worst case over the corners of the tolerance box (paper, appendix A, eqs. 24-27)."""

from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.errors import ReportError


@dataclass(frozen=True)
class WorstCase:
    """The extremes of a response over the corners of the tolerance box; None if no corner has a value."""

    lowest: float | None  # LSL_Y of the paper (eq. 24)
    highest: float | None  # USL_Y (eq. 25)
    nominal: float | None  # mean of the two, N_Y (eq. 26)
    tolerance: float | None  # half their difference, T_Y (eq. 27)
    lowest_corner: dict[str, float]  # inputs at the extreme: each variable at an end of its range
    highest_corner: dict[str, float]
    corners: int  # simulated
    missing: int  # corners without a value
    within: bool | None  # every corner has a value and keeps the limits; None without limits


def worst_case(y: Array, inputs: dict[str, Array], lsl: float | None = None, usl: float | None = None) -> WorstCase:
    """Return the worst case of one response, NaN where it has no value; columns have the shape (n,).

    The extremes lie at corners only if the response is monotone in every input. Other samples, such as the centre, are
    included; a response that is not monotone may still have larger extremes inside the box. ReportError: the columns
    differ in length.
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
