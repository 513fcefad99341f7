"""What plain samples leave open, decided by campaigns that aim at the rejects: which responses, and which campaigns.

A plain campaign of a few hundred samples seldom makes a verdict certain: it shows neither a share of some ppm nor a
small second population. The model is at hand, so a further campaign draws where its rows expect rejects, and its
weighted runs decide. What they leave open gets another one, which aims where they have found rejects, until all is
decided or the runs are used up. Each is an importance campaign like any other in the same store, and the last that
finds an interval of a response decides it alone: weights of runs that have chosen where to aim would be too small. Its
file is a function of the rows before, so a later call continues with the same bits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydantic import ValidationError
from scipy.special import ndtr

from campaign.coordinator.requests import refuse_signed
from campaign.coordinator.submit import submit
from campaign.errors import CampaignError, SpecError, StoreError
from campaign.inputs.distributions.base import DRAWN
from campaign.inputs.sampling import sampler_named
from campaign.inputs.sampling.importance import ImportanceSampler
from campaign.inputs.sampling.inverse_transform import InverseTransformSampler, correlated
from campaign.inputs.sampling.sampler import varied
from campaign.plan import Plan
from campaign.samples import limits_of
from campaign.spec.campaign_file import CampaignSpec, Decide
from campaign.spec.load import Campaign
from campaign.store import Store
from campaign.store.labels import LabelChange, read_labels
from campaign.store.layout import DECISION, SUBMISSION
from campaign.waits import counted
from campaign.worker.messages import check_build
from clearcap.questions.report import analysis
from clearcap.questions.report_source import Stage, decided_by
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean
from reporting import ReportError
from reporting.rare.aim import WIDE, Aim, Target, aims, find_targets

SUFFIX = "-rare"
LONGEST_NAME = 60
LEFT_OUT = ("stop", "grid", "table", "importance", "decide")

# Runs of an aimed campaign, and more for each open response, as far as the campaign's `decide.runs` reach. A quarter
# looks for rejects where nothing aims: 300 of these without a reject leave room for 5 ppm behind a flat limit.
RUNS, RUNS_EACH, WIDE_SHARE = 1_000, 250, 0.25
FEWEST_RUNS = 500  # of a further campaign: the one before gets what would be left for less


def decide(store: Store, plan: Plan, compute: Callable[[Plan], object], say: Callable[[str], object]) -> None:
    """Compute the aimed campaigns that a complete campaign needs, one after the other; `compute` completes one.

    If one cannot be completed, `say` is told why, and the verdicts stay as they are. Raises StoreError.
    """
    try:
        while (planned := plan_decision(store, plan)) is not None:
            decides, names = planned
            say(
                f"not certain: {', '.join(names)}; {counted(decides.spec.samples, 'run')} that aim at their rejects"
                f" decide (campaign {decides.campaign_id}); decide = {{ runs = 0 }} in the campaign leaves them out"
            )
            compute(decides)
    except StoreError:
        raise
    except CampaignError as error:
        say(f"{plan.campaign_id}: nothing more is decided: {error}")


def plan_decision(store: Store, plan: Plan) -> Stage | None:
    """Return the next campaign that decides what a complete campaign leaves open, and the open responses.

    None if every verdict is certain, no runs are left (the campaign file may say `decide = {runs = 0}`), or the samples
    cannot be weighted. Raises SignedCampaign if the verdicts are signed, WrongBuild if the rows are of another build.
    """
    stages = decided_by(store, plan)
    if stages and store.survey(stages[-1][0]).missing:
        return stages[-1]
    left = (plan.spec.decide or Decide()).runs - sum(decides.spec.samples for decides, _ in stages)
    if left < (FEWEST_RUNS if stages else 1) or plan.spec.sampler != "random" or store.survey(plan).missing:
        return None
    names = tuple(r.spec.name for r in analysis(store, plan).responses if r.verdict.certain is False)
    if not names:
        return None
    refuse_signed(store, plan.campaign_id)
    check_build(plan.campaign_id, plan.row_build)
    before = stages[-1][0] if stages else plan
    try:
        runs = RUNS + RUNS_EACH * len(names)
        aimed = aimed_campaign(store, before, left if left - runs < FEWEST_RUNS else runs, names, WIDE_SHARE)
    except (SpecError, CampaignError):  # production batches, or too few rows for a model
        return None
    spec = CampaignSpec.model_validate(aimed.tables)
    labels = LabelChange(read_labels(store, plan.campaign_id).owner or None)
    by = (store.read_json(plan.campaign_id, SUBMISSION) or {}).get("user")  # whose rights it has
    decides = submit(store, Campaign(spec, plan.mechanism), tries_runs=False, labels=labels, by=by)
    every = [*stages, (decides, names)]
    known = [{"campaign": each.campaign_id, "responses": list(of_each)} for each, of_each in every]
    store.write_json(plan.campaign_id, DECISION, {"stages": known})
    return decides, names


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
    """Return the campaign file that the rows suggest; the component that looks elsewhere draws `wide_share` of it."""
    limits = {name: pair for name, pair in limits_of(plan).items() if pair != (None, None)}
    for name in responses:
        if name not in limits:
            allowed = f"{', '.join(limits) or 'none'}{did_you_mean(name, list(limits))}"
            raise SpecError(f"--response {name}: no response with limits has this name; allowed: {allowed}")
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


def _rows(store: Store, plan: Plan, names: Sequence[str]) -> tuple[Array, Array, dict[str, Array]]:
    """Return standard scores, weights and responses of all rows."""
    sampler = sampler_named(plan.spec.sampler)
    if not isinstance(sampler, InverseTransformSampler):
        raise SpecError(
            f"{plan.campaign_id}: samples of sampler {sampler.name} are not drawn from distributions, so they do not"
            ' show where rejects lie; run the campaign with sampler = "random"'
        )
    scores, weights = list[Array](), list[Array]()
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
    joined = {name: np.concatenate(pieces) for name, pieces in values.items()}
    return np.concatenate(scores), np.concatenate(weights), joined


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
    shift = {name: z for name, z in zip(names, aim.centre, strict=True) if z}
    table = {"share": round(aim.share, 4), "source": aim.source}
    return table | ({"shift": shift} if shift else {}) | ({"scale": aim.scale} if aim.scale != 1.0 else {})
