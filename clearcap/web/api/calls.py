"""Common parts of all calls of the API: path prefix, documentation, and access to the campaign that a path names."""

from collections.abc import Callable, Coroutine, Iterator
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.store.layout import PLAN
from clearcap.web.http.authentication import SAFE_METHODS, Asking, TheService, known, who_may
from clearcap.web.http.problems import Refusal, described

PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$"
PREFIX = "/api/v1"
WHO_MAY = "x-who-may"  # key of a call in the OpenAPI document


class _Call(APIRoute):
    """A call whose summary is the first line of its docstring; its documentation also says who may use it."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        if not options.get("summary"):
            options["summary"] = (endpoint.__doc__ or "").strip().split("\n")[0].rstrip(".")
        super().__init__(path, endpoint, **options)
        self.openapi_extra = {**(self.openapi_extra or {}), WHO_MAY: who_may(_all_of(self.dependant))}

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of a request, which refuses strangers before it reads the body."""
        handle = super().get_route_handler()

        async def handle_known(request: Request) -> Response:
            if request.method not in SAFE_METHODS:
                known(request)
            return await handle(request)

        return handle_known


def _all_of(dependant: Dependant) -> Iterator[object]:
    """Yield the functions that a call depends on."""
    for each in dependant.dependencies:
        yield each.call
        yield from _all_of(each)


def calls(tag: str, *, with_login: bool = True) -> APIRouter:
    """Return a router for the calls of one kind, which the documentation shows under `tag`.

    Calls with a login have the path prefix and the common refusals.
    """
    refusals = described(400, 401, 403, 413, 422, 429, 500, 503) if with_login else {}
    return APIRouter(prefix=PREFIX if with_login else "", tags=[tag], route_class=_Call, responses=refusals)


async def the_campaign(
    service: TheService,
    principal: Asking,
    campaign: Annotated[str, Path(pattern=PATTERN, description="Id of the campaign", examples=["c60-0a1b2c3d4e"])],
) -> str:
    """Return the id of a campaign after checking that it exists and that the principal may see it.

    Either failure is refused with 404, so that nobody learns which campaigns exist.
    """
    if principal.may_see(campaign):
        is_known = service.watcher.index.entry(campaign) is not None
        if is_known or await run_in_threadpool(service.store.files.exists, f"{campaign}/{PLAN}"):
            return campaign
    raise Refusal(404, f"no campaign {campaign} in the store")


TheCampaign = Annotated[str, Depends(the_campaign)]
