"""Calls for mechanisms: the shipped ones, those saved in the store, and checks of a text."""

from datetime import UTC, datetime
from importlib import resources
from typing import Annotated, Any

from fastapi import Path, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.store.mechanism_library import read_mechanism, save_mechanism, saved_mechanisms
from campaign.web.api.calls import calls
from campaign.web.http.asking import Engineer, TheService, Viewer
from campaign.web.http.problems import Refusal, described
from campaign.web.http.tagged import TAGGED, tagged
from campaign.web.jobs.mechanisms import MechanismSource, check_text, describe, draw
from campaign.web.web_service import Service
from engine.mechanism import library_names

router = calls("mechanisms")
LONGEST_TEXT = 2**20  # characters
MechanismName = Annotated[
    str,
    Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$", description="Shipped or saved", examples=["clearance_pendulum"]),
]


class MechanismNames(BaseModel):
    """The mechanisms that campaigns may name."""

    shipped: list[str] = Field(examples=[["c60", "clearance_pendulum"]])
    saved: dict[str, int] = Field(description="Newest version by name", examples=[{"latch": 3}])


class MechanismText(BaseModel):
    """The text of a mechanism's file."""

    model_config = ConfigDict(extra="forbid")
    text: str = Field(max_length=LONGEST_TEXT, description="TOML")
    version: int | None = Field(
        None, ge=0, description="The newest version that the caller knows; 409 if there is a later one"
    )


class SavedVersion(BaseModel):
    """A saved version of a mechanism."""

    name: str
    version: int
    by: str
    at: datetime


@router.get("/mechanisms")
def list_mechanisms(service: TheService, _: Viewer) -> MechanismNames:
    """List the mechanisms that campaigns may name."""
    return MechanismNames(shipped=library_names(), saved=saved_mechanisms(service.store))


@router.get("/mechanisms/{name}", responses=described(404, 409))
async def show_mechanism(service: TheService, who: Viewer, name: MechanismName) -> dict[str, Any]:
    """Show a mechanism: bodies, joints, clearances, responses, and every number that can be set, with its bounds."""
    content: dict[str, Any] = await service.pool.data(who.name, describe, await source_of(service, name))
    return content


@router.get(
    "/mechanisms/{name}/text",
    response_class=Response,
    responses={200: {"content": {"application/toml": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404)},
)
async def mechanism_text(
    request: Request,
    service: TheService,
    _: Viewer,
    name: MechanismName,
    version: Annotated[int | None, Query(ge=1, lt=10**6, description="By default the newest")] = None,
) -> Response:
    """Return the text of a mechanism's file."""
    if name in library_names() and version is None:
        return tagged(request, shipped_text(name), "application/toml")
    saved = await run_in_threadpool(read_mechanism, service.store, name, version)
    if saved is None:
        raise Refusal(404, f"no mechanism {name}{'' if version is None else f' of version {version}'}")
    headers = {"X-Version": str(saved.version)}
    return tagged(request, saved.text.encode(), "application/toml", headers)


@router.get(
    "/mechanisms/{name}/picture.svg",
    response_class=Response,
    responses={200: {"content": {"image/svg+xml": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404, 409)},
)
async def mechanism_picture(
    request: Request,
    service: TheService,
    who: Viewer,
    name: MechanismName,
    bench: Annotated[str | None, Query(max_length=100)] = None,
) -> Response:
    """Draw a mechanism at its start, with what its responses measure."""
    source = await source_of(service, name, bench=bench)
    return tagged(request, await service.kept(who.name, draw, source), "image/svg+xml")


@router.put("/mechanisms/{name}", responses=described(409))
async def save(service: TheService, who: Engineer, name: MechanismName, wanted: MechanismText) -> SavedVersion:
    """Save a mechanism in the store, for all users, as a new version; one with faults is refused."""
    if name in library_names():
        raise Refusal(409, f"{name} is a shipped mechanism; save yours under another name")
    await service.pool.data(who.name, check_text, MechanismSource(name, wanted.text))
    store = service.store
    saved = await run_in_threadpool(save_mechanism, store, name, wanted.text, who.name, wanted.version)
    return SavedVersion(name=name, version=saved.version, by=saved.by, at=datetime.fromtimestamp(saved.at, UTC))


@router.post("/checks/mechanism", responses=described(409))
async def check_mechanism(service: TheService, who: Engineer, wanted: MechanismText) -> dict[str, Any]:
    """Check the text of a mechanism; return its summary and warnings, or its faults with key and line as a problem."""
    content: dict[str, Any] = await service.pool.data(who.name, check_text, MechanismSource("mechanism", wanted.text))
    return content


def shipped_text(name: str) -> bytes:
    """Return the file of a shipped mechanism."""
    return resources.files("engine.mechanism").joinpath("library", f"{name}.toml").read_bytes()


async def source_of(service: Service, name: str, **more: Any) -> MechanismSource:
    """Return the source of a mechanism for a job: shipped, or the newest saved version; refuse (404) other names."""
    if name in library_names():
        return MechanismSource(name, **more)
    saved = await run_in_threadpool(read_mechanism, service.store, name)
    if saved is None:
        raise Refusal(404, f"no mechanism {name}; shipped: {', '.join(library_names())}")
    return MechanismSource(name, saved.text, **more)
