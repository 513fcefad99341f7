"""What measured lots have said of a campaign, each time they were looked at; the last one is what holds now."""

import re

from pydantic import BaseModel, Field, ValidationError

from campaign.errors import CampaignError, StoreError
from campaign.store.store import Store

FOLDER = "monitored"  # within the folder of the campaign
KEPT_FALLS = 50
_OF_THE_RECORD = {"number", "at", "by", "falls", "still_low"}
_FILE = re.compile(r"(\d{6})\.json")


class MonitoredVariable(BaseModel):
    """What measured parts say of the distribution of a variable."""

    variable: str = Field(examples=["J1"])
    parts: int = Field(description="Parts with a value", examples=[200])
    lots: int | None = Field(None, description="Lots that they are of; null if they are of none")
    family: str = Field("", description="The fitted distribution; empty if there is none", examples=["normal"])
    p: float | None = Field(None, description="Of its fit (Anderson and Darling)", examples=[0.4])
    before: str = Field(description="The distribution in the campaign, in words")
    now: str = Field("", description="The distribution of the parts, in words; empty if it stays")
    note: str = Field("", description="Why it stays, or what is to be known of the new one")


class MonitoredIndex(BaseModel):
    """A response under the distributions of the measured parts."""

    response: str = Field(examples=["FC-1"])
    by: str = Field("", description="`share`, of the rejects, or `cpk`; empty without an answer", examples=["cpk"])
    index: float | None = Field(None, examples=[1.41])
    interval: tuple[float, float] | None = Field(None, examples=[(1.36, 1.46)])
    requirement: float = Field(examples=[1.33])
    below: bool = Field(False, description="The whole interval lies below the requirement")
    refusal: str = Field("", description="Why the rows give no answer")
    emulated: str = Field("", description="Why an emulator gives it, not the weights; empty if they do")


class Fall(BaseModel):
    """A response whose index fell below its requirement."""

    number: int = Field(description="Of the measured parts that showed it", examples=[3])
    at: float = Field(description="Seconds since 1970")
    response: str
    index: float
    interval: tuple[float, float]
    requirement: float


class Monitored(BaseModel):
    """What some measured parts say of a campaign."""

    number: int = Field(ge=1, description="From 1, in the order in which they were looked at", examples=[3])
    at: float = Field(description="Seconds since 1970")
    by: str = Field("", description="Who sent them")
    table: str = Field("", description="Name of their table", examples=["night.csv"])
    sha256: str = Field("", description="Of the table")
    settings: list[str] = Field(description="The new distributions, as `whatif --set` takes them")
    variables: list[MonitoredVariable]
    responses: list[MonitoredIndex]
    campaign: str | None = Field(None, description="Campaign that computes what the rows do not answer")
    falls: list[Fall] = Field([], description="Of these parts and of earlier ones, the oldest first")
    still_low: list[str] = Field(
        [], description="Responses without an answer now that were below their requirement when they last had one"
    )


def read_monitored(store: Store, campaign_id: str) -> Monitored | None:
    """Return what the last parts said; None if none were looked at."""
    names = [name for name in store.files.names(f"{campaign_id}/{FOLDER}") if _FILE.fullmatch(name)]
    if not names:
        return None
    document = store.read_json(f"{campaign_id}/{FOLDER}", max(names))
    try:
        return Monitored.model_validate(document)
    except ValidationError as error:
        words = f"{campaign_id}/{FOLDER}/{max(names)} is not what clearcap wrote; restore or remove it"
        raise StoreError(f"store {store.url}: {words}") from error


def add_monitored(store: Store, campaign_id: str, new: Monitored, before: Monitored | None) -> Monitored:
    """Add what some parts say after what was read `before`, with the responses that fell below their requirement.

    What says the same of the same table, as when a request is repeated whose answer was lost, is not added again.
    """
    same = before and new.model_dump(exclude=_OF_THE_RECORD) == before.model_dump(exclude=_OF_THE_RECORD)
    if before and same and new.sha256:
        return before
    low = {each.response for each in before.responses if each.below}.union(before.still_low) if before else set[str]()
    number, earlier = (before.number + 1, before.falls) if before else (1, [])
    falls = [
        Fall.model_validate({**each.model_dump(), "number": number, "at": new.at})
        for each in new.responses
        if each.below and each.response not in low and each.index is not None and each.interval is not None
    ]
    # no answer is no rise, so that the next index below is no news
    silent = [each.response for each in new.responses if each.index is None and each.response in low]
    kept = {"number": number, "falls": [*earlier, *falls][-KEPT_FALLS:], "still_low": silent}
    added = new.model_copy(update=kept)
    if not store.create_json(f"{campaign_id}/{FOLDER}", f"{number:06d}.json", added.model_dump()):
        raise CampaignError(f"{campaign_id}: another table of parts was judged at the same time; send this one again")
    return added
