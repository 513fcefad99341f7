"""What is answered: documents with an ETag, whole or in part, streams, refusals as problem details (RFC 9457).

Every refusal says what is wrong, where, and what to do, as the command line does.
"""

import re
from collections.abc import AsyncIterator, Iterable, Mapping
from dataclasses import asdict
from hashlib import sha256
from http import HTTPStatus
from typing import Any

from fastapi import Request
from pydantic import BaseModel, Field
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from campaign.errors import CampaignError, SpecError, StoreError
from clearcap.web.access import Principal
from clearcap.web.jobs.pool import Busy, EngineCompiling
from clearcap.web.jobs.process import JobFailed, JobPostponed, JobTooLarge
from clearcap.web.web_service import Service
from engine import EngineError
from engine.errors import Fault

MEDIA_TYPE = "application/problem+json"
MOST_FAULTS, _LONGEST_VALUE = 100, 80
PAGE_RELOADS = 5  # s after which a page that waits for the engine reloads itself
WITHOUT_PROBLEM = (206, 304, 416)  # statuses of answers that are not refusals or have no body


class Refusal(Exception):
    """The refusal of a request; a page that shows it reloads itself after `reload_after_s`."""

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


def problem_response(refusal: Refusal) -> Response:
    """Return a refusal as problem details."""
    content = problem(refusal.status, refusal.detail, refusal.faults).model_dump_json()
    return Response(content, refusal.status, refusal.headers, MEDIA_TYPE)


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
    """Return the faults of an error, `Fault` objects or their fields from a job; those of a file follow its own."""
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


ETAG_STATUSES = (206, 304, 416)  # statuses, besides 200, of a `etag_response` answer
# policy for a drawing that is opened by itself: it has inline styles, and runs and loads nothing
_DRAWING_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_RANGE = re.compile(r"bytes=(\d{0,15})-(\d{0,15})")


def etag_response(request: Request, body: bytes, media_type: str, headers: dict[str, str] | None = None) -> Response:
    """Return an answer with its ETag: 304 if ``If-None-Match`` has it, 206 or 416 if ``Range`` asks for a part."""
    tag = f'"{sha256(body).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache", "Accept-Ranges": "bytes", **(headers or {})}
    if media_type == "image/svg+xml":
        headers.setdefault("Content-Security-Policy", _DRAWING_POLICY)
    known = [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]
    if tag in known or "*" in known:
        return Response(status_code=304, headers=headers)
    wanted = _RANGE.fullmatch(request.headers.get("range", ""))
    if wanted is None or wanted.groups() == ("", "") or request.headers.get("if-range", tag) != tag:
        return Response(body, headers=headers, media_type=media_type)
    (first, last), size = wanted.groups(), len(body)  # without a first one the last bytes are wanted
    begin, end = (int(first), min(size, int(last) + 1) if last else size) if first else (max(0, size - int(last)), size)
    if begin >= end:
        return Response(status_code=416, headers={**headers, "Content-Range": f"bytes */{size}"})
    headers["Content-Range"] = f"bytes {begin}-{end - 1}/{size}"
    return Response(body[begin:end], 206, headers, media_type)


class CountedStream(StreamingResponse):
    """An answer that is sent as it is made, and that counts as one of its user's streams.

    It is counted when it is created, not when it starts, so that simultaneous requests cannot exceed the limit.
    """

    def __init__(
        self, service: Service, who: Principal, pieces: AsyncIterator[bytes], kind: str, headers: dict[str, str]
    ) -> None:
        limit = service.settings.limits.streams
        if service.streams[who.name] >= limit:
            raise Refusal(429, f"{who.name} has {limit} streams open; close one", headers={"Retry-After": "5"})
        super().__init__(pieces, media_type=kind, headers=headers)
        self._streams, self._user = service.streams, who.name
        self._streams[self._user] += 1

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the pieces."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._streams[self._user] -= 1
