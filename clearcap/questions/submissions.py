"""Check a campaign's text, estimate its cost, plan it in the store, or extend a stored campaign.

The functions are also jobs of a server: they get the address of a store and return plain data. Posted content is never
used as a path: texts and the files that they name come with the call; a saved mechanism is read by its name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field

from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import known_seconds_per_run, seconds_per_run, submit
from campaign.errors import SpecError
from campaign.inputs.distributions import Distribution
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan, make_plan
from campaign.spec.campaign_cautions import campaign_cautions
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import fault
from campaign.spec.load import Campaign, load_campaign_text
from campaign.spec.named_files import LARGEST_TOTAL
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.labels import LabelChange, read_labels
from campaign.store.mechanism_library import read_mechanism
from engine import simulate
from engine.mechanism import library_names
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes
from reporting import format_numbers

REPEATED_TIMES = 2.0  # duration of a repeat, which has half the step, relative to that of its run


class RunCost(BaseModel):
    """The cost of a campaign."""

    runs: int = Field(description="Samples, and those of them that are repeated with half the step", examples=[515])
    seconds_per_run: float | None = Field(description="Of one worker; null if it is not known", examples=[0.03])
    workers: int | None = Field(description="Those of this server; null if others compute", examples=[2])
    seconds: float | None = Field(description="All runs on these workers, or on one", examples=[8.0])
    text: str = Field(description="The same in words", examples=["515 runs, about 8 s on 2 workers"])


class CheckedCampaign(BaseModel):
    """A campaign without faults."""

    campaign: str = Field(description="The id that it would have", examples=["demo-0a1b2c3d4e"])
    exists: bool = Field(description="The store has it already")
    name: str
    title: str
    mechanism: str
    samples: int
    variables: list[str]
    responses: list[str]
    cautions: list[str] = Field(description="Warnings: what looks wrong, but can be computed")
    cost: RunCost


class SubmittedCampaign(BaseModel):
    """A campaign that is in the store."""

    campaign: str = Field(description="Its id", examples=["demo-0a1b2c3d4e"])
    is_new: bool = Field(description="It was not in the store before")
    owner: str = Field(description="Whose it is", examples=["eva"])
    samples: int
    cost: RunCost
    note: str = ""


@dataclass(frozen=True)
class Capacity:
    """What a server allows to compute; without a server there is no bound."""

    most_samples: int = 100_000_000
    workers: int | None = None


@dataclass(frozen=True)
class CampaignSource:
    """The text of a campaign, and the files and mechanisms that it may name."""

    store: str  # address of the store; the text may name its saved mechanisms
    text: str
    files: Mapping[str, bytes | Path] = field(default_factory=dict)  # content by name, or where it is
    samples: int | None = None  # replaces that of the text, as does the seed
    seed: int | None = None
    most_samples: int = 100_000_000  # largest number of samples that is accepted
    workers: int | None = None  # those of this server; None if others compute

    def load(self, store: Store) -> Campaign:
        """Return the checked campaign; raise SpecError with its faults if it is invalid."""
        campaign = load_campaign_text(self.text, self.contents(store), samples=self.samples, seed=self.seed)
        check_size(campaign.spec, self.most_samples)
        return campaign

    def contents(self, store: Store) -> dict[str, bytes]:
        """Return the content of each file that the text may name, and of the mechanism if it is saved in the store."""
        given = {
            name: each if isinstance(each, bytes) else read_regular_file(each, LARGEST_TOTAL)
            for name, each in self.files.items()
        }
        try:
            name = parse_toml(text_bytes(self.text)).get("mechanism")
        except UnfitToml:
            return given  # loading the text reports its faults
        if not isinstance(name, str) or name in given or name in library_names():
            return given
        saved = read_mechanism(store, name)
        return given if saved is None else {name: saved.text.encode(), **given}


def check_size(spec: CampaignSpec, most: int) -> None:
    """Raise SpecError if a campaign has more samples, or may need more runs to be decided, than this server takes."""
    deciding = 0 if spec.decide is None else spec.decide.runs  # the usual number is no request
    for key, count in (("samples", spec.samples), ("decide.runs", deciding)):
        if count > most:
            text = f"more than this server takes; allowed: up to {most}; reduce it, or ask an admin for more"
            raise SpecError(f"{key} = {count}: {text}", [fault(key.split("."), count, text)])


def check_campaign_text(source: CampaignSource, tries_runs: bool = False) -> dict[str, Any]:
    """Return the `CheckedCampaign`, with the cost of runs in the store or, with `tries_runs`, of a few of its own."""
    store = open_store(source.store, QUICK)
    campaign = source.load(store)
    plan, spec = make_plan(campaign), campaign.spec
    seconds = seconds_per_run(plan, simulate) if tries_runs else known_seconds_per_run(store, plan)
    return CheckedCampaign(
        campaign=plan.campaign_id,
        exists=plan.campaign_id in store.campaigns(),
        name=spec.name,
        title=spec.title or spec.name,
        mechanism=spec.mechanism,
        samples=spec.samples,
        variables=list(spec.variables),
        responses=list(spec.responses),
        cautions=[str(caution) for caution in campaign_cautions(campaign)],
        cost=run_cost(plan, seconds, source.workers),
    ).model_dump()


def submit_text(source: CampaignSource, labels: LabelChange, by: str) -> dict[str, Any]:
    """Plan a campaign in the store and queue it, without simulating anything; an existing campaign stays unchanged."""
    store = open_store(source.store, QUICK)
    return _submitted(store, source.load(store), labels, by, source.workers).model_dump()


def extend_campaign(
    store: str, campaign_id: str, samples: int, most: int, by: str, workers: int | None
) -> dict[str, Any]:
    """Plan and queue a campaign with the same spec but more samples in total; rows that the store has are reused."""
    opened = open_store(store, QUICK)
    plan = opened.plan(campaign_id)
    if samples <= plan.spec.samples:
        raise SpecError(f"samples = {samples}: campaign {campaign_id} has {plan.spec.samples} already; ask for more")
    stop = plan.spec.stop
    if stop is not None and stop.max_samples is not None:
        stop = stop.model_copy(update={"max_samples": samples})
    document = plan.spec.model_copy(update={"samples": samples, "stop": stop}).model_dump(exclude_none=True)
    try:
        spec = CampaignSpec.model_validate(document)
    except ValueError as error:  # such as a grid, whose size follows from its levels
        raise SpecError(f"samples = {samples}: campaign {campaign_id} cannot have so many: {error}") from error
    check_size(spec, most)
    labels = LabelChange(add=read_labels(opened, campaign_id).tags)
    made = _submitted(opened, Campaign(spec, plan.mechanism), labels, by, workers)
    anew = sampler_named(spec.sampler).not_extendable
    if made.is_new and anew:
        made.note = f"all rows are computed again: {anew}"
    return made.model_dump()


def submit_changed(
    store: Store, plan: Plan, variables: Mapping[str, Distribution], by: str, capacity: Capacity
) -> SubmittedCampaign:
    """Plan and queue a campaign that differs from another only in the distributions of some variables."""
    spec = plan.spec.model_copy(update={"variables": {**plan.spec.variables, **variables}})
    return submit_related(store, plan, Campaign(spec, plan.mechanism), by, capacity)


def submit_related(store: Store, plan: Plan, campaign: Campaign, by: str, capacity: Capacity) -> SubmittedCampaign:
    """Plan and queue a campaign with the tags of the one that it belongs to."""
    check_size(campaign.spec, capacity.most_samples)
    labels = LabelChange(by or None, add=read_labels(store, plan.campaign_id).tags)
    return _submitted(store, campaign, labels, by, capacity.workers)


def _submitted(
    store: Store, campaign: Campaign, labels: LabelChange, by: str, workers: int | None
) -> SubmittedCampaign:
    """Plan a campaign, and queue it if it is not queued yet."""
    is_new = make_plan(campaign).campaign_id not in store.campaigns()
    plan = submit(store, campaign, labels=labels, tries_runs=False, by=by)
    if state_of(store, plan.campaign_id)["state"] == "planned":  # the process that planned it was killed
        write_state(store, plan.campaign_id, "queued")
    owner = read_labels(store, plan.campaign_id).owner
    return SubmittedCampaign(
        campaign=plan.campaign_id,
        is_new=is_new,
        owner=owner,
        samples=plan.spec.samples,
        cost=run_cost(plan, known_seconds_per_run(store, plan), workers),
        note="" if is_new else f"the store already had it; its owner is {owner or 'nobody'}",
    )


def run_cost(plan: Plan, seconds_per_run: float | None, workers: int | None) -> RunCost:
    """Return the cost of a campaign's runs on some workers; None for one of unknown speed."""
    samples, share = plan.spec.samples, plan.repeats
    runs = samples + round(samples * share)
    seconds, words = None, f"{format_numbers.grouped(runs)} runs"
    if seconds_per_run is None:
        words = f"{words}; run time unknown so far"
    else:
        seconds = seconds_per_run * samples * (1.0 + REPEATED_TIMES * share) / (workers or 1)
        where = f"on {workers or 1} worker{'' if workers in (1, None) else 's'}"
        words = f"{words}, about {format_numbers.duration(seconds)} {where}"
    return RunCost(runs=runs, seconds_per_run=seconds_per_run, workers=workers, seconds=seconds, text=words)
