"""The entry of a campaign in the list of campaigns, with the conclusions of its report."""

import logging
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from campaign.coordinator.heartbeat import observe
from campaign.coordinator.state import STATES
from campaign.errors import CampaignError
from campaign.store import Store
from campaign.store.labels import read_labels
from campaign.store.layout import REPORT, SUBMISSION
from reporting.capability.verdict import WORST_FIRST

Interval = tuple[float, float]
logger = logging.getLogger(__name__)
REPORT_DOCUMENT = f"{REPORT}/capability.json"
# Campaigns with too few ok samples have no verdict on any response, which is worse than any.
_WORST_FIRST = ("no verdict", *WORST_FIRST[:-1], "constant", "capable")
LISTED_STATES = (*STATES, "incomplete", "planned", "broken")


class Weakest(BaseModel):
    """The response with the smallest index, which is that of its verdict once there is a report, until then Cpk."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval | None = Field(None, examples=[(1.18, 1.24)])


class BelowTarget(BaseModel):
    """A response whose index is below the target with its whole interval."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval = Field(examples=[(1.18, 1.24)])
    target: float = Field(examples=[1.33])


class _Spec(BaseModel):
    name: str
    requirement: float | None = None


class _Capability(BaseModel):
    cpk: float | None
    cpk_interval: tuple[float | None, float | None] | None

    @property
    def interval(self) -> Interval | None:
        """The interval of Cpk; None if it lacks an end."""
        low, high = self.cpk_interval or (None, None)
        return None if low is None or high is None else (low, high)


class _Response(BaseModel):
    spec: _Spec
    capability: _Capability
    index: float | None = None  # that decides; absent from reports of earlier versions, which have Cpk
    index_low: float | None = None
    index_high: float | None = None
    verdict: str = "no limits"
    certain: bool | None = None

    @property
    def decides(self) -> tuple[float | None, Interval | None]:
        """The index that decides, and its interval; None if it lacks an end."""
        if self.index is None:
            return self.capability.cpk, self.capability.interval
        if self.index_low is None or self.index_high is None:
            return self.index, None
        return self.index, (self.index_low, self.index_high)


class _Yield(BaseModel):
    share: float


class _ProductYield(BaseModel):
    with_failures: _Yield | None
    counted: _Yield


class _Thresholds(BaseModel):
    capable: float


class Conclusions(BaseModel):
    """The conclusions of a report, read from its ``capability.json``."""

    headline: str
    responses: list[_Response]
    product: _ProductYield | None
    thresholds: _Thresholds

    @property
    def weakest(self) -> Weakest | None:
        """The response with the smallest index; None if no response has one."""
        return weakest_of({r.spec.name: r.decides for r in self.responses})

    @property
    def below_target(self) -> list[BelowTarget]:
        """The responses whose index is below the target with its whole interval."""
        usual = self.thresholds.capable
        known = [(r.spec.name, *r.decides, r.spec.requirement or usual) for r in self.responses]
        return [
            BelowTarget(response=name, cpk=index, interval=interval, target=target)
            for name, index, interval, target in known
            if index is not None and interval is not None and interval[1] < target
        ]

    @property
    def verdict(self) -> str:
        """The worst verdict, such as "not capable" or "capable, not certain"; empty without a response with limits."""
        words = [r.verdict + ("" if r.certain is not False else ", not certain") for r in self.responses]
        known = [word for word in words if word in _WORST_FIRST]
        return min(known, key=_WORST_FIRST.index, default="")

    @property
    def share_ok(self) -> float | None:
        """Share of the product within all limits; failed runs count as outside if the report has that share."""
        return None if self.product is None else (self.product.with_failures or self.product.counted).share


def weakest_of(indices: Mapping[str, tuple[float | None, Interval | None]]) -> Weakest | None:
    """Return the response with the smallest Cpk of those given with their intervals; None if no response has a Cpk."""
    known = [(cpk, name, interval) for name, (cpk, interval) in indices.items() if cpk is not None]
    if not known:
        return None
    cpk, name, interval = min(known, key=lambda each: each[0])
    return Weakest(response=name, cpk=cpk, interval=interval)


class CampaignEntry(BaseModel):
    """The entry of a campaign in the list of campaigns."""

    campaign: str = Field(description="Id of the campaign", examples=["c60-0a1b2c3d4e"])
    title: str = Field("", examples=["Schneider C-60"])
    state: str = Field(
        description=f"{', '.join(LISTED_STATES[:-1])} or {LISTED_STATES[-1]}",
        examples=["completed"],
    )
    message: str = Field("", description="Details of the state, or what is wrong with a broken campaign")
    since: datetime | None = Field(None, description="When the state began")
    samples: int | None = Field(None, description="Rows that are planned", examples=[30850])
    done: int | None = Field(None, description="Rows that are stored", examples=[30850])
    ok: int | None = Field(None, description="Rows with status ok", examples=[30850])
    failed: int | None = Field(None, description="Rows with another status", examples=[0])
    left: int | None = Field(None, description="Rows that are to be computed", examples=[0])
    share_ok: float | None = Field(None, description="Share of the product within all limits", examples=[0.9987])
    weakest: Weakest | None = Field(None, description="Smallest Cpk of the report, or of the rows so far")
    below_target: list[BelowTarget] = Field([], description="Of the report: the Cpk's upper end is below 1.33")
    headline: str = Field("", description="What the report concludes")
    verdict: str = Field(
        "", description="The worst verdict of the report; empty without one", examples=["capable, not certain"]
    )
    has_report: bool = Field(False, description="A report is written")
    decided_by: list[str] = Field(
        [], description="Campaigns whose runs aim at rejects and decide this one", examples=[["c60-rare-4b5c6d7e8f"]]
    )
    submitted_by: str = ""
    submitted_at: datetime | None = None
    owner: str = Field("", examples=["eva"])
    tags: list[str] = Field(default=[], examples=[["c60", "release-3"]])
    note: str = ""
    archived: bool = False
    labels_version: int = Field(0, description="Send it back with a change, so that no other change is lost")


def entry_of(store: Store, campaign_id: str) -> CampaignEntry:
    """Read the list entry of a campaign; the entry of a broken campaign says what is wrong with it."""
    try:
        return _entry(Store(store.files.listed(campaign_id)), campaign_id)
    except CampaignError as error:
        return CampaignEntry(campaign=campaign_id, state="broken", message=str(error))
    except Exception as error:  # a fault in one campaign must not hide the others
        logger.exception("campaign %s cannot be listed", campaign_id)
        message = f"it cannot be listed, because of a bug in clearcap: {error!r:.200}"
        return CampaignEntry(campaign=campaign_id, state="broken", message=message)


def _entry(store: Store, campaign_id: str) -> CampaignEntry:
    """Return the entry of a campaign; raise CampaignError if the campaign is broken."""
    header, seen = store.plan_header(campaign_id), observe(store, campaign_id)
    labels = read_labels(store, campaign_id)
    entry = CampaignEntry(
        campaign=campaign_id, title=header.title, state=seen.state, message=seen.message, since=_date(seen.since)
    )
    submission = store.read_json(campaign_id, SUBMISSION) or {}
    entry.submitted_by, entry.submitted_at = str(submission.get("user", ""))[:200], _date(submission.get("time"))
    entry.owner, entry.tags, entry.note = labels.owner, list(labels.tags), labels.note
    entry.archived, entry.labels_version = labels.archived, labels.version
    entry.decided_by = store.decided_by([campaign_id])
    if seen.state == "running" and seen.heartbeat is not None:
        # a running campaign is read at each look, so its counts are those of the heartbeat and not of a survey of all
        # files
        beat = seen.heartbeat
        entry.samples, entry.done, entry.ok = beat.samples, beat.done, beat.ok
        entry.failed, entry.left = beat.failed, beat.left
        entry.weakest = weakest_of({name: (r["cpk"], None) for name, r in beat.responses.items()})
        return entry
    survey, entry.samples = store.survey(header), store.end(header)
    entry.done, entry.ok = survey.rows, survey.statuses.get("ok", 0)
    entry.failed, entry.left = header.failed(survey.statuses), entry.samples - entry.done
    if entry.state == "completed" and entry.left:
        entry.state, entry.message = "incomplete", f"rows lost after the campaign was completed: {entry.left}"
    _add_report(entry, _report(store, campaign_id))
    return entry


def _report(store: Store, campaign_id: str) -> bytes | None:
    """Return the JSON document of a campaign's report; None if there is no report."""
    try:
        return store.files.read(f"{campaign_id}/{REPORT_DOCUMENT}")
    except FileNotFoundError:
        return None


def _add_report(entry: CampaignEntry, report: bytes | None) -> None:
    """Add the conclusions of a report to an entry, or a message if the report cannot be read."""
    if report is None:
        return
    entry.has_report = True
    try:
        concluded = Conclusions.model_validate_json(report)
    except ValidationError:
        entry.message = entry.message or "the report was written by another version, or damaged; write it again"
        return
    entry.headline, entry.share_ok = concluded.headline, concluded.share_ok
    entry.weakest, entry.below_target = concluded.weakest, concluded.below_target
    entry.verdict = concluded.verdict


def _date(seconds: Any) -> datetime | None:
    """Return a time [s since 1970] as a date; None if it is not a valid time."""
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    return datetime.fromtimestamp(seconds, UTC) if is_number and 0.0 < seconds < 3e10 else None
