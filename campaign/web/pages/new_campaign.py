"""The page for a new campaign: a form beside the text of its file, each derived from the other."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.inputs.distributions import DISTRIBUTIONS
from campaign.inputs.sampling import SAMPLERS
from campaign.spec.named_files import MOST_FILES
from campaign.store.labels import MOST_TAGS
from campaign.store.layout import PLAN
from campaign.store.mechanism_library import saved_mechanisms
from campaign.web.access import Principal
from campaign.web.api.posted_campaign import LONGEST_TEXT, CampaignRequest
from campaign.web.api.questions import Settings
from campaign.web.api.submissions import cost_of, source_of_request, submitted
from campaign.web.api.whose import PATTERN
from campaign.web.http.asking import Engineer, TheService
from campaign.web.http.problems import Refusal, refusal_of
from campaign.web.jobs.campaign_form import STATISTICS, Tables, composed, first_text, started_from
from campaign.web.pages.form_fields import CampaignForm, digest, tables_of
from campaign.web.pages.marked_text import marked_lines, unix_lines
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service
from engine.mechanism import library_names

router = APIRouter(include_in_schema=False)
FIRST_MECHANISM = "c60"
ACTIONS = ("write", "read", "check", "try", "submit")
BOTH_CHANGED = (
    "form and file have both changed since one was made from the other: press Write the file to take the form, or Read"
    " the file to take the file"
)


@dataclass(frozen=True)
class Draft:
    """A campaign that a user is writing."""

    text: str
    form: Tables | None = None  # as it was sent; None if there is none yet
    form_was: str = ""  # digest of the form when the page was last rendered
    text_was: str = ""  # digest of the text at that time
    files: dict[str, str] = field(default_factory=dict)  # texts of the files that the campaign names
    owner: str = ""
    tags: str = ""

    @property
    def form_changed(self) -> bool:
        """Whether the user has changed the form since the page was rendered."""
        return self.form is not None and digest(self.form) != self.form_was

    @property
    def text_changed(self) -> bool:
        """Whether the user has changed the text since the page was rendered."""
        return digest(self.text) != self.text_was

    def request(self) -> CampaignRequest:
        """Return the campaign to be checked or submitted."""
        files = {name: text.encode() for name, text in self.files.items()}
        tags = self.tags.replace(",", " ").split()
        if len(tags) > MOST_TAGS:
            raise Refusal(422, f"tags: there are {len(tags)}; allowed: up to {MOST_TAGS}; remove some")
        return CampaignRequest(text=self.text, files=files, owner=self.owner or None, tags=tags)


@router.get("/campaigns/new")
async def new_campaign_page(
    request: Request,
    service: TheService,
    who: Engineer,
    start: Annotated[str, Query(alias="from", pattern=PATTERN + "|^$")] = "",
    mechanism: Annotated[str, Query(max_length=64)] = FIRST_MECHANISM,
    set: Settings = [],  # noqa: B006  # FastAPI copies it
    samples: Annotated[int | None, Query(ge=1, lt=2**53)] = None,
) -> Response:
    """Show the form of a new campaign, which may begin as a copy of another one with some distributions changed."""
    draft = Draft(first_text(mechanism), owner=who.name)
    if start:
        if not await run_in_threadpool(service.store.files.exists, f"{start}/{PLAN}"):
            raise Refusal(404, f"no campaign {start} in the store")
        url = service.store.files.full_url
        begun = await service.pool.data(who.name, started_from, url, start, tuple(set), samples)
        draft = replace(draft, text=begun["text"], files=begun["files"])
    found = await service.pool.data(who.name, composed, source_of_request(service, draft.request()))
    if not start:
        found |= {"faults": [], "detail": ""}  # the user has not written anything yet
    return await _shown(request, service, draft, found)


@router.post("/campaigns/new")
async def new_campaign_form(request: Request, service: TheService, who: Engineer) -> Response:
    """Derive the form and the text from each other, check them, or submit the campaign."""
    draft, action = await _sent(request)
    if action not in ACTIONS:
        raise Refusal(422, f"action {action!r:.20}: allowed: {', '.join(ACTIONS)}")
    if draft.form_changed and draft.text_changed and action not in ("write", "read"):
        return await _looked_at(request, service, who, draft, Refusal(409, BOTH_CHANGED))
    written = draft.form if action == "write" or (draft.form_changed and action != "read") else None
    source = source_of_request(service, draft.request())
    found = await service.pool.data(who.name, composed, source, written, action == "try")
    draft = replace(draft, text=found["text"])
    if action != "submit" or found["faults"] or found["detail"]:
        return await _shown(request, service, draft, found, 422 if action == "submit" else 200)
    try:
        made = await submitted(service, who, draft.request())
    except (CampaignError, Refusal) as error:
        return await _looked_at(request, service, who, draft, refusal_of(error))
    return RedirectResponse(f"/campaigns/{quote(made.campaign)}", 303)


async def _sent(request: Request) -> tuple[Draft, str]:
    """Return the draft that a browser sent, and the action of the pressed button."""
    form = await request.form()
    try:
        sent = {key: value for key, value in form.multi_items() if isinstance(value, str)}
        files = dict(zip(form.getlist("file-name"), form.getlist("file-text"), strict=False))
        kept = {str(name): unix_lines(str(text)) for name, text in files.items() if name and str(text).strip()}
        for upload in form.getlist("upload"):
            if isinstance(upload, UploadFile) and upload.filename:
                kept[upload.filename] = await _text_of(upload)
    finally:
        await form.close()
    if len(kept) > MOST_FILES:
        raise Refusal(422, f"{len(kept)} files: allowed: up to {MOST_FILES}")
    draft = Draft(
        unix_lines(sent.get("text", ""))[:LONGEST_TEXT],
        tables_of(sent),
        sent.get("form-was", ""),
        sent.get("text-was", ""),
        kept,
        sent.get("owner", "")[:200],
        sent.get("tags", "")[:2000],
    )
    return draft, sent.get("action", "check")


async def _text_of(upload: UploadFile) -> str:
    """Return the text of an uploaded file; files that are not text must be sent with the API."""
    content = await upload.read(LONGEST_TEXT + 1)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(422, f"{upload.filename:.100}: is not text; send it with the API instead") from error
    if len(content) > LONGEST_TEXT:
        raise Refusal(422, f"{upload.filename:.100}: has more than {LONGEST_TEXT} bytes; send it with the API instead")
    return unix_lines(text)


async def _looked_at(
    request: Request, service: Service, who: Principal, draft: Draft, refusal: Refusal | None
) -> Response:
    """Return the page with the draft as it was sent, and the reason why nothing was done."""
    assert refusal is not None
    found = await service.pool.data(who.name, composed, source_of_request(service, draft.request()))
    found |= {"faults": refusal.faults, "detail": refusal.detail, "checked": None, "sent": True}
    answer = await _shown(request, service, draft, found, refusal.status)
    answer.headers.update(refusal.headers)
    return answer


async def _shown(
    request: Request, service: Service, draft: Draft, found: dict[str, Any], status: int = 200
) -> Response:
    """Return the page with form, text, faults and cost."""
    is_as_sent = "sent" in found
    tables: Tables = (draft.form if is_as_sent or found["form"] is None else found["form"]) or {}
    form = CampaignForm(tables, found["faults"], found)
    refusal = Refusal(status, found["detail"], found["faults"]) if found["detail"] else None
    saved = await run_in_threadpool(saved_mechanisms, service.store)
    values: dict[str, Any] = {"draft": draft, "form": form, "checked": found["checked"]}
    values["cost"] = cost_of(service, found["checked"]) if found["checked"] else None
    values["lines"] = marked_lines(draft.text, found["faults"])
    # of a draft that is shown as it was sent, form and text count as changed until one is derived from the other
    values["form_was"] = draft.form_was if is_as_sent else digest(_as_sent_again(form))
    values["text_was"] = draft.text_was if is_as_sent else digest(draft.text)
    values["mechanisms"] = [*library_names(), *saved, *draft.files]
    chosen = {"samplers": list(SAMPLERS), "distributions": list(DISTRIBUTIONS), "statistics": STATISTICS}
    numbers = " ".join(str(line.number) for line in values["lines"] if line.faults)
    return page(request, "new_campaign", status, refusal=refusal, fault_lines=numbers, **chosen, **values)


def _as_sent_again(form: CampaignForm) -> Tables:
    """Return the tables that `tables_of` returns if the form is sent back unchanged."""
    fields = [*form.top.values(), *form.stop.values()]
    for row in form.variables:
        fields += [row["name"], row["distribution"], row["target"], *row["parameters"]]
    for row in form.responses:
        fields += [row["name"], *row["limits"]]
    return tables_of({each.name: each.value for each in fields})
