"""Submission of a campaign, or of more samples of one; a request that is repeated with its key gets the same answer."""

import base64
import json
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from hashlib import file_digest, sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import Depends, Header, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, BeforeValidator, Field, InstanceOf, ValidationError, WithJsonSchema
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.responses import Response

from campaign.coordinator.state import STATES
from campaign.errors import SpecError
from campaign.spec.named_files import MOST_FILES
from campaign.store.labels import LabelChange
from clearcap.questions.submissions import (
    CampaignSource,
    CheckedCampaign,
    SubmittedCampaign,
    check_campaign_text,
    submit_text,
)
from clearcap.questions.submissions import extend_campaign as plan_extension
from clearcap.web.access import Principal
from clearcap.web.access.database import Database
from clearcap.web.http.authentication import CSRF_FIELD, FORMS, Engineer, TheCampaign, TheService
from clearcap.web.http.responses import Refusal
from clearcap.web.operations import Sent, keep_upload
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.settings import PREFIX
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


class CampaignRequest(Sent):
    """A campaign to be checked or computed."""

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
        service, who, plan_extension, address, campaign, samples, settings.limits.samples, who.name, settings.workers
    )


async def _made(service: Service, who: Principal, job: Any, *arguments: Any) -> SubmittedCampaign:
    """Let a job plan a campaign, unless the user has too many unfinished ones."""
    async with place_in_queue(service, who):
        made = await service.pool.data(who.name, job, *arguments)
    await service.watcher.list_campaigns(made["campaign"])
    return SubmittedCampaign.model_validate(made)


@asynccontextmanager
async def place_in_queue(service: Service, who: Principal, campaign: str = "") -> AsyncIterator[None]:
    """Hold a place for one more unfinished campaign, as each way into the queue must; refuse (429) too many."""
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
        """Note that a request begins; return status and text if it was answered; KeyTaken if it was another."""
        at = time.time() if now is None else now
        with self._database.write() as connection:
            connection.execute("DELETE FROM idempotency WHERE time < ?", (at - KEPT,))
            statement = "SELECT question, status, answer FROM idempotency WHERE key = ? AND user = ?"
            found = connection.execute(statement, (key, user)).fetchone()
            if found is None:
                values = (key, user, question, _IN_WORK, at)
                connection.execute("INSERT INTO idempotency VALUES (?, ?, ?, ?, '', ?)", values)
                return None
        if found["question"] != question:
            raise KeyTaken(f"Idempotency-Key {key!r:.80}: was sent with other content before; use a new key")
        return None if found["status"] == _IN_WORK else (found["status"], found["answer"])

    def keep(self, user: str, key: str, status: int, answer: str) -> tuple[int, str]:
        """Keep the answer to a request and return it; return the first one if the request was sent twice at once."""
        statement = "UPDATE idempotency SET status = ?, answer = ? WHERE key = ? AND user = ? AND status = ?"
        self._database.change(statement, status, answer, key, user, _IN_WORK)
        kept = self._database.row("SELECT status, answer FROM idempotency WHERE key = ? AND user = ?", key, user)
        return (status, answer) if kept is None else (kept["status"], kept["answer"])

    def release(self, user: str, key: str) -> None:
        """Forget the key of a refused request, so that the corrected request may use the same key."""
        statement = "DELETE FROM idempotency WHERE key = ? AND user = ? AND status = ?"
        self._database.change(statement, key, user, _IN_WORK)


MOST_FIELDS = 60
LARGEST_IN_MEMORY = 2**20  # bytes of a file that is sent along; a job reads larger ones from the disk
_FORM_SCHEMA = {
    "type": "object",
    "required": ["campaign"],
    "properties": {
        "campaign": {"type": "string", "description": "The campaign file, as a file or a text"},
        "files": {"type": "array", "items": {"type": "string", "format": "binary"}},
        "samples": {"type": "integer"},
        "seed": {"type": "integer"},
        "owner": {"type": "string"},
        "tags": {"type": "array", "items": {"type": "string"}},
    },
}
POSTED = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": CampaignRequest.model_json_schema(), "example": {"text": EXAMPLE}},
            "multipart/form-data": {"schema": _FORM_SCHEMA},
        },
    }
}


async def posted_campaign(request: Request) -> AsyncIterator[CampaignRequest]:
    """Yield the campaign that a request posts, or refuse it (415, 422); its large files exist until the answer."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    with TemporaryDirectory(prefix="clearcap-upload-") as folder:
        try:
            if kind == FORMS[0]:
                limits = {"max_files": MOST_FILES + 1, "max_fields": MOST_FIELDS, "max_part_size": 4 * LONGEST_TEXT}
                async with request.form(**limits) as form:
                    posted = CampaignRequest.model_validate(await _values(form, Path(folder)))
            elif kind == "application/json":
                posted = await run_in_threadpool(CampaignRequest.model_validate_json, await request.body())
            else:
                words = f"content-type {kind or 'none':.100}: send application/json, or multipart/form-data with files"
                raise Refusal(415, words)
        except ValidationError as error:
            raise RequestValidationError(error.errors(include_url=False)) from error
        yield posted


async def _values(form: FormData, folder: Path) -> dict[str, Any]:
    """Return the values of a form's fields by the field names of `CampaignRequest`; large files go to a folder."""
    values: dict[str, Any] = {"files": {}, "tags": []}
    for key, value in form.multi_items():
        if key == "files":
            if not isinstance(value, UploadFile):
                raise Refusal(422, "files: must be a file; with curl: -F files=@latch.toml")
            if not value.filename and not value.size:
                continue  # a browser sends this for an empty field
            name = value.filename or ""
            if name in values["files"]:
                raise Refusal(422, f"files: {name!r:.100} is given twice; give it once")
            path = folder / str(len(values["files"]))
            values["files"][name] = await run_in_threadpool(_kept, value, path)
        elif key == "campaign":
            values["text"] = await _text(value)
        elif key == "tags":
            values["tags"].append(value)
        elif key != CSRF_FIELD:
            values[key] = value
    return values


def _kept(sent: UploadFile, path: Path) -> bytes | Path:
    """Return the content of a small file, or the path to which that of a large one was written."""
    if (sent.size or 0) <= LARGEST_IN_MEMORY:
        return sent.file.read()
    keep_upload(sent, path)
    return path


async def _text(value: UploadFile | str) -> str:
    """Return the text of a field or a file."""
    if isinstance(value, str):
        return value
    try:
        return (await value.read(4 * LONGEST_TEXT + 1)).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(422, f"campaign: is not UTF-8 text ({error.reason} at byte {error.start})") from error


PostedCampaign = Annotated[CampaignRequest, Depends(posted_campaign)]


async def check_campaign(service: TheService, who: Engineer, wanted: PostedCampaign) -> CheckedCampaign:
    """Check the text of a campaign; return its cautions and cost, or its faults with key and line as a problem."""
    found = await service.pool.data(who.name, check_campaign_text, source_of_request(service, wanted))
    return CheckedCampaign.model_validate(found)


async def submit_campaign(
    service: TheService,
    who: Engineer,
    wanted: PostedCampaign,
    key: Annotated[
        str | None,
        Header(
            alias="Idempotency-Key",
            min_length=1,
            max_length=200,
            description="The same key and content give the same answer for a day, however often they are sent",
        ),
    ] = None,
) -> Response:
    """Submit a campaign; it is planned and queued, and the coordinator that serves the store computes it."""
    if key is None:
        return _answer(await submit(service, who, wanted))
    keys = RequestKeys(service.database)
    digest = await run_in_threadpool(wanted.digest)
    known = await run_in_threadpool(keys.claim, who.name, key, digest)
    if known is not None:
        return _answer(SubmittedCampaign.model_validate_json(known[1]), known[0])
    try:
        made = await submit(service, who, wanted)
    except BaseException:
        keys.release(who.name, key)
        raise
    status, text = await run_in_threadpool(
        keys.keep, who.name, key, 201 if made.is_new else 200, made.model_dump_json()
    )
    return _answer(SubmittedCampaign.model_validate_json(text), status)


async def extend_campaign(service: TheService, campaign: TheCampaign, who: Engineer, wanted: MoreSamples) -> Response:
    """Submit a campaign with more samples of the same spec; the rows that the store has are reused."""
    return _answer(await extend(service, campaign, who, wanted.samples))


def _answer(made: SubmittedCampaign, status: int | None = None) -> Response:
    """Return the answer to a submission."""
    headers = {"Location": f"{PREFIX}/campaigns/{made.campaign}"}
    return Response(made.model_dump_json(), status or (201 if made.is_new else 200), headers, "application/json")
