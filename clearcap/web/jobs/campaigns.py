"""Jobs that check a campaign's text, estimate its cost, plan it in the store, or extend a stored campaign.

Posted content is never used as a path: texts and the files that they name come with the call, and a mechanism saved in
the store is read by its name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from campaign.coordinator.run_time import known_seconds_per_run, seconds_per_run
from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import submit
from campaign.errors import SpecError
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan, make_plan
from campaign.spec.campaign_cautions import campaign_cautions
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import fault
from campaign.spec.load import Campaign, load_campaign_text
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.labels import LabelChange, read_labels
from campaign.store.mechanism_library import read_mechanism
from engine import simulate
from engine.mechanism import library_names
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes


@dataclass(frozen=True)
class CampaignSource:
    """The text of a campaign, and the files and mechanisms that it may name."""

    store: str  # address of the store; the text may name its saved mechanisms
    text: str
    files: Mapping[str, bytes] = field(default_factory=dict)  # content by name
    samples: int | None = None  # replaces that of the text, as does the seed
    seed: int | None = None
    most_samples: int = 100_000_000  # largest number of samples that is accepted

    def load(self, store: Store) -> Campaign:
        """Return the checked campaign; raise SpecError with its faults if it is invalid."""
        files = {**self.saved(store), **self.files}
        campaign = load_campaign_text(self.text, files, samples=self.samples, seed=self.seed)
        check_size(campaign.spec, self.most_samples)
        return campaign

    def saved(self, store: Store) -> Mapping[str, bytes]:
        """Return the text of the mechanism that the campaign names, by name, if it is saved in the store."""
        try:
            name = parse_toml(text_bytes(self.text)).get("mechanism")
        except UnfitToml:
            return MappingProxyType({})  # loading the text reports its faults
        if not isinstance(name, str) or name in self.files or name in library_names():
            return MappingProxyType({})
        found = read_mechanism(store, name)
        return MappingProxyType({} if found is None else {name: found.text.encode()})


def check_size(spec: CampaignSpec, most: int) -> None:
    """Raise SpecError if a campaign has more samples than users of this server may submit."""
    if spec.samples > most:
        text = f"more than this server takes; allowed: up to {most}; reduce it, or ask an admin for more"
        raise SpecError(f"samples = {spec.samples}: {text}", [fault(["samples"], spec.samples, text)])


def check_campaign_text(source: CampaignSource, tries_runs: bool = False) -> dict[str, Any]:
    """Check a campaign, and estimate its cost from runs in the store or, with `tries_runs`, from a few runs of its own.

    Keys: ``campaign`` (the id that it would have), ``exists`` (in the store), ``name``, ``title``, ``mechanism``,
    ``samples``, ``repeats`` (share of the samples), ``variables`` and ``responses`` (names), ``cautions``, and
    ``seconds_per_run`` (None if it is not known). Raises SpecError with the faults of the text.
    """
    store = open_store(source.store, QUICK)
    campaign = source.load(store)
    plan, spec = make_plan(campaign), campaign.spec
    seconds = seconds_per_run(plan, simulate) if tries_runs else known_seconds_per_run(store, plan)
    return {
        **_size(plan, seconds),
        "exists": plan.campaign_id in store.campaigns(),
        "name": spec.name,
        "title": spec.title or spec.name,
        "mechanism": spec.mechanism,
        "variables": list(spec.variables),
        "responses": list(spec.responses),
        "cautions": [str(caution) for caution in campaign_cautions(campaign)],
    }


def submit_text(source: CampaignSource, labels: LabelChange, by: str) -> dict[str, Any]:
    """Plan a campaign in the store and queue it, without simulating anything; an existing campaign stays unchanged.

    Keys: ``campaign``, ``is_new``, ``owner``, ``samples``, ``repeats``, ``seconds_per_run``, ``reuse``.
    """
    store = open_store(source.store, QUICK)
    return _submitted(store, source.load(store), labels, by)


def extend_campaign(store: str, campaign_id: str, samples: int, most: int, by: str) -> dict[str, Any]:
    """Plan and queue a campaign with the same spec but more samples; rows that the store has are reused.

    `samples` is the total and at most `most`; the user `by` becomes the owner. The result is that of `submit_text`.
    Raises SpecError if the campaign has that many samples already, or cannot have that many.
    """
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
    return _submitted(opened, Campaign(spec, plan.mechanism), labels, by)


def _submitted(store: Store, campaign: Campaign, labels: LabelChange, by: str) -> dict[str, Any]:
    """Plan a campaign, queue it if it is not queued yet, and return the document of `submit_text`."""
    is_new = make_plan(campaign).campaign_id not in store.campaigns()
    plan = submit(store, campaign, labels=labels, tries_runs=False, by=by)
    if state_of(store, plan.campaign_id)["state"] == "planned":  # the process that planned it was killed
        write_state(store, plan.campaign_id, "queued")
    owner = read_labels(store, plan.campaign_id).owner
    reuse = sampler_named(campaign.spec.sampler).not_extendable or ""
    return {**_size(plan, known_seconds_per_run(store, plan)), "is_new": is_new, "owner": owner, "reuse": reuse}


def _size(plan: Plan, seconds: float | None) -> dict[str, Any]:
    """Return the id of a campaign and the numbers that determine its cost."""
    samples = plan.spec.samples
    return {"campaign": plan.campaign_id, "samples": samples, "repeats": plan.repeats, "seconds_per_run": seconds}
