"""What mean and spread of the C-60's contact force depend on: the tables of docs/c60.md.

`python -m studies.c60_spread --samples 100` runs every variant on the same first samples of the campaign `c60`, on all
processors, and prints a table in Markdown. Nothing is fitted: each variant changes one assumption.
"""

import argparse
import tomllib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from importlib.resources import files
from typing import Any

import numpy as np

from campaign import load_campaign
from campaign.inputs.sampling import draw
from engine import load_mechanism, simulate, warm_up
from engine.mechanism import Mechanism, get_value
from engine.mechanism.benches import Bench, with_bench
from engine.mechanism.models import mechanism_from

AXIAL = ("S1", "S2", "S4", "Sx", "S5", "S12", "S6", "S11", "S8", "S7")


@dataclass(frozen=True)
class Variant:
    """One assumption changed: tables over the file's, values set, inputs that vary beside the clearances."""

    name: str
    tables: dict[str, Any] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    varied: dict[str, float] = field(default_factory=dict)  # key -> standard deviation, a share of its value
    bench: str | None = None
    response: str = "FC-1"
    step: float | None = None
    fewer: int = 1  # a costly one takes every so many-th sample only


def variants() -> list[Variant]:
    """Return what is compared, the shipped model first."""
    c60, public = _tables("c60"), _tables("c60_public")
    axial = [f"contacts.{name}" for name in c60["contacts"] if name.split("_")[0] in AXIAL]
    as_coded = c60["springs"]["A3"] | {"actions": public["springs"]["A3"]["actions"]}
    short = [{"name": "hold", "duration": 1.0}, {"name": "free"}]
    damped = [{"name": "hold", "damping": 1.0}, {"name": "free", "damping": 1.0}]
    return [
        Variant("as shipped"),
        Variant("fixed steps of 1e-3 ms", step=1e-3, fewer=4),
        Variant("fixed steps of 5e-3 ms", step=5e-3),
        Variant("settling damped, 1/ms", {"phases": damped}),
        Variant("latch held for 1 ms only, as in the public file", {"phases": short}),
        Variant("on the way OFF -> ON by the handle (bench cycle)", bench="cycle", fewer=4),
        Variant("no axial stops: parts move freely along z", {"without": axial}),
        Variant("friction 0.1 everywhere", values={"materials.plastic_plastic.friction": 0.1}),
        Variant("friction 0.2 everywhere", values=_friction(0.2)),
        Variant("friction 0.3 everywhere", values=_friction(0.3)),
        Variant("friction 0.05 everywhere", values=_friction(0.05)),
        Variant("preload of A3 0.49 rad (public)", values={"springs.A3.preload": 0.49}),
        Variant("preload of A3 0.6547 rad", values={"springs.A3.preload": 0.6547}),
        Variant("handle spring 2.68 times (as coded)", values={"springs.handle_spring.stiffness": 2.68 * 3.82}),
        Variant("A3 by unbalanced forces (as coded)", {"springs": {"A3": as_coded}}),
        Variant("bump of the latch of radius 0.45", values=_bump(0.45)),
        Variant("bump of the latch of radius 0.499", values=_bump(0.499)),
        Variant("needle seats with 0.1 mm of play", values={"S3": 0.1}),
        Variant("A3 varies, stiffness +- 1 %", varied={"springs.A3.stiffness": 0.01}),
        Variant("A3 varies, stiffness +- 4 %", varied={"springs.A3.stiffness": 0.04}),
        Variant("friction varies, +- 20 %", varied={f"materials.{name}.friction": 0.2 for name in c60["materials"]}),
        Variant("the least that friction allows", response="FC-1_low"),
        Variant("the largest that friction allows", response="FC-1_high"),
        Variant("on the test bench: force on the probe", bench="contact_force", response="force", fewer=4),
    ]


def _tables(name: str) -> dict[str, Any]:
    """Return a shipped mechanism as plain data."""
    return tomllib.loads(files("engine.mechanism").joinpath("library", f"{name}.toml").read_text("utf-8"))


def _friction(mu: float) -> dict[str, float]:
    """Set all pairs of materials alike."""
    return {f"materials.{pair}.friction": mu for pair in ("steel_plastic", "plastic_plastic", "metal_metal")}


def _bump(radius: float) -> dict[str, float]:
    """Set the radius of the bump at both heights."""
    return {f"contacts.C5_{i}.a.arc.radius": radius for i in (1, 2)}


def mechanism_of(variant: Variant) -> Mechanism:
    """Return the C-60 with the variant's tables."""
    mechanism = load_mechanism("c60")
    if variant.bench:
        mechanism = mechanism.on_bench(variant.bench)
    if variant.tables:
        data = mechanism.model_dump(by_alias=True, exclude_unset=True)
        bench = Bench.model_validate(variant.tables)
        mechanism = mechanism_from(with_bench(data, "study", bench), variant.name)
    return mechanism


def run(variant: Variant, sample: int) -> tuple[float, float]:
    """Return response and FC-6 of one sample; NaN unless its run is ok."""
    spec = load_campaign("c60").spec
    values = {name: float(x[0]) for name, x in draw(spec, sample, 1).items()} | variant.values
    mechanism = mechanism_of(variant)
    rng = np.random.default_rng([spec.seed, sample])
    for key, share in variant.varied.items():
        values[key] = get_value(mechanism, key) * (1 + share * float(np.clip(rng.standard_normal(), -4, 4)))
    found = simulate(mechanism, values, step=variant.step)
    ok = found.status == "ok"
    return (found.responses[variant.response], found.responses["FC-6"]) if ok else (np.nan, np.nan)


def row(variant: Variant, results: Sequence[tuple[float, float]]) -> str:
    """Return a line of the table."""
    force, gap = np.array(results).T
    force, gap = force[np.isfinite(force)], gap[np.isfinite(gap)]
    ok = f"{force.size} of {len(results)}"
    if force.size < 2:
        return f"| {variant.name} | {ok} | | | | | |"
    return (
        f"| {variant.name} | {ok} | {force.mean():.2f} | {force.std(ddof=1):.3f} "
        f"| {force.min():.2f} to {force.max():.2f} | {gap.mean():.3f} | {gap.std(ddof=1):.3f} |"
    )


def main() -> None:
    """Run all variants, or those whose name holds a word, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.c60_spread", description=__doc__)
    parser.add_argument("--samples", type=int, default=100, help="default: %(default)s")
    parser.add_argument("--only", default="", help="a word in the names of the variants")
    asked = parser.parse_args()
    warm_up()
    print("| variant | ok | FC-1 mean, N | sigma, N | range, N | FC-6 mean, mm | sigma, mm |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with ProcessPoolExecutor() as pool:
        for variant in variants():
            if asked.only in variant.name:
                samples = range(0, asked.samples, variant.fewer)
                print(row(variant, list(pool.map(partial(run, variant), samples, chunksize=5))), flush=True)


if __name__ == "__main__":
    main()
