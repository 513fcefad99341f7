"""The tables of the study in Markdown.

Each interval has 95 % confidence by itself. They are bias-corrected and accelerated bootstrap intervals (Efron 1987),
which do not assume normal responses. Comparisons with the shipped campaign are resampled in pairs, because both have
the same uniform numbers in every sample.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import bootstrap

from engine.arrays import Array

RESPONSES = dict.fromkeys(("FC-1", "FC-1_low", "FC-1_high"), "N") | dict.fromkeys(
    ("FC-2", "FC-3", "FC-4", "FC-5", "FC-6", "latch_overlap"), "mm"
)
HEAD = """\
| variant | ok | FC-1 mean, N | sigma, N | 95 % of sigma | range, N | FC-6 mean, mm | sigma, mm |
| --- | --- | --- | --- | --- | --- | --- | --- |"""
PLACES = {"N": 3, "mm": 4}  # decimals of a response's mean and sigma
RESAMPLES = 9999
FEWEST = 10  # fewest samples for an interval

Responses = Sequence[dict[str, float]]  # one per sample, empty if the run is not ok
Statistic = Callable[..., Array]


def sigma(x: Array, axis: int = -1) -> Array:
    """Return the standard deviation of samples."""
    return np.asarray(np.std(x, axis=axis, ddof=1))


def mean(x: Array, axis: int = -1) -> Array:
    """Return the mean of samples."""
    return np.asarray(np.mean(x, axis=axis))


def ratio(x: Array, y: Array, axis: int = -1) -> Array:
    """Return the second sigma divided by the first."""
    return sigma(y, axis) / sigma(x, axis)


def shift(x: Array, y: Array, axis: int = -1) -> Array:
    """Return the second mean minus the first."""
    return mean(y, axis) - mean(x, axis)


def interval(statistic: Statistic, *columns: Array) -> tuple[float, float]:
    """Return the 95 % interval of a statistic of one column, or of two columns with paired samples."""
    drawn = bootstrap(
        columns,
        statistic,
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        method="BCa",
        random_state=np.random.default_rng(1987),  # the same responses give the same table
    )
    low, high = drawn.confidence_interval
    return float(low), float(high)


def row(name: str, results: Responses) -> str:
    """Return a line of the table of variants."""
    force, gap = (column(results, response) for response in ("FC-1", "FC-6"))
    ok = f"{np.count_nonzero(np.isfinite(force))} of {len(results)}"
    force, gap = force[np.isfinite(force)], gap[np.isfinite(gap)]
    if force.size < FEWEST:
        return f"| {name} | {ok} | | | | | | |"
    low, high = interval(sigma, force)
    return (
        f"| {name} | {ok} | {force.mean():.2f} | {sigma(force):.3f} | {low:.3f} to {high:.3f} "
        f"| {force.min():.2f} to {force.max():.2f} | {gap.mean():.3f} | {sigma(gap):.3f} |"
    )


def column(results: Responses, response: str) -> Array:
    """Return a response of all samples; NaN where a run is not ok."""
    return np.array([found.get(response, np.nan) for found in results])


def sigma_table(shipped: Responses, others: dict[str, Responses]) -> list[str]:
    """Return the lines of the table of sigmas: of each response with preset paper, and the ratios to it."""
    return _comparison("sigma with preset paper", sigma, ratio, "{0:.2f} ({1:.2f} to {2:.2f})", shipped, others)


def mean_table(shipped: Responses, others: dict[str, Responses]) -> list[str]:
    """Return the lines of the table of means: of each response with preset paper, and the differences from it."""
    return _comparison("mean with preset paper", mean, shift, "{0:+.{3}f} ({1:+.{3}f} to {2:+.{3}f})", shipped, others)


def _comparison(
    title: str, of_one: Statistic, of_two: Statistic, form: str, shipped: Responses, others: dict[str, Responses]
) -> list[str]:
    """Return the lines of a table with a row for each response and a column for each other variant."""
    lines = [f"| response | {title} | {' | '.join(others)} |", f"| --- | --- |{' --- |' * len(others)}"]
    for response, unit in RESPONSES.items():
        ours = column(shipped, response)
        cells = [f"{response}, {unit}", f"{of_one(ours[np.isfinite(ours)]):.{PLACES[unit]}f}"]
        for results in others.values():
            pairs = np.array([ours, column(results, response)])
            x, y = pairs[:, np.isfinite(pairs).all(axis=0)]
            cells.append(form.format(float(of_two(x, y)), *interval(of_two, x, y), PLACES[unit]))
        lines.append(f"| {' | '.join(cells)} |")
    return lines
