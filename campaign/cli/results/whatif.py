"""``clearcap whatif``: other distributions, answered by the samples of a campaign without new runs."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, number, print_json, print_table, say

if TYPE_CHECKING:
    from reporting.tolerance.whatif import Estimate, WhatIf

Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="VARIABLE.KEY=VALUE",
        help="Change a key of a distribution, for example J1.std=0.01; may be repeated.",
    ),
]


def whatif(campaign: Id = None, settings: Settings = [], store: StoreUrl = "runs", json: Json = False) -> None:  # noqa: B006
    """Estimate the capability under other distributions by weighting the computed samples, without new runs.

    Exit status 1 if the samples are too few for an answer; a message then says how many new runs it takes.
    """
    from dataclasses import asdict

    from campaign.errors import SpecError
    from campaign.reports.whatif import what_if
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK

    if not settings:
        raise SpecError("no --set is given, so no distribution changes; write for example --set J1.std=0.01")
    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    answers = what_if(opened, plan, settings)
    if json:
        responses = {name: asdict(answer) for name, answer in answers.items()}
        print_json({"campaign": plan.campaign_id, "store": opened.url, "set": settings, "responses": responses})
    else:
        _print(answers, plan.mechanism.response_units())
    refused = {answer.refusal: answer.runs for answer in answers.values() if answer.refusal}
    for note in dict.fromkeys(f"{name}: {note}" for name, answer in answers.items() for note in answer.notes):
        say(note)
    for reason, runs in refused.items():
        say(f"no answer: {reason}; run a campaign with these distributions; {runs} samples determine Cpk to 5 %")
    if refused:
        raise typer.Exit(1)


def _print(answers: "dict[str, WhatIf]", units: dict[str, str]) -> None:
    """Print one row a response."""
    rows = []
    for name, answer in answers.items():
        label = name if units[name] == "1" else f"{name} [{units[name]}]"
        estimates = [None] * 3 if answer.refusal else [answer.mean, answer.std, answer.cpk]
        rows.append((label, *map(_cell, estimates), _ppm(answer), f"{answer.effective:.0f}"))
    heads = ("response", "mean", "sigma", "Cpk", "ppm out of limits", "worth samples")
    print_table("under the new distributions, 95 % intervals", heads, rows, texts=1)


def _cell(estimate: "Estimate | None") -> str:
    """Return a number with its interval."""
    if estimate is None:
        return "-"
    low, high = estimate.interval
    return f"{number(estimate.value)} ({number(low, 4)} to {number(high, 4)})"


def _ppm(answer: "WhatIf") -> str:
    """Return the share out of limits; only its bound where it is below one of the samples that they are worth."""
    if answer.refusal or answer.ppm is None:
        return "-"
    if answer.ppm.value * answer.effective < 1e6:
        return f"at most {number(answer.ppm.interval[1], 4)}"
    return _cell(answer.ppm)
