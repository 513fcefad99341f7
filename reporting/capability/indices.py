"""Capability indices of a mean and a standard deviation, their intervals, and their names elsewhere.

Formulas are from appendix A of the C-60 paper (eqs. 28-30, Akhadkar, Acary, Brogliato 2018) and from ISO 22514-2.
The same functions are used for the overall sigma and the sigma within production batches: only the names differ.
"""

import math
from dataclasses import dataclass

from reporting.arrays import Array
from reporting.capability.intervals import (
    Interval,
    bench,
    bench_interval,
    cc_interval,
    cp_interval,
    cpk_interval,
    cpk_joint_interval,
    one_sided_interval,
)

# Six Sigma tables add 1.5 to a long-term Z: 4.5 sigma (3.4 ppm) is called "6 sigma".
SIX_SIGMA_SHIFT = 1.5

WHICH_SIGMA = (
    "Cp and Cpk of this report use the overall standard deviation (divisor n − 1), as the paper does; AIAG and "
    "ISO 22514-2 call these Pp and Ppk, and keep Cp and Cpk for the sigma within batches."
)


@dataclass(frozen=True)
class IndexName:
    """Names and formula of one index."""

    paper: str  # name in the paper and in this report
    overall: str  # name in AIAG and ISO 22514-2 with the overall sigma
    within: str  # the same with the sigma within production batches; empty where there is none
    formula: str


NAMES = {
    "cp": IndexName("Cp", "Pp", "Cp", "(USL − LSL) / 6σ"),
    "cpk": IndexName("Cpk", "Ppk", "Cpk", "min(Cpl, Cpu)"),
    "cpl": IndexName("Cpl", "PpkL", "CpkL", "(m − LSL) / 3σ"),
    "cpu": IndexName("Cpu", "PpkU", "CpkU", "(USL − m) / 3σ"),
    "cc": IndexName("Cc", "k, signed", "k, signed", "(m − (USL + LSL)/2) / ((USL − LSL)/2)"),
    "cpm": IndexName("Cpm", "Cpm", "", "(USL − LSL) / (6 √(Σ(x − T)²/n))"),
    "z_lsl": IndexName("Z.lsl", "Z.LSL", "Z.LSL", "(m − LSL) / σ"),
    "z_usl": IndexName("Z.usl", "Z.USL", "Z.USL", "(USL − m) / σ"),
    "z_bench": IndexName("Z.bench", "Z.Bench", "Z.Bench", "−Φ⁻¹(Φ(−Z.lsl) + Φ(−Z.usl))"),
    "sigma_level": IndexName("sigma level", "sigma level", "", "Z.bench + 1.5"),
}


def distance_to_limit(mean: float, lsl: float | None, usl: float | None) -> float:
    """Return the distance from a mean to the nearer limit; negative beyond the limit, infinite without limits."""
    return min(math.inf if lsl is None else mean - lsl, math.inf if usl is None else usl - mean)


def cpk(mean: float, std: float, lsl: float | None, usl: float | None) -> float:
    """Return Cpk (eq. 29) of a mean and a standard deviation above 0; at least one limit is needed."""
    return distance_to_limit(mean, lsl, usl) / (3 * std)


def cpk_influence(deviation: Array, std: float, index: float, *, lower: bool) -> Array:
    """Return the influence of values, given by their deviations from the mean, on Cpk `index`, for any distribution.

    `std` is that of all values; `lower`: the nearer limit. The square root of the mean square of the influence over n
    is the standard error of Cpk (Huber, Ronchetti, Robust Statistics, 1.3).
    """
    influence: Array = ((1 if lower else -1) * deviation / 3 - index * (deviation**2 - std**2) / (2 * std)) / std
    return influence


def point_indices(mean: float, std: float, lsl: float | None, usl: float | None) -> dict[str, float | None]:
    """Return Cp, Cpk, Cpl, Cpu (eqs. 28, 29) and Z.lsl, Z.usl, Z.bench for `std` > 0; None where a limit is missing."""
    z_lsl = (mean - lsl) / std if lsl is not None else None
    z_usl = (usl - mean) / std if usl is not None else None
    sides = [z / 3 for z in (z_lsl, z_usl) if z is not None]
    return {
        "cpl": None if z_lsl is None else z_lsl / 3,
        "cpu": None if z_usl is None else z_usl / 3,
        "cpk": min(sides) if sides else None,
        "cp": None if lsl is None or usl is None else (usl - lsl) / (6 * std),
        "z_lsl": z_lsl,
        "z_usl": z_usl,
        "z_bench": bench(z_lsl, z_usl),
    }


def centring(mean: float | None, lsl: float | None, usl: float | None) -> float | None:
    """Return Cc (eq. 30), positive for a mean above the middle; None without a mean or a limit."""
    if mean is None or lsl is None or usl is None:
        return None
    return (mean - (usl + lsl) / 2) / ((usl - lsl) / 2)


def basic_intervals(index: dict[str, float | None], n: int, nu: float, confidence: float) -> dict[str, Interval | None]:
    """Return the intervals of Cp, Cpk, Cpl and Cpu from `n` values and a sigma with `nu` degrees of freedom."""
    cp, cpk, cpl, cpu = (index[name] for name in ("cp", "cpk", "cpl", "cpu"))
    return {
        "cp_interval": None if cp is None else cp_interval(cp, nu, confidence),
        "cpk_interval": None if cpk is None else cpk_interval(cpk, n, confidence, nu),
        "cpl_interval": None if cpl is None else one_sided_interval(cpl, n, confidence, nu),
        "cpu_interval": None if cpu is None else one_sided_interval(cpu, n, confidence, nu),
    }


def overall_intervals(
    index: dict[str, float | None], cc: float | None, n: int, confidence: float
) -> dict[str, Interval | None]:
    """Return the intervals of all indices with the overall sigma."""
    cp, cpk = index["cp"], index["cpk"]
    basic = basic_intervals(index, n, n - 1, confidence)
    joint = basic["cpl_interval"] or basic["cpu_interval"]
    if cp is not None and cpk is not None:
        joint = cpk_joint_interval(cpk, n, confidence)
    return {
        **basic,
        "cpk_interval_joint": joint,
        "cc_interval": None if cc is None or cp is None else cc_interval(cc, cp, n, confidence),
        "z_bench_interval": bench_interval(index["z_lsl"], index["z_usl"], n, confidence),
    }
