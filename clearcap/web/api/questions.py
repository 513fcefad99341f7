"""Calls for questions about a campaign: what-if, histograms, advice, cheapest tolerances, and comparisons.

The numbers are those of the command line, to the last bit. Simultaneous equal questions are computed once.
"""

from typing import Annotated, Any

from fastapi import Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from clearcap.web.answers.query_service import MOST_SETTINGS, Answer
from clearcap.web.api.calls import ROUTERS
from clearcap.web.http.authentication import Authenticated, OtherCampaign, TheCampaign, TheService, Viewer, the_campaign
from clearcap.web.http.problems import described
from clearcap.web.http.responses import ETAG_STATUSES, etag_response
from clearcap.web.operations.samples import Setting, WhatIfSettings

LONGEST_COSTS = 2**16  # characters
Preview = Annotated[bool, Query(description="For a large campaign, use only the first 100,000 samples, and say so")]


def _document(example: dict[str, Any], *statuses: int) -> dict[str, Any]:
    """Return the options of a call that answers with a JSON document, with its other statuses."""
    content = {"application/json": {"schema": {"type": "object"}, "example": example}}
    return {"response_class": Response, "responses": {200: {"content": content}, **described(*statuses, 404, 409)}}


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
_DIFFERENCE = {"key": "variables.J1.std", "here": 0.0175, "there": 0.012, "changes_rows": True}
_COMPARED = {"campaign": "c60-5e6f7a8b9c", "responses": []}
_COMPARISON = {"campaign": "c60-0a1b2c3d4e", "differs": [_DIFFERENCE], "comparison": _COMPARED}


class WhatIfRequest(BaseModel):
    """A what-if question, which may be too long for a URL."""

    model_config = ConfigDict(extra="forbid")
    set: list[Setting] = Field(max_length=MOST_SETTINGS, description="VARIABLE.KEY=VALUE", examples=[["J1.std=0.01"]])
    preview: bool = Field(False, description="For a large campaign, use only the first 100,000 samples, and say so")


class CostRequest(BaseModel):
    """The costs of tolerances."""

    model_config = ConfigDict(extra="forbid")
    costs: str = Field(
        max_length=LONGEST_COSTS,
        description="The text of a cost file, TOML",
        examples=["target = 1.33\n\n[variables.J1]\na = 1.0\nb = 0.02\n"],
    )


@ROUTERS["questions"].get("/campaigns/{campaign}/whatif", **_document(_WHAT_IF, *ETAG_STATUSES))
async def ask_what_if(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    set: WhatIfSettings,
    preview: Preview = False,
) -> Response:
    """Estimate the capability under other distributions; return the document of `clearcap whatif --json`."""
    return _answered(request, await service.answers.what_if(who.name, campaign, set, preview=preview))


@ROUTERS["questions"].post("/campaigns/{campaign}/whatif", **_document(_WHAT_IF))
async def post_what_if(
    request: Request, service: TheService, campaign: TheCampaign, who: Authenticated, wanted: WhatIfRequest
) -> Response:
    """Estimate the capability under many other distributions."""
    return _answered(request, await service.answers.what_if(who.name, campaign, wanted.set, preview=wanted.preview))


@ROUTERS["questions"].get("/campaigns/{campaign}/histogram", **_document(_BINS, *ETAG_STATUSES))
async def ask_histogram(
    request: Request,
    service: TheService,
    campaign: TheCampaign,
    who: Authenticated,
    response: Annotated[str, Query(max_length=200, examples=["FC-1"])],
    set: WhatIfSettings = [],  # noqa: B006  # FastAPI copies it
    preview: Preview = False,
) -> Response:
    """Count the values of a response in bins, as sampled and under other distributions."""
    return _answered(request, await service.answers.histogram(who.name, campaign, response, set, preview=preview))


@ROUTERS["questions"].get("/campaigns/{campaign}/advice", **_document(_ADVICE, *ETAG_STATUSES))
async def ask_advice(request: Request, service: TheService, campaign: TheCampaign, who: Authenticated) -> Response:
    """Advise which tolerances may grow and which must shrink; return the document of `clearcap advise --json`."""
    return _answered(request, await service.answers.advise(who.name, campaign))


@ROUTERS["questions"].post("/campaigns/{campaign}/allocation", **_document(_ALLOCATION))
async def ask_allocation(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, wanted: CostRequest
) -> Response:
    """Find the cheapest tolerances that keep every target; return the document of `clearcap advise --cost --json`."""
    return _answered(request, await service.answers.allocate(who.name, campaign, wanted.costs))


@ROUTERS["questions"].get("/campaigns/{campaign}/comparisons/{other}", **_document(_COMPARISON, *ETAG_STATUSES))
async def ask_comparison(
    request: Request, service: TheService, campaign: TheCampaign, who: Viewer, other: OtherCampaign
) -> Response:
    """Compare two campaigns: means, sigmas and Cpk of each response, and their differences with intervals."""
    await the_campaign(service, who, other)
    return _answered(request, await service.answers.compare(who.name, campaign, other))


def _answered(request: Request, answer: Answer) -> Response:
    """Return an answer, or 304 if the client has it already."""
    return etag_response(request, answer.content, "application/json")
