"""Answers with an ETag, for clients that already have the body or want only a part of it."""

import re
from hashlib import sha256

from fastapi import Request
from starlette.responses import Response

TAGGED = (206, 304, 416)  # statuses, besides 200, of a `tagged` answer
# policy for a drawing that is opened by itself: it has inline styles, and runs and loads nothing
_DRAWING_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_RANGE = re.compile(r"bytes=(\d{0,15})-(\d{0,15})")


def tagged(request: Request, body: bytes, media_type: str, headers: dict[str, str] | None = None) -> Response:
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
