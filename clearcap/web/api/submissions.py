"""Calls that check the text of a campaign, submit it as JSON or as a form with files, or extend it by more samples."""

import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from tempfile import TemporaryDirectory
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
    """Yield the campaign that a request posts, as a dependency of a call; its large files exist until the answer.

    The refusal is 415 for a body of another type, 422 for a form with a duplicate file or one that is not text. Raises
    RequestValidationError if a value is not allowed.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    with TemporaryDirectory(prefix="clearcap-upload-") as folder:
        try:
            if kind == FORMS[0]:
                posted = CampaignRequest.model_validate(await _of_form(request, Path(folder)))
            elif kind == "application/json":
                posted = await run_in_threadpool(CampaignRequest.model_validate_json, await request.body())
            else:
                sent = kind or "none"
                raise Refusal(
                    415, f"content-type {sent:.100}: send application/json, or multipart/form-data with files"
                )
        except ValidationError as error:
            raise RequestValidationError(error.errors(include_url=False)) from error
        yield posted


async def _of_form(request: Request, folder: Path) -> dict[str, Any]:
    """Return the values of a form: the file ``campaign``, any number of ``files``, and the other fields."""
    form = await request.form(max_files=MOST_FILES + 1, max_fields=MOST_FIELDS, max_part_size=4 * LONGEST_TEXT)
    try:
        return await _values(form, folder)
    finally:
        await form.close()


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
    with path.open("xb") as file:
        shutil.copyfileobj(sent.file, file)
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
