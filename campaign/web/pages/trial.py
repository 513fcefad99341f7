"""The page to try a mechanism: change numbers, simulate once, and see responses, certificate and motion."""

import json
from dataclasses import replace
from typing import Annotated, Any
from urllib.parse import quote, urlencode

from fastapi import APIRouter, Query, Request
from starlette.responses import RedirectResponse, Response

from campaign.errors import CampaignError
from campaign.spec.result_columns import certificate_units
from campaign.web.access import Principal, Role
from campaign.web.api.mechanisms import MechanismName, source_of
from campaign.web.api.simulations import MOST_VALUES, values_of
from campaign.web.http.asking import TheService, Viewer
from campaign.web.http.problems import Refusal, refusal_of
from campaign.web.jobs.mechanisms import try_once
from campaign.web.pages.mechanisms import described_mechanism
from campaign.web.pages.rendering import page
from campaign.web.web_service import Service
from engine import EngineError

router = APIRouter(include_in_schema=False)
FIELD = "value:"  # prefix of the names of the form's number fields
FREE_KEYS = 3  # rows of the form for any key
MOST_LISTED = 2000  # keys that a field proposes


@router.get("/mechanisms/{name}/try")
async def trial_page(
    request: Request,
    service: TheService,
    who: Viewer,
    name: MechanismName,
    set: Annotated[list[str] | None, Query(max_length=MOST_VALUES)] = None,
    bench: Annotated[str, Query(max_length=100)] = "",
    preset: Annotated[str, Query(max_length=100)] = "",
    run: bool = False,
) -> Response:
    """Show the form and, with `run` or `set`, the results of the run, so that every run has its own URL."""
    if "was" in request.query_params:  # the form was sent
        typed = await _typed(request, service, who, name)
        more = [("bench", bench), ("preset", preset), ("run", "true")]
        asked = urlencode([*typed, *((key, value) for key, value in more if value)])
        return RedirectResponse(f"/mechanisms/{quote(name)}/try?{asked}", 303)
    found = await described_mechanism(service, who, await source_of(service, name))
    tried, refusal, values = None, None, {}
    try:
        values = values_of(set or [])
        on_bench = await source_of(service, name, bench=bench or None, preset=preset or None)
        found = await described_mechanism(service, who, on_bench)
        if (run or values) and who.may(Role.ENGINEER):
            tried = json.loads(await service.kept(who.name, try_once, replace(on_bench, values=values)))  # type: ignore[arg-type]
    except (CampaignError, EngineError, Refusal) as error:
        refusal = refusal_of(error)
        assert refusal is not None
    settings = [("set", f"{key}={value!r}") for key, value in values.items()]
    question = urlencode([*settings, *((k, v) for k, v in (("bench", bench), ("preset", preset)) if v)])
    sliders = [_slider(each, values) for each in found["keys"] if each["short"]]
    named = {slider["key"] for slider in sliders}
    others = [(key, value) for key, value in values.items() if key not in named][:MOST_VALUES]
    shown: dict[str, Any] = {"name": name, "found": found, "bench": bench, "preset": preset, "tried": tried}
    shown |= {"sliders": sliders, "others": [*others, *[("", "")] * FREE_KEYS], "question": question, "field": FIELD}
    proposed = [each["key"] for each in found["keys"]][:MOST_LISTED]
    shown |= {"proposed": proposed, "certificate_units": certificate_units(found["units"])}
    return page(request, "trial", refusal=refusal, **shown)


async def _typed(request: Request, service: Service, who: Principal, name: str) -> list[tuple[str, str]]:
    """Return the values typed into the form as pairs for the URL, without those that the form showed before."""
    asked = request.query_params
    found = await described_mechanism(service, who, await source_of(service, name, preset=asked["was"] or None))
    shown = {each["short"]: each["value"] for each in found["keys"] if each["short"]}
    pairs = [(key.removeprefix(FIELD), text) for key, text in asked.multi_items() if key.startswith(FIELD)]
    free = zip(asked.getlist("free-key"), asked.getlist("free-value"), strict=False)
    typed = [(key.strip(), text.strip()) for key, text in [*pairs, *free][:MOST_VALUES]]
    return [("set", f"{key}={text}") for key, text in typed if key and text and not _is(text, shown.get(key))]


def _is(text: str, value: float | None) -> bool:
    """Return whether a text is a number with this value."""
    try:
        return float(text) == value
    except ValueError:
        return False


def _slider(entry: dict[str, Any], values: dict[str, float]) -> dict[str, Any]:
    """Return the slider of a clearance, from 1 % of its upper end to twice the value, within the limits."""
    value = values.get(entry["short"], values.get(entry["key"], entry["value"]))
    high = max(2.0 * entry["value"], value)
    high = min(high, entry["upper"]) if entry["upper"] is not None else high
    low = max(high / 100.0, entry["lower"] or 0.0)
    return {
        "key": entry["short"],
        "value": value,
        "unit": entry["unit"],
        "low": low,
        "high": high,
        "own": entry["value"],
    }
