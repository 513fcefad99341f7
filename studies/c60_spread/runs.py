"""The runs of a variant: clearances of its samples, its mechanism, and the responses of each run."""

from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from campaign import load_campaign
from campaign.inputs.sampling import draw
from campaign.spec.campaign_file import CampaignSpec
from engine import load_mechanism, simulate
from engine.arrays import Array
from engine.mechanism import Mechanism, get_value
from engine.mechanism.models import Bench, mechanism_from, with_bench
from studies.c60_spread.variants import Variant


@lru_cache(maxsize=1)
def shipped() -> CampaignSpec:
    """Return the shipped campaign `c60`."""
    return load_campaign("c60").spec


def clearances(variant: Variant, count: int) -> dict[str, Array]:
    """Return the clearances of the first samples by joint, in mm; each has the shape (count,).

    All variants transform the same uniform numbers into clearances. Correlated clearances use a Gaussian copula, and
    shared clearances its limit.
    """
    joints = list(shipped().variables)
    changes: dict[str, Any] = {}
    if variant.clearances:
        changes["variables"] = dict.fromkeys(joints, variant.clearances)
    if 0 < variant.correlation < 1:
        changes["correlations"] = [[a, b, variant.correlation] for a, b in combinations(joints, 2)]
    spec = CampaignSpec.model_validate(shipped().model_dump(exclude_unset=True) | changes)
    drawn = draw(spec, 0, count)
    return dict.fromkeys(joints, drawn[joints[0]]) if variant.correlation == 1 else drawn


def mechanism_of(variant: Variant, rng: np.random.Generator) -> Mechanism:
    """Return the C-60 with the variant's tables, and with random initial velocities if the variant has any."""
    mechanism = _on_bench(variant.bench)
    tables = variant.tables
    if any(variant.speeds):
        tables = tables | {"bodies": _moving(mechanism, variant.speeds, rng)}
    if tables:
        data = mechanism.model_dump(by_alias=True, exclude_unset=True)
        mechanism = mechanism_from(with_bench(data, "study", Bench.model_validate(tables)), variant.name)
    return mechanism


@lru_cache(maxsize=2)
def _on_bench(bench: str | None) -> Mechanism:
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
    values = _on_bench(None).preset("paper") | gaps | variant.values
    for key, share in variant.varied.items():
        # Beyond 5 sigmas a friction that varies by 20 % would be negative.
        values[key] = get_value(mechanism, key) * (1 + share * float(np.clip(rng.standard_normal(), -4, 4)))
    found = simulate(mechanism, values, step=variant.step)
    return found.responses | {"FC-1": found.responses[variant.response]} if found.status == "ok" else {}
