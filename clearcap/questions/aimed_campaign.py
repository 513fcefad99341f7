"""A campaign file with importance sampling that aims at rejects, as found or predicted from another campaign's rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydantic import ValidationError
from scipy.special import ndtr

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions.base import DRAWN
from campaign.inputs.sampling import sampler_named
from campaign.inputs.sampling.importance import ImportanceSampler
from campaign.inputs.sampling.inverse_transform import InverseTransformSampler, correlated
from campaign.inputs.sampling.sampler import varied
from campaign.plan import Plan
from campaign.samples import limits_of
from campaign.spec.campaign_file import CampaignSpec
from campaign.store import Store
from clearcap.questions.report_source import deciding_campaigns
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean
from reporting import ReportError
from reporting.rare.aim import WIDE, Aim, Target, aims, find_targets

SUFFIX = "-rare"
LONGEST_NAME = 60
Stage = tuple[Plan, tuple[str, ...]]
LEFT_OUT = ("stop", "grid", "table", "importance", "decide")


@dataclass(frozen=True)
class AimedCampaign:
    """A campaign file that aims at rejects."""

    tables: dict[str, Any]  # its content, as TOML tables
    targets: tuple[Target, ...]  # where rejects beyond each limit lie
    aims: tuple[Aim, ...]  # the components
    variables: tuple[str, ...]  # those that vary, in the order of the components' centres


def aimed_campaign(
    store: Store, plan: Plan, samples: int, responses: Sequence[str] = (), wide_share: float = WIDE
) -> AimedCampaign:
    """Return the campaign file with importance sampling that a campaign's rows suggest; by default for all limits.

    The component that looks for rejects elsewhere draws `wide_share` of the samples.
    """
    limits = {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}
    for name in responses:
        if name not in limits:
            allowed = ", ".join(limits) or "none"
            raise SpecError(
                f"--response {name}: no response with limits has this name; allowed: {allowed}"
                f"{did_you_mean(name, list(limits))}"
            )
    if not limits:
        raise SpecError(f"{plan.campaign_id}: no response has limits, so there are no rejects; give limits in its file")
    names = tuple(varied(plan.spec))
    z, weights, values = _rows(store, plan, names)
    try:
        targets = find_targets(
            *(z, weights, values), {name: limits[name] for name in responses or limits}, partial(_inputs, plan, names)
        )
    except ReportError as error:
        raise CampaignError(f"{plan.campaign_id}: {error}") from error
    components = aims(targets, len(names), wide_share)
    return AimedCampaign(_tables(plan, components, names, samples), targets, components, names)


def decided_by(store: Store, plan: Plan) -> tuple[Stage, ...]:
    """Return the aimed campaigns that decide what a campaign leaves open, each with these responses, in their order."""
    return tuple(
        (store.plan(decides), tuple(name for name in plan.mechanism.responses if name in names))
        for decides, names in deciding_campaigns(store, plan.campaign_id).items()
    )


def _rows(store: Store, plan: Plan, names: Sequence[str]) -> tuple[Array, Array, dict[str, Array]]:
    """Return standard scores, weights and responses of all rows."""
    sampler = sampler_named(plan.spec.sampler)
    if not isinstance(sampler, InverseTransformSampler):
        raise SpecError(
            f"{plan.campaign_id}: samples of sampler {sampler.name} are not drawn from distributions, so they do not"
            ' show where rejects lie; run the campaign with sampler = "random"'
        )
    scores: list[Array] = []
    weights: list[Array] = []
    values: dict[str, list[Array]] = {name: [] for name in plan.mechanism.responses}
    for table in store.stream(plan, ["sample", *values]):
        sample = table["sample"].to_numpy()
        if not sample.size:
            continue
        first = int(sample[0])
        drawn = sampler.scores(plan.spec, first, int(sample[-1]) + 1 - first)
        scores.append(np.column_stack([drawn[name][sample - first] for name in names]))
        own = sampler.own_columns(plan.spec, sample)
        weights.append(np.exp(own["log_weight"]) if "log_weight" in own else np.ones(sample.size))
        for name, pieces in values.items():
            pieces.append(table[name].to_numpy())
    if not scores:
        raise CampaignError(f"{plan.campaign_id}: no sample is computed yet; wait for the first, or run the campaign")
    return (
        np.concatenate(scores),
        np.concatenate(weights),
        {name: np.concatenate(pieces) for name, pieces in values.items()},
    )


def _inputs(plan: Plan, names: Sequence[str], scores: Array) -> Array:
    """Return the values of the variables that vary, at standard scores before correlations; shape (n, d) both."""
    u = {name: np.clip(ndtr(z), *DRAWN) for name, z in zip(names, scores.T, strict=True)}
    if plan.spec.correlations:
        u |= correlated(u, plan.spec.correlations)
    return np.column_stack([plan.spec.variables[name].ppf(u[name]) for name in names])


def _tables(plan: Plan, components: Sequence[Aim], names: Sequence[str], samples: int) -> dict[str, Any]:
    """Return the campaign file; its seed differs, because the components depend on the samples of this seed."""
    given = plan.spec.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    tables = {key: value for key, value in given.items() if key not in LEFT_OUT}
    name = plan.spec.name.removesuffix(SUFFIX)[: LONGEST_NAME - len(SUFFIX)] + SUFFIX
    changed = {"name": name, "samples": samples, "seed": plan.spec.seed + 1, "sampler": ImportanceSampler.name}
    tables |= changed | {"importance": {"components": [_component(aim, names) for aim in components]}}
    try:
        CampaignSpec.model_validate(tables)
    except ValidationError as error:
        reasons = "; ".join(each["msg"].removeprefix("Value error, ") for each in error.errors())
        raise SpecError(f"{plan.campaign_id} cannot have importance sampling: {reasons}") from error
    return tables


def _component(aim: Aim, names: Sequence[str]) -> dict[str, Any]:
    """Return the table of a component."""
    shift = {name: z for name, z in zip(names, aim.centre, strict=True) if z}
    table = {"share": round(aim.share, 4), "source": aim.source}
    return table | ({"shift": shift} if shift else {}) | ({"scale": aim.scale} if aim.scale != 1.0 else {})
