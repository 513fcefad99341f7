"""Problem details (RFC 9457): every refusal says what is wrong, where, and what to do, as the command line does."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from http import HTTPStatus
from typing import Any

from pydantic import BaseModel, Field

from campaign.errors import CampaignError, SpecError, StoreError
from clearcap.web.answers.engine_warm_up import EngineCompiling
from clearcap.web.answers.fair_queue import Busy
from clearcap.web.answers.job_limits import JobFailed, JobPostponed, JobTooLarge
from engine import EngineError
from engine.faults.fault import Fault

MEDIA_TYPE = "application/problem+json"
MOST_FAULTS, _LONGEST_VALUE = 100, 80
PAGE_RELOADS = 5  # s after which a page that waits for the engine reloads itself
WITHOUT_PROBLEM = (206, 304, 416)  # statuses of answers that are not refusals or have no body


class Refusal(Exception):
    """The refusal of a request: HTTP status, explanation for the user, faults of what was sent, more headers.

    A page that shows it reloads itself after `reload_after_s`; None if it does not.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        faults: list[dict[str, Any]] | None = None,
        headers: dict[str, str] | None = None,
        reload_after_s: int | None = None,
    ) -> None:
        super().__init__(detail)
        self.reload_after_s = reload_after_s
        self.status, self.detail, self.faults, self.headers = status, detail, faults or [], headers or {}


class FieldFault(BaseModel):
    """A fault of the content that was sent."""

    keys: list[str] = Field(description="Tables and key, from the outside in", examples=[["variables", "J1", "std"]])
    text: str = Field(description="What is wrong, what is allowed, and the remedy")
    value: str | None = Field(None, description="The value at fault", examples=["-0.1"])
    line: int | None = Field(None, description="Line in the text that was sent, from 1")
    file: str | None = Field(None, description="Name of the file that the text names, if it is that one which is wrong")


class Problem(BaseModel):
    """Problem details, RFC 9457."""

    type: str = Field("about:blank", description="Kind of the problem")
    title: str = Field(description="The status in words", examples=["Not Found"])
    status: int = Field(description="Status of the answer", examples=[404])
    detail: str = Field(description="What is wrong and what to do", examples=["no campaign c60-1 in the store"])
    faults: list[FieldFault] = Field(default=[], description="Faults of what was sent, each with its key")


def problem(status: int, detail: str, faults: list[dict[str, Any]] | None = None) -> Problem:
    """Return the problem details of a refusal."""
    marked = [FieldFault.model_validate(fault) for fault in faults or []]
    return Problem(title=HTTPStatus(status).phrase, status=status, detail=sendable(detail), faults=marked)


def sendable(text: str) -> str:
    """Return a text with lone surrogates escaped, such as those of a file name that is not UTF-8."""
    return text.encode(errors="backslashreplace").decode()


def refusal_of(error: Exception) -> Refusal | None:
    """Return the refusal for an error of clearcap, with 4xx only if the user can fix it; None if the error is a bug."""
    if isinstance(error, Refusal):
        return error
    if isinstance(error, Busy):
        return Refusal(429, str(error), headers={"Retry-After": str(error.retry_after_s)})
    if isinstance(error, EngineCompiling):
        headers = {"Retry-After": str(error.retry_after_s)}
        return Refusal(503, str(error), headers=headers, reload_after_s=PAGE_RELOADS)
    if isinstance(error, StoreError | JobPostponed):
        return Refusal(503, str(error), headers={"Retry-After": "10"})
    if isinstance(error, JobFailed) and not isinstance(error, JobTooLarge):
        return Refusal(500, str(error))
    if isinstance(error, SpecError | EngineError | JobTooLarge):
        return Refusal(422, str(error), faults_of(error))
    if isinstance(error, CampaignError):
        return Refusal(409, str(error))
    return None


def faults_of(error: Exception) -> list[dict[str, Any]]:
    """Return the faults that an error lists; faults of a file follow the fault of the text that refers to the file.

    Its ``faults`` are `engine.faults.fault.Fault` objects, or dicts of their fields if another process sent them.
    """
    faults = getattr(error, "faults", None) or ()
    return _listed([asdict(each) if isinstance(each, Fault) else each for each in faults], None)


def _listed(faults: Iterable[Mapping[str, Any]], file: str | None) -> list[dict[str, Any]]:
    """Return the faults of a text or a file, each followed by the faults within it."""
    found = []
    for fault in faults:
        value = fault.get("value")
        shown = None if value is None or isinstance(value, dict | list) else str(value)[:_LONGEST_VALUE]
        keys, line = list(map(str, fault["keys"])), fault.get("line")
        found.append({"keys": keys, "text": fault["text"], "value": shown, "line": line, "file": file})
        found += _listed(fault.get("within") or (), shown)
    return found[:MOST_FAULTS]


def described(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI documentation of a call's refusals and of its answers without a body."""
    content = {MEDIA_TYPE: {"schema": {"$ref": f"#/components/schemas/{Problem.__name__}"}}}
    return {
        status: {"description": HTTPStatus(status).phrase} | ({} if status in WITHOUT_PROBLEM else {"content": content})
        for status in sorted(statuses)
    }


def problem_schemas() -> dict[str, Any]:
    """Return the schemas of problem details, which `described` refers to, for the OpenAPI components."""
    schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    return {**schema.pop("$defs"), Problem.__name__: schema}
