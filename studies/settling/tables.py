"""The tables of the study in Markdown: costs, scatter between steps, means, and distances from another settling.

Scatter is the standard deviation between the four runs of one sample, as the root mean square over the samples. Its
share refers to the variance over the samples. Samples with a run that is not ok enter the share of ok runs only.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from engine.arrays import Array
from studies.c60_spread.tables import PLACES, RESPONSES
from studies.settling.settlings import Ending

Endings = Mapping[int, Sequence[Ending]]  # by sample: with the settling's own steps, with half of them, ...

COSTS = """\
| settling | ok | steps | iterations | simulated, ms | processor, ms |
| --- | --- | --- | --- | --- | --- |"""


def cost_row(name: str, endings: Endings) -> str:
    """Return a line of the table of costs, which are means over the runs with the settling's own steps."""
    own = [runs[0] for runs in endings.values()]
    good = np.array([[run.status == "ok" for run in runs] for runs in endings.values()])
    steps, iterations, simulated, processor_ms = np.mean([run[2:] for run in own], axis=0)
    return (
        f"| {name} | {np.count_nonzero(good)} of {good.size} | {steps:.0f} | {iterations:.0f} | {simulated:.1f} "
        f"| {processor_ms:.0f} |"
    )


def values(endings: Endings, samples: Iterable[int]) -> dict[str, Array]:
    """Return each response of some samples, shape (samples, step sizes); NaN where a run is not ok."""
    runs = [endings[sample] for sample in samples]
    return {
        response: np.array([[run.responses.get(response, np.nan) for run in those] for those in runs])
        for response in RESPONSES
    }


def sigma(x: Array) -> float:
    """Return the standard deviation over the samples, with the settling's own steps."""
    return float(np.nanstd(x[:, 0], ddof=1))


def scatter(x: Array) -> float:
    """Return the standard deviation between step sizes, as root mean square over samples; x: (samples, step sizes)."""
    complete = x[np.isfinite(x).all(axis=1)]
    return float(np.sqrt(np.mean(np.var(complete, axis=1, ddof=1))))


def drift(x: Array) -> float:
    """Return the mean with the shortest steps minus the mean with the settling's own steps."""
    return float(np.nanmean(x[:, -1] - x[:, 0]))


def scatter_table(all_endings: Mapping[str, Endings]) -> list[str]:
    """Return the lines of the table of scatter: sigma, scatter between steps, and its share of the variance."""

    def cell(x: Array, places: int) -> str:
        return f"{scatter(x):.{places}f} of {sigma(x):.{places}f} ({100 * (scatter(x) / sigma(x)) ** 2:.0f} %)"

    return _table({name: values(endings, endings) for name, endings in all_endings.items()}, cell)


def mean_table(all_endings: Mapping[str, Endings]) -> list[str]:
    """Return the lines of the table of means and of their drift from the settling's own steps to the shortest ones."""

    def cell(x: Array, places: int) -> str:
        return f"{np.nanmean(x[:, 0]):.{places}f} {drift(x):+.{places}f}"

    return _table({name: values(endings, endings) for name, endings in all_endings.items()}, cell)


def distance_table(all_endings: Mapping[str, Endings], other: str, halvings: int) -> list[str]:
    """Return the lines of the table of distances from another settling with its steps halved `halvings` times.

    Each cell has the root mean square of the differences of single samples, and in brackets the mean difference.
    """

    def cell(x: Array, places: int) -> str:
        return f"{np.sqrt(np.nanmean(x**2)):.{places}f} ({np.nanmean(x):+.{places}f})"

    differences = {}
    for name, endings in all_endings.items():
        if name != other:
            common = sorted(endings.keys() & all_endings[other].keys())
            ours, limit = values(endings, common), values(all_endings[other], common)
            differences[name] = {
                response: ours[response][:, 0] - limit[response][:, halvings] for response in RESPONSES
            }
    return _table(differences, cell)


def _table(rows: Mapping[str, Mapping[str, Array]], cell: Callable[[Array, int], str]) -> list[str]:
    """Return the lines of a table with a row for each settling and a column for each response."""
    head = [f"{response}, {unit}" for response, unit in RESPONSES.items()]
    lines = [f"| settling | {' | '.join(head)} |", f"| --- |{' --- |' * len(head)}"]
    for name, columns in rows.items():
        cells = [cell(columns[response], PLACES[unit]) for response, unit in RESPONSES.items()]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines
