"""Two campaigns side by side: what differs, by how much, and whether chance explains it.

Means: Welch's t. Standard deviations: their ratio, with Levene's test around the medians (Brown, Forsythe 1974), which
holds for any distribution, beside the F test, which needs normal ones. Whole distributions: Mann and Whitney's test.
With 30,000 samples everything differs "significantly"; so each comes with its size.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, ndtr, ndtri, stdtr, stdtrit

from reporting.arrays import Array
from reporting.capability.intervals import Interval
from reporting.capability.moments import ROUNDING
from reporting.capability.summary import Capability, capability
from reporting.errors import ReportError
from reporting.samples import Samples
from reporting.shape.histogram import Histogram, histogram
from reporting.spec import ReportSpec, ResponseSpec

# Cohen's (1988) words for d; below the first the difference is of no use to anybody.
NEGLIGIBLE, SMALL, MEDIUM = 0.2, 0.5, 0.8


@dataclass(frozen=True)
class ResponseComparison:
    """One response in this campaign and in the other; None where a number is undefined.

    Attributes
    ----------
    response, unit : str
    n, n_other : int
        Values.
    capability, capability_other : Capability
        Each against its own campaign's limits.
    mean_difference, mean_interval : float, (float, float)
        This less the other, in the response's unit (Welch).
    t_p : float
        Of Welch's test of equal means.
    effect : float
        Cohen's d: the difference in pooled standard deviations.
    effect_word : str
        "negligible", "small", "medium", "large".
    std_ratio, std_ratio_interval : float, (float, float)
        This over the other; from kurtosis and n, for any distribution with a fourth moment.
    f_p, levene_p : float
        Of the F test and of Brown and Forsythe's.
    superiority : float
        Probability that a sample of this campaign lies above one of the other; 0.5 where nothing differs.
    mann_whitney_p : float
    cpk_difference, cpk_interval : float, (float, float)
        This less the other (delta method).
    histogram, histogram_other : Histogram or None
        Both with the same edges.
    notes : tuple of str
        Why numbers are None, and what to mind.
    """

    response: str
    unit: str
    n: int
    n_other: int
    capability: Capability
    capability_other: Capability
    mean_difference: float | None = None
    mean_interval: Interval | None = None
    t_p: float | None = None
    effect: float | None = None
    effect_word: str = ""
    std_ratio: float | None = None
    std_ratio_interval: Interval | None = None
    f_p: float | None = None
    levene_p: float | None = None
    superiority: float | None = None
    mann_whitney_p: float | None = None
    cpk_difference: float | None = None
    cpk_interval: Interval | None = None
    histogram: Histogram | None = None
    histogram_other: Histogram | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Comparison:
    """A campaign against another.

    Attributes
    ----------
    campaign, title : str
        The other one.
    samples, failed : int
        Its finished samples, and those without a result.
    responses : tuple of ResponseComparison
        Those that both have, in this campaign's order.
    only_here, only_there : tuple of str
        Responses that one of them has not.
    """

    campaign: str
    title: str
    samples: int
    failed: int
    responses: tuple[ResponseComparison, ...]
    only_here: tuple[str, ...]
    only_there: tuple[str, ...]


def compare(
    samples: Samples, spec: ReportSpec, other: Samples, other_spec: ReportSpec, confidence: float
) -> Comparison:
    """Compare two campaigns, response by response.

    Raises
    ------
    ReportError
        They have no response in common, or a response has another unit in the other campaign.
    """
    theirs = {r.name: r for r in other_spec.responses}
    shared = [(r, theirs[r.name]) for r in spec.responses if r.name in theirs]
    if not shared:
        raise ReportError(
            f"{spec.campaign} and {other_spec.campaign} have no response in common; compare campaigns of one mechanism"
        )
    for mine, their in shared:
        if mine.unit != their.unit:
            raise ReportError(f"response {mine.name}: unit {mine.unit} here, {their.unit} in {other_spec.campaign}")
    return Comparison(
        campaign=other_spec.campaign,
        title=other_spec.title,
        samples=other.sample.size,
        failed=int(np.count_nonzero(~other.ok)),
        responses=tuple(_response(mine, their, samples, other, confidence) for mine, their in shared),
        only_here=tuple(r.name for r in spec.responses if r.name not in theirs),
        only_there=tuple(name for name in theirs if name not in {r.name for r in spec.responses}),
    )


def _response(
    mine: ResponseSpec, their: ResponseSpec, samples: Samples, other: Samples, confidence: float
) -> ResponseComparison:
    """Compare one response."""
    a, b = (s.values[mine.name][s.ok] for s in (samples, other))
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    notes = []
    if (mine.lsl, mine.usl) != (their.lsl, their.usl):
        notes.append("The campaigns have other limits: each index is against its own.")
    base = ResponseComparison(
        mine.name, mine.unit, a.size, b.size,
        capability(a, mine.lsl, mine.usl, mine.target, confidence),
        capability(b, their.lsl, their.usl, their.target, confidence),
    )  # fmt: skip
    fields: dict[str, object] = {}
    if a.size < 2 or b.size < 2:
        notes.append("Fewer than two values on a side: nothing to compare.")
    elif not (_varies(a) and _varies(b)):
        notes.append("A side does not vary: nothing to test.")
        fields = {"mean_difference": float(a.mean() - b.mean())}
    else:
        fields = {**_means(a, b, confidence), **_spreads(a, b, confidence), **_order(a, b)}
        fields |= _indices(a, b, base, confidence)
    if a.size and b.size:
        whole = histogram(np.concatenate([a, b]), mine.lsl, mine.usl)
        edges = np.asarray(whole.edges if whole else (0.0, 1.0))
        for name, values in (("histogram", a), ("histogram_other", b)):
            fields[name] = Histogram(tuple(edges.tolist()), tuple(np.histogram(values, edges)[0].tolist()))
    return ResponseComparison(**{**vars(base), **fields, "notes": tuple(notes)})  # type: ignore[arg-type]


def _varies(x: Array) -> bool:
    return float(np.std(x)) > ROUNDING * float(np.max(np.abs(x)))


def _means(a: Array, b: Array, confidence: float) -> dict[str, object]:
    """Return difference, interval, test and size of the means."""
    parts = [float(np.var(x, ddof=1)) / x.size for x in (a, b)]
    error = math.sqrt(sum(parts))
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (a.size - 1) + parts[1] ** 2 / (b.size - 1))
    difference = float(a.mean() - b.mean())
    half = float(stdtrit(freedom, 0.5 + confidence / 2)) * error
    pooled = math.sqrt(((a.size - 1) * parts[0] * a.size + (b.size - 1) * parts[1] * b.size) / (a.size + b.size - 2))
    effect = difference / pooled
    words = ((NEGLIGIBLE, "negligible"), (SMALL, "small"), (MEDIUM, "medium"))
    return {
        "mean_difference": difference,
        "mean_interval": (difference - half, difference + half),
        "t_p": 2 * float(stdtr(freedom, -abs(difference) / error)),
        "effect": effect,
        "effect_word": next((word for bar, word in words if abs(effect) < bar), "large"),
    }


def _spreads(a: Array, b: Array, confidence: float) -> dict[str, object]:
    """Return ratio, interval and tests of the standard deviations."""
    s, other = float(np.std(a, ddof=1)), float(np.std(b, ddof=1))
    errors = [math.sqrt(max(float(np.mean(((x - x.mean()) / x.std()) ** 4)) - 1, 0.0) / (4 * x.size)) for x in (a, b)]
    half = float(ndtri(0.5 + confidence / 2)) * math.hypot(*errors)
    ratio, nu, nu_other = s / other, a.size - 1, b.size - 1
    tail = float(betainc(nu / 2, nu_other / 2, nu * ratio**2 / (nu * ratio**2 + nu_other)))
    off, off_other = np.abs(a - np.median(a)), np.abs(b - np.median(b))
    t = off.mean() - off_other.mean()
    pooled = (off.var() * a.size + off_other.var() * b.size) / (a.size + b.size - 2) * (1 / a.size + 1 / b.size)
    return {
        "std_ratio": ratio,
        "std_ratio_interval": (ratio * math.exp(-half), ratio * math.exp(half)),
        "f_p": 2 * min(tail, 1 - tail),
        "levene_p": 2 * float(stdtr(a.size + b.size - 2, -abs(t) / math.sqrt(pooled))) if pooled > 0 else None,
    }


def _order(a: Array, b: Array) -> dict[str, object]:
    """Return Mann and Whitney's probability of superiority and test, ties counted half."""
    ordered = np.sort(b)
    below, up_to = np.searchsorted(ordered, a, "left"), np.searchsorted(ordered, a, "right")
    n, m = a.size, b.size
    share = float(np.mean(0.5 * (below + up_to))) / m
    ties = np.unique(np.concatenate([a, b]), return_counts=True)[1].astype(np.float64)
    total = n + m
    variance = n * m / 12 * (total + 1 - float(np.sum(ties**3 - ties)) / (total * (total - 1)))
    z = max(abs(share - 0.5) * n * m - 0.5, 0.0) / math.sqrt(variance) if variance > 0 else 0.0
    return {"superiority": share, "mann_whitney_p": min(2 * float(ndtr(-z)), 1.0)}


def _indices(a: Array, b: Array, base: ResponseComparison, confidence: float) -> dict[str, object]:
    """Return the difference of Cpk and its interval."""
    mine, their = base.capability.cpk, base.capability_other.cpk
    if mine is None or their is None:
        return {}
    errors = []
    for x, c in ((a, base.capability), (b, base.capability_other)):
        off, std, cpk = x - x.mean(), float(np.std(x)), c.cpk or 0.0
        sign = 1 if c.cpu is None or (c.cpl is not None and c.cpl <= c.cpu) else -1
        influence = (sign * off / 3 - cpk * (off**2 - std**2) / (2 * std)) / std
        errors.append(math.sqrt(float(np.mean(influence**2)) / x.size))
    half = float(ndtri(0.5 + confidence / 2)) * math.hypot(*errors)
    return {"cpk_difference": mine - their, "cpk_interval": (mine - their - half, mine - their + half)}
