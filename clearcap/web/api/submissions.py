"""Calls that check the text of a campaign, submit it as JSON or as a form with files, or extend it by more samples."""

from typing import Annotated, Any

from fastapi import Depends, Header, Request
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.responses import Response

from campaign.spec.named_files import MOST_FILES
from clearcap.questions.submissions import (
    CheckedCampaign,
    SubmittedCampaign,
    check_campaign_text,
)
from clearcap.web.api.calls import ROUTERS
from clearcap.web.http.authentication import CSRF_FIELD, FORMS, Engineer, TheCampaign, TheService
from clearcap.web.http.problems import Refusal, described
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from clearcap.web.operations.submissions import (
    EXAMPLE,
    CampaignRequest,
    MoreSamples,
    RequestKeys,
    extend,
    source_of_request,
    submit,
)
from clearcap.web.settings import PREFIX

MOST_FIELDS = 60
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
_MADE: dict[int | str, dict[str, Any]] = {
    200: {"model": SubmittedCampaign, "description": "The store already had it"},
    201: {"headers": {"Location": {"schema": {"type": "string"}, "description": "The campaign"}}},
}


@ROUTERS["campaigns"].post("/checks/campaign", openapi_extra=POSTED, responses=described(409, 415))
async def check_campaign(service: TheService, who: Engineer, wanted: PostedCampaign) -> CheckedCampaign:
    """Check the text of a campaign; return its cautions and cost, or its faults with key and line as a problem."""
    found = await service.pool.data(who.name, check_campaign_text, source_of_request(service, wanted))
    return CheckedCampaign.model_validate(found)


@ROUTERS["campaigns"].post(
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
    status, text = await run_in_threadpool(keys.keep, who.name, key, _status(made), made.model_dump_json())
    return _answer(SubmittedCampaign.model_validate_json(text), status)


@ROUTERS["campaigns"].post(
    "/campaigns/{campaign}/extend",
    name="extend",
    status_code=201,
    response_model=SubmittedCampaign,
    responses={**_MADE, **described(404, 409)},
)
async def extend_campaign(service: TheService, campaign: TheCampaign, who: Engineer, wanted: MoreSamples) -> Response:
    """Submit a campaign with more samples of the same spec; the rows that the store has are reused."""
    return _answer(await extend(service, campaign, who, wanted.samples))


def _status(made: SubmittedCampaign) -> int:
    return 201 if made.is_new else 200


def _answer(made: SubmittedCampaign, status: int | None = None) -> Response:
    """Return the answer to a submission."""
    headers = {"Location": f"{PREFIX}/campaigns/{made.campaign}"}
    return Response(made.model_dump_json(), status or _status(made), headers, "application/json")
