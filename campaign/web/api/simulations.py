"""Calls that simulate a mechanism once: its responses, its certificate and its motion."""

from typing import Annotated, Any

from fastapi import Query, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from campaign.web.api.calls import calls
from campaign.web.api.mechanisms import LONGEST_TEXT, MechanismName, source_of
from campaign.web.http.asking import Engineer, TheService
from campaign.web.http.problems import Refusal, described
from campaign.web.http.tagged import TAGGED, tagged
from campaign.web.jobs.mechanisms import MechanismSource, animate_once, simulate_once

router = calls("simulations")
MOST_VALUES = 500
LONGEST_KEY = 400  # characters

NamedValues = dict[Annotated[str, Field(max_length=LONGEST_KEY)], float]


class SimulationRequest(BaseModel):
    """A simulation to be run."""

    model_config = ConfigDict(extra="forbid")
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
    certificate: dict[str, Any] = Field(description="The certificate of the run")


@router.post("/simulations", responses=described(404, 409))
async def simulate(service: TheService, who: Engineer, wanted: SimulationRequest) -> SimulatedRun:
    """Simulate a mechanism once."""
    if (wanted.text is None) == (not wanted.mechanism):
        raise Refusal(422, "mechanism, text: give one of them")
    more = {"bench": wanted.bench, "preset": wanted.preset, "values": wanted.values}
    if wanted.text is not None:
        source = MechanismSource("mechanism", wanted.text, **more)  # type: ignore[arg-type]  # as the model checked
    else:
        source = await source_of(service, wanted.mechanism, **more)
    content = await service.pool.data(who.name, simulate_once, source, wanted.step, wanted.horizon)
    return SimulatedRun.model_validate(content)


@router.get(
    "/simulations/{name}/motion.gif",
    response_class=Response,
    responses={200: {"content": {"image/gif": {"schema": {"type": "string"}}}}, **described(*TAGGED, 404, 409)},
)
async def motion(
    request: Request,
    service: TheService,
    who: Engineer,
    name: MechanismName,
    set: Annotated[list[str] | None, Query(max_length=MOST_VALUES, description="KEY=VALUE")] = None,
    bench: Annotated[str | None, Query(max_length=100)] = None,
    preset: Annotated[str | None, Query(max_length=100)] = None,
) -> Response:
    """Simulate a mechanism and draw its motion."""
    source = await source_of(service, name, bench=bench, preset=preset, values=values_of(set or []))
    return tagged(request, await service.kept(who.name, animate_once, source), "image/gif")


def values_of(settings: list[str]) -> dict[str, float]:
    """Return the values of ``KEY=VALUE`` texts by key; refuse (422) a text that is not of this form with a number."""
    values: dict[str, float] = {}
    for setting in settings:
        key, _, text = setting.partition("=")
        try:
            values[key.strip()] = float(text)
        except ValueError:
            raise Refusal(422, f"set = {setting!r:.100}: not KEY=VALUE with a number; for example J1=0.05") from None
    return values
