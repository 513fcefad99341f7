"""Two campaigns side by side: what differs, by how much, and whether chance explains it.

Means are compared by Welch's t. Standard deviations are compared by their ratio and by Levene's test around the medians
(Brown, Forsythe 1974), which holds for any distribution, beside the F test, which needs normal ones; distributions by
the test of Mann and Whitney. With 30,000 samples every difference is significant, so each is given with its size.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, ndtri

from reporting.arrays import Array
from reporting.capability.indices import cpk_influence
from reporting.capability.intervals import Interval, welch
from reporting.capability.lots import lot_error
from reporting.capability.moments import ROUNDING
from reporting.capability.summary import Capability, capability
from reporting.errors import ReportError
from reporting.samples import Samples
from reporting.shape.histogram import Histogram, histogram
from reporting.spec import ReportSpec, ResponseSpec

# Cohen's (1988) words for d; below the first the difference has no practical importance.
NEGLIGIBLE, SMALL, MEDIUM = 0.2, 0.5, 0.8


@dataclass(frozen=True)
class ResponseComparison:
    """One response in this campaign and in the other; a number is None where it is undefined.

    Attributes
    ----------
    response, unit : str
    n, n_other : int
        Number of values.
    capability, capability_other : Capability
        Each with the limits of its own campaign.
    mean_difference, mean_interval : float, (float, float)
        This campaign less the other, in the unit of the response (Welch).
    t_p : float
        p-value of Welch's test of equal means.
    effect : float
        Cohen's d: the difference of the means in pooled standard deviations.
    effect_word : str
        "negligible", "small", "medium", "large".
    std_ratio, std_ratio_interval : float, (float, float)
        This campaign over the other; the interval holds for any distribution with a fourth moment.
    f_p, levene_p : float
        p-values of the F test and of the test of Brown and Forsythe.
    superiority : float
        Probability that a value of this campaign is above one of the other; 0.5 without a difference.
    mann_whitney_p : float
    cpk_difference, cpk_interval : float, (float, float)
        This campaign less the other (delta method).
    histogram, histogram_other : Histogram or None
        With the same edges.
    notes : tuple of str
        Why numbers are None, and cautions.
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
        Of the other campaign.
    samples, failed : int
        Number of its finished samples, and of its failed ones.
    responses : tuple of ResponseComparison
        Responses of both campaigns, in the order of this one.
    only_here, only_there : tuple of str
        Responses of only one campaign.
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
        The campaigns have no response in common, or a response has different units.
    """
    theirs = {r.name: r for r in other_spec.responses}
    shared = [(r, theirs[r.name]) for r in spec.responses if r.name in theirs]
    if not shared:
        raise ReportError(
            f"{spec.campaign} and {other_spec.campaign} have no common response; compare campaigns of one mechanism"
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
        notes.append("The campaigns have different limits; each index uses those of its own campaign.")
    base = ResponseComparison(
        mine.name, mine.unit, a.size, b.size,
        capability(a, mine.lsl, mine.usl, mine.target, confidence),
        capability(b, their.lsl, their.usl, their.target, confidence),
    )  # fmt: skip
    fields: dict[str, object] = {}
    if a.size < 2 or b.size < 2:
        notes.append("Fewer than two values in a campaign: nothing to compare.")
    elif not (_varies(a) and _varies(b)):
        notes.append("The response does not vary in one of the campaigns: nothing to test.")
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
    """Return whether the values are more than a constant with rounding errors."""
    return float(np.std(x)) > ROUNDING * float(np.max(np.abs(x)))


def _means(a: Array, b: Array, confidence: float) -> dict[str, object]:
    """Return the difference of the means with its interval, test and effect size."""
    difference, interval, p_value = welch(a, b, confidence)
    squares = sum((x.size - 1) * float(np.var(x, ddof=1)) for x in (a, b))
    effect = difference / math.sqrt(squares / (a.size + b.size - 2))
    words = ((NEGLIGIBLE, "negligible"), (SMALL, "small"), (MEDIUM, "medium"))
    return {
        "mean_difference": difference,
        "mean_interval": interval,
        "t_p": p_value,
        "effect": effect,
        "effect_word": next((word for bar, word in words if abs(effect) < bar), "large"),
    }


def _spreads(a: Array, b: Array, confidence: float) -> dict[str, object]:
    """Return the ratio of the standard deviations with its interval and tests."""
    from scipy.stats import levene  # takes 1 s to import, which only a comparison needs

    errors = [math.sqrt(max(float(np.mean(((x - x.mean()) / x.std()) ** 4)) - 1, 0.0) / (4 * x.size)) for x in (a, b)]
    half = float(ndtri(0.5 + confidence / 2)) * math.hypot(*errors)
    ratio, nu, nu_other = float(np.std(a, ddof=1)) / float(np.std(b, ddof=1)), a.size - 1, b.size - 1
    tail = float(betainc(nu / 2, nu_other / 2, nu * ratio**2 / (nu * ratio**2 + nu_other)))
    with np.errstate(all="ignore"):  # two values on each side have equal deviations from their median
        levene_p = float(levene(a, b, center="median").pvalue)
    return {
        "std_ratio": ratio,
        "std_ratio_interval": (ratio * math.exp(-half), ratio * math.exp(half)),
        "f_p": 2 * min(tail, 1 - tail),
        "levene_p": levene_p if math.isfinite(levene_p) else None,
    }


def _order(a: Array, b: Array) -> dict[str, object]:
    """Return Mann and Whitney's probability of superiority and test; ties count half."""
    from scipy.stats import mannwhitneyu  # see `_spreads`

    test = mannwhitneyu(a, b, method="asymptotic")
    return {"superiority": float(test.statistic) / (a.size * b.size), "mann_whitney_p": float(test.pvalue)}


def _indices(a: Array, b: Array, base: ResponseComparison, confidence: float) -> dict[str, object]:
    """Return the difference of Cpk and its interval."""
    cpk, cpk_other = base.capability.cpk, base.capability_other.cpk
    if cpk is None or cpk_other is None:
        return {}
    errors = [
        lot_error(
            cpk_influence(x, c.cpk or 0.0, lower=c.cpu is None or (c.cpl is not None and c.cpl <= c.cpu)),
            np.full(x.size, 1 / x.size),
            None,
        )[0]
        for x, c in ((a, base.capability), (b, base.capability_other))
    ]
    half = float(ndtri(0.5 + confidence / 2)) * math.hypot(*errors)
    difference = cpk - cpk_other
    return {"cpk_difference": difference, "cpk_interval": (difference - half, difference + half)}
