"""A posted campaign, as JSON or as a form with files, such as curl and browsers send."""

import base64
import json
from hashlib import sha256
from typing import Annotated, Any

from fastapi import Depends, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile

from campaign.spec.named_files import MOST_FILES
from campaign.web.http.asking import CSRF_FIELD, FORMS
from campaign.web.http.problems import Refusal

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
