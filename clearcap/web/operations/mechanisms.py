"""Mechanisms: the shipped and the saved ones, checks of a text, and single simulations."""

from datetime import UTC, datetime
from importlib import resources
from typing import Annotated, Any

from fastapi import Form, Path, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from campaign.store.mechanism_library import read_mechanism, save_mechanism, saved_mechanisms
from clearcap.questions import mechanisms
from clearcap.web.http.authentication import Engineer, TheService, Viewer
from clearcap.web.http.responses import Refusal, etag_response
from clearcap.web.operations import Sent
from clearcap.web.web_service import Service
from engine.mechanism import library_names

LONGEST_TEXT = 2**20  # characters
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
MechanismName = Annotated[str, Path(pattern=NAME, description="Shipped or saved", examples=["clearance_pendulum"])]
NameField = Annotated[str, Form(pattern=NAME, description="Of the mechanism")]
Choice = Annotated[str | None, Query(max_length=100)]
MOST_VALUES = 500
LONGEST_KEY = 400  # characters
NamedValues = dict[Annotated[str, Field(max_length=LONGEST_KEY)], float]


class MechanismNames(BaseModel):
    """The mechanisms that campaigns may name."""

    shipped: list[str] = Field(examples=[["c60", "clearance_pendulum"]])
    saved: dict[str, int] = Field(description="Newest version by name", examples=[{"latch": 3}])


class MechanismText(Sent):
    """The text of a mechanism's file."""

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


def list_mechanisms(service: TheService, _: Viewer) -> MechanismNames:
    """List the mechanisms that campaigns may name."""
    return MechanismNames(shipped=library_names(), saved=saved_mechanisms(service.store))


async def show_mechanism(service: TheService, who: Viewer, name: MechanismName) -> dict[str, Any]:
    """Show a mechanism: bodies, joints, clearances, responses, and every number that can be set, with its bounds."""
    content: dict[str, Any] = await service.pool.data(who.name, mechanisms.describe, await source_of(service, name))
    return content


async def save(service: TheService, who: Engineer, name: MechanismName, wanted: MechanismText) -> SavedVersion:
    """Save a mechanism in the store, for all users, as a new version; one with faults is refused."""
    if name in library_names():
        raise Refusal(409, f"{name} is a shipped mechanism; save yours under another name")
    await service.pool.data(who.name, mechanisms.check_text, mechanisms.MechanismSource(name, wanted.text))
    store = service.store
    saved = await run_in_threadpool(save_mechanism, store, name, wanted.text, who.name, wanted.version)
    return SavedVersion(name=name, version=saved.version, by=saved.by, at=datetime.fromtimestamp(saved.at, UTC))


async def check_mechanism(service: TheService, who: Engineer, wanted: MechanismText) -> dict[str, Any]:
    """Check the text of a mechanism; return its summary and warnings, or its faults with key and line as a problem."""
    content: dict[str, Any] = await service.pool.data(
        who.name, mechanisms.check_text, mechanisms.MechanismSource("mechanism", wanted.text)
    )
    return content


def shipped_text(name: str) -> bytes:
    """Return the file of a shipped mechanism."""
    return resources.files("engine.mechanism").joinpath("library", f"{name}.toml").read_bytes()


async def source_of(service: Service, name: str, **more: Any) -> mechanisms.MechanismSource:
    """Return the source of a mechanism for a job: shipped, or the newest saved version; refuse (404) other names."""
    if name in library_names():
        return mechanisms.MechanismSource(name, **more)
    saved = await run_in_threadpool(read_mechanism, service.store, name)
    if saved is None:
        raise Refusal(404, f"no mechanism {name}; shipped: {', '.join(library_names())}")
    return mechanisms.MechanismSource(name, saved.text, **more)


class SimulationRequest(Sent):
    """A simulation to be run."""

    mechanism: str = Field("", max_length=64, description="Shipped or saved", examples=["clearance_pendulum"])
    text: str | None = Field(None, max_length=LONGEST_TEXT, description="TOML, in place of a name")
    values: NamedValues = Field(default={}, max_length=MOST_VALUES, description="Key -> value", examples=[{}])
    bench: str | None = Field(None, max_length=100)
    preset: str | None = Field(None, max_length=100)
    step: float | None = Field(None, gt=0)
    horizon: float | None = Field(None, gt=0)


class SimulatedRun(BaseModel):
    """The results of one run."""

    status: str = Field(examples=["ok"])
    message: str
    responses: dict[str, float | None] = Field(description="The measured values; null if the run has none")
    units: dict[str, str]
    ranges: dict[str, list[float]] = Field(description="Least and largest contact force at rest that friction allows")
    remarks: list[str] = Field(description="What to know about these values")
    certificate: dict[str, Any] = Field(description="The certificate of the run")


async def simulate(service: TheService, who: Engineer, wanted: SimulationRequest) -> SimulatedRun:
    """Simulate a mechanism once."""
    if (wanted.text is None) == (not wanted.mechanism):
        raise Refusal(422, "mechanism, text: give one of them")
    more = {"bench": wanted.bench, "preset": wanted.preset, "values": wanted.values}
    if wanted.text is not None:
        source = mechanisms.MechanismSource("mechanism", wanted.text, **more)  # type: ignore[arg-type]  # as the model checked
    else:
        source = await source_of(service, wanted.mechanism, **more)
    content = await service.pool.data(who.name, mechanisms.simulate_once, source, wanted.step, wanted.horizon)
    return SimulatedRun.model_validate(content)


async def mechanism_text(
    request: Request,
    service: TheService,
    _: Viewer,
    name: MechanismName,
    version: Annotated[int | None, Query(ge=1, lt=10**6, description="By default the newest")] = None,
) -> Response:
    """Return the text of a mechanism's file."""
    if name in library_names() and version is None:
        return etag_response(request, shipped_text(name), "application/toml")
    saved = await run_in_threadpool(read_mechanism, service.store, name, version)
    if saved is None:
        raise Refusal(404, f"no mechanism {name}{'' if version is None else f' of version {version}'}")
    headers = {"X-Version": str(saved.version)}
    return etag_response(request, saved.text.encode(), "application/toml", headers)


async def mechanism_picture(
    request: Request, service: TheService, who: Viewer, name: MechanismName, bench: Choice = None
) -> Response:
    """Draw a mechanism at its start, with what its responses measure."""
    source = await source_of(service, name, bench=bench)
    return etag_response(
        request, await service.answers.made(who.name, mechanisms.draw_mechanism, source), "image/svg+xml"
    )


async def motion(
    request: Request,
    service: TheService,
    who: Engineer,
    name: MechanismName,
    set: Annotated[list[str] | None, Query(max_length=MOST_VALUES, description="KEY=VALUE")] = None,
    bench: Choice = None,
    preset: Choice = None,
) -> Response:
    """Simulate a mechanism and draw its motion."""
    source = await source_of(service, name, bench=bench, preset=preset, values=mechanisms.values_of(set or []))
    return etag_response(request, await service.answers.made(who.name, mechanisms.animate_once, source), "image/gif")
