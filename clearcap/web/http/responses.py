"""Responses that are more than a body: event streams, responses with an ETag, and those to HEAD."""

import re
from collections import Counter
from collections.abc import AsyncGenerator, AsyncIterator, Iterable, Mapping
from contextlib import aclosing
from hashlib import sha256
from typing import Any

from fastapi import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from clearcap.web.http.authentication import is_still_valid
from clearcap.web.http.problems import described

ONCE = ("/login/", "/shared/")  # paths where GET is not safe: it begins a session, with a link that may work only once
TEXT = {"type": "string"}  # schema of a document
ETAG_STATUSES = (206, 304, 416)  # statuses, besides 200, of a `etag_response` answer
# policy for a drawing that is opened by itself: it has inline styles, and runs and loads nothing
_DRAWING_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_RANGE = re.compile(r"bytes=(\d{0,15})-(\d{0,15})")


class EventStream(StreamingResponse):
    """An answer that sends events as they come, until the request's session or token ends.

    It is counted when it is created, not when it starts, so that simultaneous requests cannot exceed the limit.
    `counts` holds the number of open streams by user.
    """

    def __init__(self, request: Request, events: AsyncGenerator[bytes], counts: Counter[str], user: str) -> None:
        sent = _while_known(request, events)
        # X-Accel-Buffering keeps nginx from holding events back
        super().__init__(sent, media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})
        self._counts, self._user = counts, user
        counts[user] += 1

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the events."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._counts[self._user] -= 1


async def _while_known(request: Request, events: AsyncGenerator[bytes]) -> AsyncIterator[bytes]:
    """Yield events as long as the session or token of a request is valid."""
    async with aclosing(events):
        async for event in events:
            if not is_still_valid(request):
                return
            yield event


def document(*kinds: str, refused: Iterable[int] = (404, 409), schema: Mapping[str, Any] = TEXT) -> dict[str, Any]:
    """Return the options of a call whose answer is `etag_response`: media types and refusals, for the documentation."""
    content = {kind.partition(";")[0]: {"schema": schema} if schema else {} for kind in kinds}
    return {"response_class": Response, "responses": {200: {"content": content}, **described(*ETAG_STATUSES, *refused)}}


def etag_response(request: Request, body: bytes, media_type: str, headers: dict[str, str] | None = None) -> Response:
    """Return an answer with its ETag: 304 without a body if the request's ``If-None-Match`` has it.

    If the ``Range`` asks for a part of the body, the answer is 206 with that part, or 416 if there is no such part.
    """
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
    begin, end = _part(wanted[1], wanted[2], len(body))
    if begin >= end:
        return Response(status_code=416, headers={**headers, "Content-Range": f"bytes */{len(body)}"})
    headers["Content-Range"] = f"bytes {begin}-{end - 1}/{len(body)}"
    return Response(body[begin:end], 206, headers, media_type)


def _part(first: str, last: str, size: int) -> tuple[int, int]:
    """Return the begin and end of a byte range; the end is exclusive."""
    if not first:  # the last bytes of the file
        return max(0, size - int(last)), size
    return int(first), min(size, int(last) + 1) if last else size


class Head:
    """Answer HEAD like GET, but without the body (RFC 9110, section 9.3.2); the application handles only GET.

    Paths with one-time links are left out, so that a program that previews a link does not use it up.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or scope["path"].startswith(ONCE):
            await self._app(scope, receive, send)
            return
        asked = {**scope, "method": "GET"}

        async def send_head(message: Message) -> None:
            if message["type"] != "http.response.start":
                return
            scope.update({key: asked[key] for key in ("route", "path_params") if key in asked})  # for the log
            await send(message)
            await send({"type": "http.response.body"})  # ends the answer here, even an endless one such as events

        await self._app(asked, receive, send_head)
