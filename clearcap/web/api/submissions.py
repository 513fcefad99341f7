"""Calls that check the text of a campaign, submit it as JSON or as a form with files, or extend it by more samples."""

import base64
import json
from collections import Counter
from hashlib import sha256
from typing import Annotated, Any

from fastapi import Depends, Header, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.responses import Response

from campaign.coordinator.state import STATES
from campaign.spec.named_files import MOST_FILES
from campaign.store.labels import LabelChange
from clearcap.questions.submissions import (
    CampaignSource,
    CheckedCampaign,
    SubmittedCampaign,
    check_campaign_text,
    extend_campaign,
    submit_text,
)
from clearcap.web.access import Principal
from clearcap.web.access.request_keys import RequestKeys
from clearcap.web.api.calls import PREFIX, TheCampaign, calls
from clearcap.web.http.authentication import CSRF_FIELD, FORMS, Engineer, TheService
from clearcap.web.http.problems import Refusal, described
from clearcap.web.web_service import Service

LONGEST_TEXT = 2**20  # characters
MOST_FIELDS = 60
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
router = calls("campaigns")
UNFINISHED = ("queued", "running", "interrupted")


def _decoded(value: Any) -> bytes:
    """Return the content of a file that was sent in base64; raise ValueError if it is not base64."""
    if isinstance(value, bytes):
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
FileContent = Annotated[bytes, BeforeValidator(_decoded), WithJsonSchema({"type": "string", "format": "byte"})]


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
        files = {name: sha256(content).hexdigest() for name, content in self.files.items()}
        content = {**self.model_dump(exclude={"files"}), "files": files}
        return sha256(json.dumps(content, sort_keys=True).encode(errors="surrogatepass")).hexdigest()


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


async def posted_campaign(request: Request) -> CampaignRequest:
    """Return the campaign that a request posts, as a dependency of a call.

    The refusal is 415 for a body of another type, 422 for a form with a duplicate file or one that is not text. Raises
    RequestValidationError if a value is not allowed.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    try:
        if kind == FORMS[0]:
            return CampaignRequest.model_validate(await _of_form(request))
        if kind == "application/json":
            return await run_in_threadpool(CampaignRequest.model_validate_json, await request.body())
    except ValidationError as error:
        raise RequestValidationError(error.errors(include_url=False)) from error
    raise Refusal(415, f"content-type {kind or 'none':.100}: send application/json, or multipart/form-data with files")


async def _of_form(request: Request) -> dict[str, Any]:
    """Return the values of a form: the file ``campaign``, any number of ``files``, and the other fields."""
    form = await request.form(max_files=MOST_FILES + 1, max_fields=MOST_FIELDS, max_part_size=4 * LONGEST_TEXT)
    try:
        return await _values(form)
    finally:
        await form.close()


async def _values(form: FormData) -> dict[str, Any]:
    """Return the values of a form's fields by the field names of `CampaignRequest`."""
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
            values["files"][name] = await value.read()
        elif key == "campaign":
            values["text"] = await _text(value)
        elif key == "tags":
            values["tags"].append(value)
        elif key != CSRF_FIELD:
            values[key] = value
    return values


async def _text(value: UploadFile | str) -> str:
    """Return the text of a field or a file."""
    if isinstance(value, str):
        return value
    try:
        return (await value.read()).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(422, f"campaign: is not UTF-8 text ({error.reason} at byte {error.start})") from error


PostedCampaign = Annotated[CampaignRequest, Depends(posted_campaign)]


assert set(UNFINISHED) <= set(STATES)


_MADE: dict[int | str, dict[str, Any]] = {
    200: {"model": SubmittedCampaign, "description": "The store already had it"},
    201: {"headers": {"Location": {"schema": {"type": "string"}, "description": "The campaign"}}},
}


@router.post("/checks/campaign", openapi_extra=POSTED, responses=described(409, 415))
async def check_campaign(service: TheService, who: Engineer, wanted: PostedCampaign) -> CheckedCampaign:
    """Check the text of a campaign; return its cautions and cost, or its faults with key and line as a problem."""
    found = await service.pool.data(who.name, check_campaign_text, source_of_request(service, wanted))
    return CheckedCampaign.model_validate(found)


@router.post(
    "/campaigns",
    status_code=201,
    response_model=SubmittedCampaign,
    openapi_extra=POSTED,
    responses={**_MADE, **described(409, 415)},
)
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
        return _answer(await submitted(service, who, wanted))
    keys = RequestKeys(service.database)
    digest = await run_in_threadpool(wanted.digest)
    known = await run_in_threadpool(keys.claim, who.name, key, digest)
    if known is not None:
        return _answer(SubmittedCampaign.model_validate_json(known[1]), known[0])
    try:
        made = await submitted(service, who, wanted)
    except BaseException:
        keys.release(who.name, key)
        raise
    status, text = await run_in_threadpool(keys.keep, who.name, key, _status(made), made.model_dump_json())
    return _answer(SubmittedCampaign.model_validate_json(text), status)


async def submitted(service: Service, who: Principal, wanted: CampaignRequest) -> SubmittedCampaign:
    """Submit a campaign; refuse (429) if the user has as many unfinished campaigns as is allowed.

    Raises CampaignError if the campaign has faults, or if the store cannot be written.
    """
    labels = LabelChange(who.name if wanted.owner is None else wanted.owner, tuple(wanted.tags))
    return await _made(service, who, submit_text, source_of_request(service, wanted), labels, who.name)


class MoreSamples(BaseModel):
    """The number of samples that a campaign is to have."""

    samples: int = Field(ge=1, le=100_000_000, description="In all", examples=[60])


@router.post(
    "/campaigns/{campaign}/extend",
    status_code=201,
    response_model=SubmittedCampaign,
    responses={**_MADE, **described(404, 409)},
)
async def extend(service: TheService, campaign: TheCampaign, who: Engineer, wanted: MoreSamples) -> Response:
    """Submit a campaign with more samples of the same spec; the rows that the store has are reused."""
    return _answer(await extended(service, campaign, who, wanted.samples))


async def extended(service: Service, campaign: str, who: Principal, samples: int) -> SubmittedCampaign:
    """Submit a campaign with more samples; raise the errors of `submitted`."""
    settings, address = service.settings, service.store.files.full_url
    return await _made(
        service, who, extend_campaign, address, campaign, samples, settings.limits.samples, who.name, settings.workers
    )


async def _made(service: Service, who: Principal, job: Any, *arguments: Any) -> SubmittedCampaign:
    """Let a job plan a campaign, unless the user has too many unfinished ones."""
    # counted before the check, so that simultaneous submissions cannot exceed the limit together
    service.submitting[who.name] += 1
    try:
        await _check_unfinished(service, who)
        made = await service.pool.data(who.name, job, *arguments)
    finally:
        service.submitting[who.name] -= 1
    await service.watcher.list_campaigns(made["campaign"])
    return SubmittedCampaign.model_validate(made)


async def _check_unfinished(service: Service, who: Principal) -> None:
    """Raise Refusal (429) if the user has too many unfinished campaigns, including those being submitted now."""
    most = service.settings.limits.running
    await service.watcher.list_all()
    entries = [entry for entry, _ in service.watcher.index.entries() if entry.submitted_by == who.name]
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


def _status(made: SubmittedCampaign) -> int:
    return 201 if made.is_new else 200


def _answer(made: SubmittedCampaign, status: int | None = None) -> Response:
    """Return the answer to a submission."""
    headers = {"Location": f"{PREFIX}/campaigns/{made.campaign}"}
    return Response(made.model_dump_json(), status or _status(made), headers, "application/json")
