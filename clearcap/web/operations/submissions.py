"""Submission of a campaign, or of more samples of one; a request that is repeated with its key gets the same answer."""

import base64
import json
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, InstanceOf, WithJsonSchema

from campaign.coordinator.state import STATES
from campaign.errors import SpecError
from campaign.spec.named_files import MOST_FILES
from campaign.store.labels import LabelChange
from clearcap.questions.submissions import (
    CampaignSource,
    SubmittedCampaign,
    extend_campaign,
    submit_text,
)
from clearcap.web.access import Principal
from clearcap.web.access.database import Database
from clearcap.web.http.problems import Refusal
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.web_service import Service

EXAMPLE = """\
format = 1
name = "demo"
mechanism = "c60"
samples = 500

[variables.J1]
mean = 0.07
std = 0.0175
lower = 0.01
upper = 0.13
"""
UNFINISHED = ("queued", "running", "interrupted")
assert set(UNFINISHED) <= set(STATES)


def _decoded(value: Any) -> bytes | Path:
    """Return the content of a file that was sent in base64, or where it is; raise ValueError if it is not base64."""
    if isinstance(value, bytes | Path):
        return value
    if not isinstance(value, str):
        raise ValueError("must be a text in base64")
    try:
        return base64.b64decode(value, validate=True)
    except ValueError as error:
        raise ValueError(f"is not base64 ({error})") from error


def _no_truth(value: Any) -> Any:
    """Return a value, but raise ValueError for a boolean, because JSON's true would count as 1."""
    if isinstance(value, bool):
        raise ValueError("must be a whole number, not true or false")
    return value


Number = Annotated[int, BeforeValidator(_no_truth)]
FileContent = Annotated[
    InstanceOf[bytes] | InstanceOf[Path],
    BeforeValidator(_decoded),
    WithJsonSchema({"type": "string", "format": "byte"}),
]


class CampaignRequest(BaseModel):
    """A campaign to be checked or computed."""

    model_config = ConfigDict(extra="forbid")
    text: str = Field(max_length=LONGEST_TEXT, description="Content of the campaign file, TOML", examples=[EXAMPLE])
    files: dict[str, FileContent] = Field(
        default={}, max_length=MOST_FILES, description="Content of each file that it names, in base64", examples=[{}]
    )
    samples: Number | None = Field(None, ge=1, le=100_000_000, description="Instead of those of the text")
    seed: Number | None = Field(None, ge=0, lt=2**63, description="Instead of that of the text")
    owner: str | None = Field(None, max_length=200, description="By default who submits it")
    tags: list[str] = Field(default=[], max_length=50, examples=[["release-3"]])

    def digest(self) -> str:
        """Return a digest that is equal for requests with equal content."""
        files = {name: _sha256(content) for name, content in self.files.items()}
        content = {**self.model_dump(exclude={"files"}), "files": files}
        return sha256(json.dumps(content, sort_keys=True).encode(errors="surrogatepass")).hexdigest()


def _sha256(content: bytes | Path) -> str:
    if isinstance(content, bytes):
        return sha256(content).hexdigest()
    with content.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


async def submit(service: Service, who: Principal, wanted: CampaignRequest) -> SubmittedCampaign:
    """Submit a campaign; refuse (429) if the user has as many unfinished campaigns as is allowed."""
    if wanted.owner:
        check_user(service, wanted.owner)
    labels = LabelChange(who.name if wanted.owner is None else wanted.owner, tuple(wanted.tags))
    return await _made(service, who, submit_text, source_of_request(service, wanted), labels, who.name)


def check_user(service: Service, owner: str) -> None:
    """Raise SpecError if the owner that a campaign is to have is no user."""
    user = service.users.get(owner)
    if user is None or user.is_disabled:
        raise SpecError(f"owner = {owner!r:.80}: no user has this name; give the campaign to one who has an account")


class MoreSamples(BaseModel):
    """The number of samples that a campaign is to have."""

    samples: int = Field(ge=1, le=100_000_000, description="In all", examples=[60])


async def extend(service: Service, campaign: str, who: Principal, samples: int) -> SubmittedCampaign:
    """Submit a campaign with more samples of the same spec; raise the errors of `submit`."""
    settings, address = service.settings, service.store.files.full_url
    return await _made(
        service, who, extend_campaign, address, campaign, samples, settings.limits.samples, who.name, settings.workers
    )


async def _made(service: Service, who: Principal, job: Any, *arguments: Any) -> SubmittedCampaign:
    """Let a job plan a campaign, unless the user has too many unfinished ones."""
    async with place_in_queue(service, who):
        made = await service.pool.data(who.name, job, *arguments)
    await service.watcher.list_campaigns(made["campaign"])
    return SubmittedCampaign.model_validate(made)


@asynccontextmanager
async def place_in_queue(service: Service, who: Principal, campaign: str = "") -> AsyncIterator[None]:
    """Hold a place for one more unfinished campaign in the block; each way into the queue needs it.

    Refuses (429) if the user has too many. A `campaign` that is to be queued again does not count beside its place.
    """
    # counted before the check, so that simultaneous submissions cannot exceed the limit together
    service.submitting[who.name] += 1
    try:
        await _check_unfinished(service, who, campaign)
        yield
        if campaign:  # before the place is given up, so that the next check counts it
            await service.watcher.list_campaigns(campaign)
    finally:
        service.submitting[who.name] -= 1


async def _check_unfinished(service: Service, who: Principal, campaign: str) -> None:
    """Raise Refusal (429) if too many unfinished campaigns, besides this one, were submitted by the user or are his."""
    most = service.settings.limits.running
    await service.watcher.list_all()
    others = [entry for entry, _ in service.watcher.index.entries() if entry.campaign != campaign]
    entries = [entry for entry in others if who.name in (entry.submitted_by, entry.owner)]
    unfinished = Counter(entry.state for entry in entries if entry.state in UNFINISHED)
    if unfinished.total() + service.submitting[who.name] > most:
        counts = ", ".join(f"{count} {state}" for state, count in unfinished.items()) or "others on their way"
        raise Refusal(
            429,
            f"{who.name} may have {most} unfinished campaigns, and has {counts}; wait for one, or cancel one",
            headers={"Retry-After": "60"},
        )


def source_of_request(service: Service, wanted: CampaignRequest) -> CampaignSource:
    """Return the source of a posted campaign for a job."""
    settings, address = service.settings, service.store.files.full_url
    most, workers = settings.limits.samples, settings.workers
    return CampaignSource(address, wanted.text, wanted.files, wanted.samples, wanted.seed, most, workers)


KEPT = 24 * 3600.0  # s
_IN_WORK = 0  # status of a request that is not answered yet


class KeyTaken(SpecError):
    """The key was sent before, with different content."""


class RequestKeys:
    """The idempotency keys in a server's database; each user has their own."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, user: str, key: str, question: str, now: float | None = None) -> tuple[int, str] | None:
        """Note that a request begins; return the status and text of its answer if it was answered before, else None.

        A request that was begun but not answered, because the server was killed, may begin again. `question` is a
        digest of the request's content. Raises KeyTaken if the key was sent with different content within the last day.
        """
        at = time.time() if now is None else now
        with self._database.write() as connection:
            connection.execute("DELETE FROM idempotency WHERE time < ?", (at - KEPT,))
            found = connection.execute(
                "SELECT question, status, answer FROM idempotency WHERE key = ? AND user = ?", (key, user)
            ).fetchone()
            if found is None:
                connection.execute(
                    "INSERT INTO idempotency VALUES (?, ?, ?, ?, '', ?)", (key, user, question, _IN_WORK, at)
                )
                return None
        if found["question"] != question:
            raise KeyTaken(f"Idempotency-Key {key!r:.80}: was sent with other content before; use a new key")
        return None if found["status"] == _IN_WORK else (found["status"], found["answer"])

    def keep(self, user: str, key: str, status: int, answer: str) -> tuple[int, str]:
        """Keep the answer to a request and return it; return the first one if the request was sent twice at once."""
        with self._database.write() as connection:
            connection.execute(
                "UPDATE idempotency SET status = ?, answer = ? WHERE key = ? AND user = ? AND status = ?",
                (status, answer, key, user, _IN_WORK),
            )
        kept = self._database.row("SELECT status, answer FROM idempotency WHERE key = ? AND user = ?", key, user)
        return (status, answer) if kept is None else (kept["status"], kept["answer"])

    def release(self, user: str, key: str) -> None:
        """Forget the key of a refused request, so that the corrected request may use the same key."""
        with self._database.write() as connection:
            connection.execute(
                "DELETE FROM idempotency WHERE key = ? AND user = ? AND status = ?", (key, user, _IN_WORK)
            )
