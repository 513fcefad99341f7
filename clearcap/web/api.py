"""The HTTP API: which call is which function of `clearcap.web.operations`, and what its documentation says."""

from collections.abc import Callable, Coroutine, Iterable, Iterator
from typing import Any

from fastapi import APIRouter, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.responses import Response, StreamingResponse

from campaign.store.measured_library import MeasuredParts
from clearcap.questions.exported_rows import FORMATS
from clearcap.questions.samples import SamplePage
from clearcap.questions.submissions import SubmittedCampaign
from clearcap.web.http import monitoring
from clearcap.web.http.authentication import FORMS, SAFE_METHODS, WHO_MAY, principal_of, who_may
from clearcap.web.http.request_limits import check_values
from clearcap.web.http.responses import ETAG_STATUSES, described
from clearcap.web.operations import campaigns, drawings, measured, mechanisms, people, samples, signoffs, submissions
from clearcap.web.settings import PREFIX


class _Call(APIRoute):
    """A call whose summary is the first line of its docstring; its documentation also says who may use it."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        if not options.get("summary"):
            options["summary"] = (endpoint.__doc__ or "").strip().split("\n")[0].rstrip(".")
        super().__init__(path, endpoint, **options)
        self.openapi_extra = {**(self.openapi_extra or {}), WHO_MAY: who_may(_all_of(self.dependant))}

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of a request, which refuses strangers before the body is read, and JSON of many values."""
        handle = super().get_route_handler()

        async def handle_known(request: Request) -> Response:
            if request.method not in SAFE_METHODS:
                principal_of(request)
                if not request.headers.get("content-type", "").startswith(FORMS):
                    check_values(await request.body())
            return await handle(request)

        return handle_known


def _all_of(dependant: Dependant) -> Iterator[object]:
    """Yield the functions that a call depends on."""
    for each in dependant.dependencies:
        yield each.call
        yield from _all_of(each)


_REFUSALS = described(400, 401, 403, 413, 422, 429, 500, 503)  # of all calls that need a login
_TAGS = ("mechanisms", "simulations", "campaigns", "reports", "questions", "samples", "measured", "users", "account")
_ROUTERS = {"operation": APIRouter(tags=["operation"], route_class=_Call)} | {
    tag: APIRouter(prefix=PREFIX, tags=[tag], route_class=_Call, responses=_REFUSALS)
    for tag in (*_TAGS, "tokens", "audit", "shares", "sign-off", "webhooks")
}


def routers() -> list[APIRouter]:
    """Return the routers of all calls, one a tag of the documentation."""
    return list(_ROUTERS.values())


_JSON = "application/json"
_TEXT, _DATA = {"type": "string"}, {"type": "object"}  # schemas


def _document(
    *kinds: str,
    schema: dict[str, Any] = _TEXT,
    statuses: Iterable[int] = (*ETAG_STATUSES, 404, 409),
    stream: bool = False,
    **more: Any,
) -> dict[str, Any]:
    """Return the options of a call by its media types; by default it answers with `etag_response`."""
    content = {kind.partition(";")[0]: ({"schema": schema} if schema else {}) | more for kind in kinds}
    responses = {200: {"content": content}, **described(*statuses)}
    return {"response_class": StreamingResponse if stream else Response, "responses": responses}


_EVENT = {  # OpenAPI schema of an event in a stream
    "type": "object",
    "properties": {"event": {"enum": ["progress", "end"]}, "id": {"type": "string"}, "data": {"type": "string"}},
}
_MOTION = {  # see `clearcap.pictures.moving_drawing`
    "type": "object",
    "properties": {
        "width": {"type": "number"},
        "height": {"type": "number"},
        "unit": {"type": "string", "description": "Of time"},
        "bodies": {"type": "array", "items": {"type": "object"}, "description": "As they are drawn at the end"},
        "frames": {"type": "object", "description": "`time`; of each body its polylines, and its place in each frame"},
    },
    "required": ["width", "height", "unit", "bodies", "frames"],
}
_ESTIMATE = {"value": 1.52, "interval": [1.49, 1.55], "effective": 9120.0}
_WHAT_IF = {
    "campaign": "c60-0a1b2c3d4e",
    "set": ["J1.std=0.01"],
    "assumed": [],
    "responses": {"FC-1": {"n": 30850, "refusal": "", "runs": 6000, "cpk": _ESTIMATE}},
    "refused": [],
}
_BINS = {"response": "FC-1", "unit": "N", "edges": [1.0, 2.0, 3.0], "before": [7, 3], "after": [8.5, 1.5]}
_ADVICE = {"campaign": "c60-0a1b2c3d4e", "advice": [], "below": {}, "remedies": {}, "note": ""}
_ALLOCATION = {"campaign": "c60-0a1b2c3d4e", "allocation": {"tolerances": {"J1": 0.012}, "cost": 8.4}}
_COMPARISON = {
    "campaign": "c60-0a1b2c3d4e",
    "differs": [{"key": "variables.J1.std", "here": 0.0175, "there": 0.012, "changes_rows": True}],
    "comparison": {"campaign": "c60-5e6f7a8b9c", "responses": []},
}
_FILE = _document(*campaigns.TYPES.values(), "application/octet-stream", schema={}, statuses=(*ETAG_STATUSES, 404))
_TOML = _document("application/toml", statuses=(*ETAG_STATUSES, 404))
_PAGE = _document("text/html", statuses=(*ETAG_STATUSES, 404))
_SVG, _GIF = _document("image/svg+xml"), _document("image/gif")
_MADE: dict[int | str, dict[str, Any]] = {
    200: {"model": SubmittedCampaign, "description": "The store already had it"},
    201: {"headers": {"Location": {"schema": {"type": "string"}, "description": "The campaign"}}},
}
_SUBMITTED: dict[str, Any] = {"status_code": 201, "response_model": SubmittedCampaign}
_CAMPAIGN, _SAMPLE = "/campaigns/{campaign}", "/campaigns/{campaign}/samples/{sample}"
_404, _409, _404_409 = described(404), described(409), described(404, 409)
each = _ROUTERS["operation"]
each.get("/healthz")(monitoring.healthz)
each.get("/readyz", responses=described(503))(monitoring.readyz)
each.get("/metrics", **_document("text/plain", schema={}, statuses=(401, 403)))(monitoring.metrics)

each = _ROUTERS["mechanisms"]
each.get("/mechanisms/{name}/text", **_TOML)(mechanisms.mechanism_text)
each.get("/mechanisms/{name}/picture.svg", **_SVG)(mechanisms.mechanism_picture)
each.get("/mechanisms")(mechanisms.list_mechanisms)
each.get("/mechanisms/{name}", responses=_404_409)(mechanisms.show_mechanism)
each.put("/mechanisms/{name}", responses=_409)(mechanisms.save)
each.post("/checks/mechanism", responses=_409)(mechanisms.check_mechanism)
each.post("/drawings", status_code=201, responses=_409)(drawings.upload_step)
each.get("/drawings/{name}", responses=_404)(drawings.show_draft)
each.get("/drawings/{name}/found.html", **_PAGE)(drawings.found_page)
each.put("/drawings/{name}", responses=_404_409)(drawings.keep_draft)
each.post("/drawings/{name}/check", responses=_404_409)(drawings.check_draft)
each.post("/drawings/{name}/groups", responses=_404_409)(drawings.regroup_draft)
each.post("/drawings/{name}/mechanism", responses=_404_409)(drawings.save_drawn)

each = _ROUTERS["simulations"]
each.get("/simulations/{name}/motion.gif", **_GIF)(mechanisms.motion)
each.post("/simulations", responses=_404_409)(mechanisms.simulate)

each = _ROUTERS["campaigns"]
each.get("/campaigns", response_model=campaigns.Listing, responses=described(*ETAG_STATUSES))(campaigns.list_campaigns)
_EVENTS = _document("text/event-stream", schema=_EVENT, statuses=(404,), stream=True)
each.get(f"{_CAMPAIGN}/events", **_EVENTS)(campaigns.follow_campaign)
each.get(f"{_CAMPAIGN}/campaign.toml", **_TOML)(campaigns.campaign_file)
each.post("/checks/campaign", openapi_extra=submissions.POSTED, responses=described(409, 415))(
    submissions.check_campaign
)
each.post("/campaigns", **_SUBMITTED, openapi_extra=submissions.POSTED, responses={**_MADE, **described(409, 415)})(
    submissions.submit_campaign
)
each.post(f"{_CAMPAIGN}/extend", name="extend", **_SUBMITTED, responses={**_MADE, **_404_409})(
    submissions.extend_campaign
)
each.get(_CAMPAIGN, responses=_404)(campaigns.show_campaign)
each.get(f"{_CAMPAIGN}/status", responses=_404)(campaigns.campaign_status)
each.post(f"{_CAMPAIGN}/cancel", responses=_404)(campaigns.cancel)
each.post(f"{_CAMPAIGN}/resume", responses=_404)(campaigns.resume)
each.post(f"{_CAMPAIGN}/rerun", responses=_404_409)(campaigns.rerun)
each.patch(f"{_CAMPAIGN}/labels", responses=_404_409)(campaigns.label)
each.delete(_CAMPAIGN, status_code=204, responses=_404_409)(campaigns.delete)

each = _ROUTERS["reports"]
each.get(f"{_CAMPAIGN}/reports/own/{{name}}", **_FILE)(campaigns.report_file)
each.get(f"{_CAMPAIGN}/reports/against/{{other}}/{{name}}", **_FILE)(campaigns.comparison_file)
each.get(f"{_CAMPAIGN}/reports/pooled/{{pool}}/{{name}}", **_FILE)(campaigns.pooled_file)
each.get(f"{_CAMPAIGN}/reports", responses=_404)(campaigns.report_files)
each.post(f"{_CAMPAIGN}/report", responses=_404_409)(campaigns.write_report)
each.post(f"{_CAMPAIGN}/comparisons/{{other}}", responses=_404_409)(campaigns.write_comparison)
each.post(f"{_CAMPAIGN}/pools", responses=_404_409)(campaigns.write_pool)

each = _ROUTERS["questions"]
each.get(f"{_CAMPAIGN}/whatif", **_document(_JSON, schema=_DATA, example=_WHAT_IF))(samples.ask_what_if)
each.post(f"{_CAMPAIGN}/whatif", **_document(_JSON, schema=_DATA, example=_WHAT_IF, statuses=(404, 409)))(
    samples.post_what_if
)
each.get(f"{_CAMPAIGN}/histogram", **_document(_JSON, schema=_DATA, example=_BINS))(samples.ask_histogram)
each.get(f"{_CAMPAIGN}/advice", **_document(_JSON, schema=_DATA, example=_ADVICE))(samples.ask_advice)
each.post(f"{_CAMPAIGN}/allocation", **_document(_JSON, schema=_DATA, example=_ALLOCATION, statuses=(404, 409)))(
    samples.ask_allocation
)
each.post(f"{_CAMPAIGN}/confirmation", responses=described(404, 409, 429))(samples.confirm_allocation)
each.get(f"{_CAMPAIGN}/comparisons/{{other}}", **_document(_JSON, schema=_DATA, example=_COMPARISON))(
    samples.ask_comparison
)

each = _ROUTERS["samples"]
each.get(f"{_CAMPAIGN}/rows", **_document(*FORMATS.values(), statuses=(304, 404, 409), stream=True))(samples.export)
each.get(f"{_CAMPAIGN}/samples", response_model=SamplePage, responses=described(*ETAG_STATUSES, 404, 409))(
    samples.list_samples
)
each.get(f"{_SAMPLE}/plot.svg", **_SVG)(samples.plot)
each.get(f"{_SAMPLE}/motion.gif", name="motion", **_GIF)(samples.motion_gif)
each.get(f"{_SAMPLE}/motion.json", **_document(_JSON, schema=_MOTION))(samples.motion_data)
each.get(_SAMPLE, responses=_404)(samples.show_sample)
each.post(f"{_SAMPLE}/replay", responses=_404_409)(samples.replay)

each = _ROUTERS["measured"]
_KEPT: dict[int | str, dict[str, Any]] = {200: {"model": MeasuredParts, "description": "It was there already"}}
each.get("/measured")(measured.list_parts)
each.post("/measured", status_code=201, responses={**_KEPT, **_409})(measured.upload_parts)
each.get("/measured/{measured}", responses=_404)(measured.show_parts)
each.get("/measured/{measured}/files/{name}", **_FILE)(measured.parts_file)
each.get(f"{_CAMPAIGN}/monitor", responses=_404)(measured.show_monitored)
each.post(f"{_CAMPAIGN}/monitor", responses=_404_409)(measured.monitor)
each.delete("/measured/{measured}", status_code=204, responses=_404)(measured.delete_parts)

each = _ROUTERS["users"]
each.get("/users")(people.list_users)
each.post("/users", status_code=201, responses=_409)(people.add_user)
each.patch("/users/{name}", responses=_404_409)(people.change_user)
each.delete("/users/{name}/access", status_code=204, responses=_404)(people.end_access)
each.post("/users/{name}/login-link", status_code=201, responses=_404_409)(people.make_login_link)

each = _ROUTERS["account"]
each.get("/account")(people.show_account)
each.put("/account/password", status_code=204)(people.set_password)
each.delete("/account/sessions", status_code=204)(people.end_sessions)

each = _ROUTERS["tokens"]
each.get("/tokens")(people.list_tokens)
each.post("/tokens", status_code=201, responses=_409)(people.add_token)
each.delete("/tokens/{token}", status_code=204, responses=_404)(people.revoke_token)

each = _ROUTERS["audit"]
each.get("/audit")(people.list_audit)
each.get("/audit/check")(people.check_audit)

each = _ROUTERS["shares"]
each.get(f"{_CAMPAIGN}/shares", responses=_404)(people.list_shares)
each.post(f"{_CAMPAIGN}/shares", status_code=201, responses=_404_409)(people.add_share)
each.delete(f"{_CAMPAIGN}/shares/{{share}}", status_code=204, responses=_404)(people.revoke_share)

each = _ROUTERS["sign-off"]
_ZIP = _document("application/zip", schema={"type": "string", "format": "binary"}, statuses=(404, 409))
each.get(f"{_CAMPAIGN}/signoffs/export.zip", **_ZIP)(signoffs.export_signed)
each.get("/signing-key")(signoffs.show_signing_key)
each.get(f"{_CAMPAIGN}/signoffs", responses=_404)(signoffs.list_signoffs)
each.get(f"{_CAMPAIGN}/signoffs/content", responses=_404_409)(signoffs.show_content)
each.post(f"{_CAMPAIGN}/signoffs", status_code=201, responses=_404_409)(signoffs.sign_campaign)
each.post(f"{_CAMPAIGN}/signoffs/withdrawal", status_code=201, responses=_404_409)(signoffs.withdraw_signoff)

each = _ROUTERS["webhooks"]
each.get("/webhooks")(people.list_webhooks)
each.post("/webhooks", status_code=201, responses=_409)(people.add_webhook)
each.get("/webhooks/{webhook}", responses=_404)(people.show_webhook)
each.delete("/webhooks/{webhook}", status_code=204, responses=_404)(people.remove_webhook)
