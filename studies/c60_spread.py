"""Influences on mean and spread of the C-60's contact force: `python -m studies.c60_spread` prints its tables.

Each variant changes one assumption of the campaign `c60_paper`, or a few of them, and simulates the same first
samples. Nothing is fitted. The tables are in studies/c60_spread.md.

Each interval has 95 % confidence by itself. They are bias-corrected and accelerated bootstrap intervals (Efron 1987),
which do not assume normal responses. Comparisons with the shipped campaign are resampled in pairs, because both have
the same uniform numbers in every sample.
"""

import argparse
import re
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from importlib.resources import files
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import bootstrap

from campaign import load_campaign
from campaign.inputs.sampling import draw
from campaign.spec.campaign_file import CampaignSpec
from engine import load_mechanism, simulate, warm_up
from engine.arrays import Array
from engine.mechanism import Mechanism, get_value
from engine.mechanism.benches import Bench, with_bench
from engine.mechanism.models import mechanism_from
from studies import head, made_by, show

AXIAL = ("S1", "S2", "S4", "Sx", "S5", "S12", "S6", "S11", "S8", "S7")
SHIPPED = "preset paper"
UNIFORM = {"distribution": "uniform", "lower": 0.01, "upper": 0.13}
ENDS = {"distribution": "empirical", "values": [0.01, 0.13]}
SPEEDS = (0.5, 0.05)


@dataclass(frozen=True)
class Variant:
    """Differences from the shipped campaign whose clearances close in free fall, as in the paper."""

    name: str  # row of the table
    tables: dict[str, Any] = field(default_factory=dict)  # override those of the mechanism file, as in a test bench
    values: dict[str, float] = field(default_factory=dict)  # changed numbers of the mechanism by key
    # inputs that vary besides the clearances: key and standard deviation, relative to the value
    varied: dict[str, float] = field(default_factory=dict)
    # Standard deviations of each body's initial velocity [mm/ms] and angular velocity [rad/ms], per component.
    speeds: tuple[float, float] = (0.0, 0.0)
    # distribution of every clearance, as in a campaign file; that of the campaign if empty
    clearances: dict[str, Any] = field(default_factory=dict)
    correlation: float = 0.0  # rank correlation of every two clearances; with 1 the joints share the clearance of J1
    bench: str | None = None  # test bench of the mechanism
    response: str = "FC-1"  # used as FC-1
    step: float | None = None  # fixed [ms]
    fewer: int = 1  # for expensive variants: only every `fewer`-th sample is simulated
    heading: str = ""  # column in the tables of all responses; omitted if empty


def variants() -> list[Variant]:
    """Return the compared variants, the shipped model with preset paper first."""
    return [Variant(SHIPPED), *_of_the_model(), *_of_the_clearances()]


def _of_the_model() -> list[Variant]:
    """Return the variants with the campaign's own clearances."""
    own, public = _tables("c60"), _tables("c60_public")
    axial = [f"contacts.{name}" for name in own["contacts"] if name.split("_")[0] in AXIAL]
    as_coded = {
        name: spring | {"actions": public["springs"][name]["actions"]} for name, spring in own["springs"].items()
    }
    short = [{"name": "hold", "duration": 1.0}, {"name": "free"}]
    damped = {"phases.0.damping": 1.0, "phases.1.damping": 1.0}
    return [
        Variant("fixed steps of 1e-3 ms", step=1e-3),
        Variant("fixed steps of 5e-3 ms", step=5e-3),
        Variant("settling damped, 1/ms", values=damped),
        Variant("latch held for 1 ms only, as in the public file", {"phases": short}),
        Variant("on the way OFF -> ON by the handle (bench cycle)", bench="cycle", fewer=4),
        Variant("random velocities at the start", speeds=SPEEDS),
        Variant("no axial stops: parts move freely along z", {"without": axial}),
        *(Variant(f"friction {mu} everywhere", values=_friction(mu)) for mu in (0.05, 0.1, 0.2, 0.3)),
        Variant("friction 0.3 everywhere, random velocities", values=_friction(0.3), speeds=SPEEDS),
        Variant("preload of A3 0.49 rad (public)", values={"springs.A3.preload": 0.49}),
        Variant("preload of A3 0.6547 rad", values={"springs.A3.preload": 0.6547}),
        Variant("preload of A3 1.0418 rad", values={"springs.A3.preload": 1.0418}),
        Variant("handle spring 2.68 times (as coded)", values={"springs.handle_spring.stiffness": 2.68 * 3.82}),
        Variant("A3 by unbalanced forces (as coded)", {"springs": {"A3": as_coded["A3"]}}),
        Variant("all springs by unbalanced forces (as coded)", {"springs": as_coded}),
        Variant("all springs as coded, friction 0.3 everywhere", {"springs": as_coded}, _friction(0.3)),
        *(Variant(f"bump of the latch of radius {radius}", values=_bump(radius)) for radius in (0.45, 0.499)),
        Variant("needle seats with 0.1 mm of play", values={"S3": 0.1}),
        Variant("A3 varies, stiffness +- 1 %", varied={"springs.A3.stiffness": 0.01}),
        Variant("A3 varies, stiffness +- 4 %", varied={"springs.A3.stiffness": 0.04}),
        Variant("friction varies, +- 20 %", varied={f"materials.{name}.friction": 0.2 for name in own["materials"]}),
        Variant("the least that friction allows", response="FC-1_low"),
        Variant("the largest that friction allows", response="FC-1_high"),
        Variant("on the test bench: force on the probe", bench="contact_force", response="force", fewer=4),
        Variant("on the test bench, 1 mm before that: forward", bench="contact_force", response="force_forward"),
        Variant("on the test bench, 1 mm before that: back", bench="contact_force", response="force_back"),
    ]


def _of_the_clearances() -> list[Variant]:
    """Return the variants with dependent clearances or another distribution."""
    rough = _friction(0.3)
    shared = Variant("one shared uniform clearance for all joints", correlation=1.0, clearances=UNIFORM)
    return [
        *(Variant(f"rank correlation {r} of all clearances", correlation=r, heading=f"{r}") for r in (0.3, 0.6, 0.9)),
        Variant("one shared clearance for all joints", correlation=1.0, heading="shared"),
        Variant("shared clearance, friction 0.3, random velocities", correlation=1.0, values=rough, speeds=SPEEDS),
        Variant("clearances uniform on [0.01, 0.13]", clearances=UNIFORM, heading="uniform"),
        Variant("clearances 0.01 or 0.13", clearances=ENDS, heading="0.01 or 0.13"),
        replace(shared, heading="uniform, shared"),
        replace(shared, name="shared uniform clearance, friction 0.3, random velocities", values=rough, speeds=SPEEDS),
    ]


def _tables(name: str) -> dict[str, Any]:
    """Return a shipped mechanism as plain data."""
    return tomllib.loads(files("engine.mechanism").joinpath("library", f"{name}.toml").read_text("utf-8"))


def _friction(mu: float) -> dict[str, float]:
    """Set the same friction for all pairs of materials."""
    return {f"materials.{pair}.friction": mu for pair in ("steel_plastic", "plastic_plastic", "metal_metal")}


def _bump(radius: float) -> dict[str, float]:
    """Set the radius of the bump at both heights."""
    return {f"contacts.C5_{i}.a.arc.radius": radius for i in (1, 2)}


@lru_cache(maxsize=1)
def shipped() -> CampaignSpec:
    """Return the shipped campaign `c60`."""
    return load_campaign("c60").spec


def clearances(variant: Variant, count: int) -> dict[str, Array]:
    """Return the clearances of the first samples by joint, in mm; each has the shape (count,)."""
    # All variants transform the same uniform numbers into clearances. Correlated clearances use a Gaussian copula, and
    # shared clearances its limit.
    joints = list(shipped().variables)
    changes: dict[str, Any] = {}
    if variant.clearances:
        changes["variables"] = dict.fromkeys(joints, variant.clearances)
    if 0 < variant.correlation < 1:
        changes["correlations"] = [[a, b, variant.correlation] for a, b in combinations(joints, 2)]
    spec = CampaignSpec.model_validate(shipped().model_dump(exclude_unset=True) | changes)
    drawn = draw(spec, 0, count)
    return dict.fromkeys(joints, drawn[joints[0]]) if variant.correlation == 1 else drawn


def gaps_of_samples(count: int, variant: Variant = Variant(SHIPPED)) -> dict[int, dict[str, float]]:
    """Return the clearances (mm by joint) of the simulated ones of the first samples, by sample."""
    drawn = clearances(variant, count)
    return {i: {joint: float(x[i]) for joint, x in drawn.items()} for i in range(0, count, variant.fewer)}


def mechanism_of(variant: Variant, rng: np.random.Generator) -> Mechanism:
    """Return the C-60 with the variant's tables, and with random initial velocities if the variant has any."""
    mechanism = c60(variant.bench)
    tables = variant.tables
    if any(variant.speeds):
        tables = tables | {"bodies": _moving(mechanism, variant.speeds, rng)}
    if tables:
        data = mechanism.model_dump(by_alias=True, exclude_unset=True)
        mechanism = mechanism_from(with_bench(data, "study", Bench.model_validate(tables)), variant.name)
    return mechanism


@lru_cache(maxsize=3)
def c60(bench: str | None = None) -> Mechanism:
    """Return the C-60, on a bench if one is named; cached, because reading its file takes longer than some runs."""
    mechanism = load_mechanism("c60")
    return mechanism.on_bench(bench) if bench else mechanism


def _moving(mechanism: Mechanism, speeds: tuple[float, float], rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return the bodies that are not fixed, with normally distributed velocity components of mean 0."""
    linear, angular = speeds
    return {
        name: body.model_dump(by_alias=True, exclude_unset=True)
        | {"velocity": (linear * rng.standard_normal(3)).tolist()}
        | {"angular_velocity": (angular * rng.standard_normal(3)).tolist()}
        for name, body in mechanism.bodies.items()
        if not body.fixed
    }


def run(variant: Variant, sample: int, gaps: dict[str, float]) -> dict[str, float]:
    """Return the responses of one sample, with the variant's response as FC-1; empty unless the run is ok."""
    rng = np.random.default_rng([shipped().seed, sample])
    mechanism = mechanism_of(variant, rng)
    # The last one wins: what a variant changes overrides the preset and the clearances.
    values = c60().preset("paper") | gaps | variant.values
    for key, share in variant.varied.items():
        # Beyond 5 sigmas a friction that varies by 20 % would be negative.
        values[key] = get_value(mechanism, key) * (1 + share * float(np.clip(rng.standard_normal(), -4, 4)))
    found = simulate(mechanism, values, step=variant.step)
    return found.responses | {"FC-1": found.responses[variant.response]} if found.status == "ok" else {}


RESPONSES = dict.fromkeys(("FC-1", "FC-1_low", "FC-1_high"), "N") | dict.fromkeys(
    ("FC-2", "FC-3", "FC-4", "FC-5", "FC-6", "latch_overlap"), "mm"
)
HEAD = head("variant", "ok", "FC-1 mean, N", "sigma, N", "95 % of sigma", "range, N", "FC-6 mean, mm", "sigma, mm")
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
    lines = head("response", title, *others).splitlines()
    for response, unit in RESPONSES.items():
        ours = column(shipped, response)
        cells = [f"{response}, {unit}", f"{of_one(ours[np.isfinite(ours)]):.{PLACES[unit]}f}"]
        for results in others.values():
            pairs = np.array([ours, column(results, response)])
            x, y = pairs[:, np.isfinite(pairs).all(axis=0)]
            cells.append(form.format(float(of_two(x, y)), *interval(of_two, x, y), PLACES[unit]))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def lines(chosen: list[Variant], count: int, mapped: Callable[..., Iterable[dict[str, float]]] = map) -> Iterator[str]:
    """Yield the lines of the tables of some variants; ``mapped`` is `map` or a parallel substitute for the samples."""
    began = time.monotonic()
    results: dict[str, Responses] = {}
    yield HEAD
    for variant in chosen:
        gaps = gaps_of_samples(count, variant)
        results[variant.name] = list(mapped(partial(run, variant), gaps.keys(), gaps.values()))
        yield row(variant.name, results[variant.name])
    compared = {v.heading: results[v.name] for v in chosen if v.heading}
    if SHIPPED in results and compared:
        yield from ("", *sigma_table(results[SHIPPED], compared))
        yield from ("", *mean_table(results[SHIPPED], compared))
    yield made_by(began, f": the first {count} samples of the campaign c60, seed {shipped().seed}")


def main() -> None:
    """Run all variants, or the requested ones, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.c60_spread", description=__doc__)
    parser.add_argument("--samples", type=int, default=200, help="default: %(default)s")
    parser.add_argument("--only", default="", metavar="REGEX", help="variants whose name matches, and no others")
    asked = parser.parse_args()
    warm_up()
    chosen = [variant for variant in variants() if re.search(asked.only, variant.name)]
    with ProcessPoolExecutor() as pool:
        show(lines(chosen, asked.samples, partial(pool.map, chunksize=5)))


if __name__ == "__main__":
    main()
