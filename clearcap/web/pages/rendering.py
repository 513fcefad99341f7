"""Rendering of pages from templates, also that of a refused request, and of texts with each fault beside its line."""

import json
from collections.abc import Awaitable, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import Form, Query, Request
from starlette.datastructures import UploadFile
from starlette.responses import HTMLResponse, RedirectResponse, Response

from campaign.errors import CampaignError, StoreError
from campaign.waits import counted
from clearcap.questions.plan_differences import shortened
from clearcap.web.access import Principal, Role
from clearcap.web.access.users import LONGEST_PASSWORD, SHORTEST_PASSWORD
from clearcap.web.http.responses import Refusal
from clearcap.web.jobs.pool import Busy
from clearcap.web.operations.mechanisms import LONGEST_TEXT
from reporting.render.page_templates import page_environment

SITE = Path(__file__).parent / "documentation"  # built by docs/build_site.py; a server may be without
FormText = Annotated[str, Form(max_length=2000)]
NewPassword = Annotated[str, Form(min_length=SHORTEST_PASSWORD, max_length=LONGEST_PASSWORD)]
QueryText = Annotated[str, Query(max_length=100)]
Flag = Annotated[bool, Query()]
AROUND = 2  # lines shown before and after one with a fault
_templates = page_environment("clearcap.web.pages")
_templates.filters["briefly"] = shortened
_templates.filters["counted"] = counted
_templates.filters["combined"] = lambda table, **more: {**table, **more}
_templates.filters["dict_query"] = lambda asked: urlencode(asked, doseq=True)


def page(
    request: Request, name: str, status: int = 200, /, *, refusal: Refusal | None = None, **values: Any
) -> HTMLResponse:
    """Return a page from the template `name`.html.j2; if it shows a refusal, with its status and headers."""
    principal: Principal | None = getattr(request.state, "principal", None)
    reloads = refusal.reload_after_s if refusal and request.method == "GET" else None  # a form would be lost
    html = _templates.get_template(f"{name}.html.j2").render(
        principal=principal, Role=Role, path=request.url.path, refusal=refusal, reload_after_s=reloads, **values
    )
    return HTMLResponse(html, refusal.status, refusal.headers) if refusal else HTMLResponse(html, status)


def refused_page(request: Request, refusal: Refusal) -> Response:
    """Return the page of a refusal; visitors who are not logged in are sent to the login first, and back afterwards."""
    if refusal.status == 401 and request.method == "GET":
        wanted = request.url.path + (f"?{request.url.query}" if request.url.query else "")
        return RedirectResponse(f"/login?next={quote(wanted, safe='')}", 303)
    title = HTTPStatus(refusal.status).phrase
    return page(request, "refused", refusal=refusal, title=title)


@dataclass(frozen=True)
class MarkedLine:
    """A line of a text."""

    number: int  # from 1
    text: str
    faults: tuple[str, ...]


def marked_lines(text: str, faults: Sequence[Mapping[str, Any]]) -> list[MarkedLine]:
    """Return the lines of a text that have faults, with some lines around each; faults of other files are left out."""
    by_line: dict[int, list[str]] = {}
    for fault in faults:
        if fault.get("line") and not fault.get("file"):
            by_line.setdefault(fault["line"], []).append(fault_line(fault))
    near = {number for line in by_line for number in range(line - AROUND, line + AROUND + 1)}
    lines = enumerate(text.split("\n"), 1)
    return [MarkedLine(n, line.rstrip("\r"), tuple(by_line.get(n, ()))) for n, line in lines if n in near]


def fault_line(fault: Mapping[str, Any]) -> str:
    """Return a fault as one line: the key, its value, and what is wrong."""
    value = "" if fault.get("value") is None else f" = {fault['value']}"
    return f"{'.'.join(fault['keys'])}{value}: {fault['text']}" if fault["keys"] else str(fault["text"])


async def uploaded_text(upload: UploadFile, what: str, remedy: str) -> str:
    """Return the text of an uploaded file; refuse (422) one that is no text, or too long."""
    content = await upload.read(LONGEST_TEXT + 1)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        words = f"{what}: is not UTF-8 text ({error.reason} at byte {error.start}); {remedy}"
        raise Refusal(422, words) from error
    if len(content) > LONGEST_TEXT:
        raise Refusal(422, f"{what}: has more than {LONGEST_TEXT} bytes; {remedy}")
    return unix_lines(text)


def unix_lines(text: str) -> str:
    """Return a text that a browser sent, with Unix line ends."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def is_number(text: str, value: float | None) -> bool:
    """Return whether a text is a number with this value."""
    try:
        return float(text) == value
    except ValueError:
        return False


async def or_fault(answer: Awaitable[bytes]) -> tuple[Any, str]:
    """Return the document of an answer and an empty text, or None and the fault of the question."""
    try:
        return json.loads(await answer), ""
    except (Busy, StoreError):
        raise
    except CampaignError as error:
        return None, str(error)
