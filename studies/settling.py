"""Comparison of settlings of the C-60: `python -m studies.settling` prints the tables of studies/settling.md.

The rest position of a mechanism with friction depends on its history. Each settling closes the clearances of the same
samples with four step sizes; the rest position must not depend on them. Nothing is chosen by the paper's numbers.

Scatter is the standard deviation between the four runs of one sample, as the root mean square over the samples. Its
share refers to the variance over the samples. Samples with a run that is not ok enter the share of ok runs only.
"""

import argparse
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from engine import load_mechanism, simulate, warm_up
from engine.arrays import Array
from engine.mechanism import Mechanism
from engine.mechanism.benches import Bench, with_bench
from engine.mechanism.models import mechanism_from
from studies import head, made_by, show
from studies.c60_spread import PLACES, RESPONSES, gaps_of_samples, shipped

FEWER = 5
FREE_FALL = "free fall, as in the paper"
CHOSEN = "drag 10, then 2: as shipped"
CONTINUED = "as shipped, then on without drag"
WINDOWS = ("as shipped, window 0.1", "as shipped, window 3")
LIMIT = "drag 20, steps from 0.008, travel 0.004"  # beyond it, more drag and shorter steps hardly matter
HALVINGS = range(4)  # the steps are divided by 1, 2, 4 and 8


@dataclass(frozen=True)
class Settling:
    """A settling, independent of that in the mechanism file."""

    name: str  # row of the tables
    # rate in each phase [1/ms]: with the latch held, with the latch free, and in further phases
    drag: tuple[float, ...] = (0.0, 0.0)
    step: float = 2e-3  # shortest [ms]
    longest: float = 0.064  # step [ms]
    travel: float = 8e-3  # permitted to a contact point in a step longer than the shortest one [mm]
    theta: float = 0.5  # position within a step at which loads and contacts are evaluated
    window: float = 0.3  # time without motion that ends a phase [ms]
    held: float | None = None  # time for which the latch is held [ms]; None: until rest
    free: bool = False  # the latch is never held, so that the first phase has the latch free
    fewer: int = FEWER  # only every `fewer`-th sample is simulated

    def tables(self) -> dict[str, Any]:
        """Return the tables that override those of the mechanism file, as in a test bench."""
        names = ("free", "rest") if self.free else ("hold", "free", "rest")
        phases: list[dict[str, Any]] = [
            {"name": name, "damping": rate} for name, rate in zip(names, self.drag, strict=False)
        ]
        if self.held is not None:
            phases[0]["duration"] = self.held
        return {
            "phases": phases,
            "simulation": {"theta": self.theta, "rest": {"window": self.window, "drift": 1e-6}, **self.steps(0)},
            "without": ["torques.latch_hold"] if self.free else [],
        }

    def steps(self, halvings: int) -> dict[str, Any]:
        """Return the step keys of [simulation], with all steps halved `halvings` times."""
        share = 0.5**halvings
        return {"step": share * self.step, "adaptive": {"longest": share * self.longest, "travel": share * self.travel}}


class Ending(NamedTuple):
    """Result of a run."""

    status: str
    responses: dict[str, float]  # empty unless the run is ok
    steps: int
    iterations: int
    simulated: float  # ms
    processor_ms: float


def settlings() -> list[Settling]:
    """Return the compared settlings, the paper's free fall first."""
    steps = (2e-3, 4e-3, 8e-3, 1.6e-2, 3.2e-2)
    return [
        Settling(FREE_FALL, fewer=1),
        *(Settling(f"free fall, theta 1, steps from {h:g}", theta=1.0, step=h) for h in steps),
        *(Settling(f"drag {d:g}, steps from 0.002", (d, d)) for d in (1.0, 5.0)),
        *(Settling(f"drag {d:g}, theta 1, steps from 0.008", (d, d), 8e-3, theta=1.0) for d in (1, 2, 5, 10, 20)),
        *_with_coarse_steps(),
    ]


def run(settling: Settling, gaps: Mapping[str, float], halvings: int = 0) -> Ending:
    """Return the result of a sample with its clearances (mm by joint) and steps halved `halvings` times."""
    mechanism = mechanism_of(settling)
    steps = settling.steps(halvings)
    values = {
        **gaps,
        "simulation.step": steps["step"],
        **{f"simulation.adaptive.{key}": value for key, value in steps["adaptive"].items()},
    }
    began = time.process_time()
    found = simulate(mechanism, values)
    processor_ms = 1e3 * (time.process_time() - began)
    c = found.certificate
    return Ending(found.status, found.responses, c.steps, c.iterations, c.time, processor_ms)


@lru_cache(maxsize=2)
def mechanism_of(settling: Settling) -> Mechanism:
    """Return the C-60 with this settling; cached, because reading its file takes longer than some runs."""
    data = load_mechanism("c60").model_dump(by_alias=True, exclude_unset=True)
    return mechanism_from(with_bench(data, "study", Bench.model_validate(settling.tables())), settling.name)


def _with_coarse_steps() -> list[Settling]:
    """Return the settlings with drag, theta 1 and a shortest step of 0.016 ms, and those they are compared with."""
    weak = Settling("drag 5, theta 1, steps from 0.016", (5.0, 5.0), step=1.6e-2, theta=1.0)
    chosen = replace(weak, name=CHOSEN, drag=(10.0, 2.0))
    return [
        replace(weak, fewer=1),
        *(replace(weak, name=f"drag 5, window {window:g}", window=window) for window in (0.05, 0.1)),
        replace(weak, name="drag 5, then 10", drag=(5.0, 10.0)),
        replace(weak, name="drag 10", drag=(10.0, 10.0), fewer=1),
        replace(weak, name="drag 10, then 5", drag=(10.0, 5.0)),
        replace(weak, name="drag 10, then 1", drag=(10.0, 1.0)),
        replace(chosen, fewer=1),
        replace(chosen, name="as shipped, theta 1/2", theta=0.5),
        *(replace(chosen, name=f"as shipped, steps from {h:g}", step=h) for h in (2e-3, 8e-3, 3.2e-2)),
        *(replace(chosen, name=f"as shipped, travel {travel:g}", travel=travel) for travel in (4e-3, 1.6e-2)),
        *(replace(chosen, name=f"as shipped, longest {longest:g}", longest=longest) for longest in (0.032, 0.128)),
        replace(chosen, name="drag 20 while held for 1 ms, then 5", drag=(20.0, 5.0), held=1.0),
        replace(chosen, name="drag 10, latch never held", drag=(10.0,), free=True),
        *(replace(chosen, name=name, window=window) for name, window in zip(WINDOWS, (0.1, 3.0), strict=True)),
        replace(chosen, name=CONTINUED, drag=(10.0, 2.0, 0.0)),
        replace(chosen, name=LIMIT, drag=(20.0, 20.0), step=8e-3, travel=4e-3),
    ]


Endings = Mapping[int, Sequence[Ending]]  # by sample: with the settling's own steps, with half of them, ...

COSTS = head("settling", "ok", "steps", "iterations", "simulated, ms", "processor, ms")


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
    """Return the lines of the table of distances from another settling with its steps halved `halvings` times."""
    # Each cell has the root mean square of the differences of single samples, and in brackets the mean difference.

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
    lines = head("settling", *(f"{response}, {unit}" for response, unit in RESPONSES.items())).splitlines()
    for name, columns in rows.items():
        cells = [cell(columns[response], PLACES[unit]) for response, unit in RESPONSES.items()]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def lines(chosen: list[Settling], count: int, mapped: Callable[..., Iterable[Ending]] = map) -> Iterator[str]:
    """Yield the lines of the tables of some settlings; ``mapped`` is `map` or a parallel substitute for the samples."""
    began, drawn = time.monotonic(), gaps_of_samples(count)
    found: dict[str, Endings] = {}
    yield COSTS
    for settling in chosen:
        samples = range(0, count, settling.fewer)
        gaps = [drawn[i] for i in samples for _ in HALVINGS]
        runs = iter(mapped(partial(run, settling), gaps, list(HALVINGS) * len(samples)))
        found[settling.name] = {i: [next(runs) for _ in HALVINGS] for i in samples}
        yield cost_row(settling.name, found[settling.name])
    yield from ("", *scatter_table(found))
    yield from ("", *mean_table(found))
    if LIMIT in found:
        yield from ("", *distance_table(found, LIMIT, 2))
    if CHOSEN in found:
        near = {name: x for name, x in found.items() if name in (CHOSEN, CONTINUED, *WINDOWS)}
        yield from ("", *distance_table(near, CHOSEN, 0))
    campaign = f"the first {count} samples of the campaign c60, seed {shipped().seed}"
    yield made_by(began, f": {campaign}, four lengths of steps")


def main() -> None:
    """Run all settlings, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.settling", description=__doc__)
    parser.add_argument("--samples", type=int, default=200, help="default: %(default)s")
    parser.add_argument("--only", default="", metavar="REGEX", help="settlings whose name matches, and no others")
    parser.add_argument("--processes", type=int, help="default: as many as there are cores")
    asked = parser.parse_args()
    warm_up()
    chosen = [settling for settling in settlings() if re.search(asked.only, settling.name)]
    with ProcessPoolExecutor(asked.processes) as pool:
        show(lines(chosen, asked.samples, partial(pool.map, chunksize=4)))


if __name__ == "__main__":
    main()
