"""``clearcap whatif``: predict responses under other distributions from a campaign's samples, without new runs."""

import math
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

    Exit status 1 if a response has no answer; a message then says which, why, and how many new runs it takes. The
    answers of the other responses are printed all the same.
    """
    from campaign.errors import SpecError
    from campaign.reports.whatif import refusals, what_if, what_if_document
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    if not settings:
        raise SpecError("no --set is given, so no distribution changes; write for example --set J1.std=0.01")
    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    answers = what_if(opened, plan, settings)
    document = what_if_document(plan, opened.url, settings, answers)
    if json:
        print_json(document)
    else:
        _print(answers, plan.mechanism.response_units())
    for assumption in document["assumed"]:
        say(assumption)
    for words in _failures(answers):
        say(words)
    for note in dict.fromkeys(note for answer in answers.values() for note in answer.notes):
        say(f"{', '.join(name for name, answer in answers.items() if note in answer.notes)}: {note}")
    refused = refusals(answers)
    for each in refused:
        of = "any response" if len(each.responses) == len(answers) > 1 else ", ".join(each.responses)
        say(
            f"no answer for {of}: {each.reason}; run a campaign with these distributions:"
            f" {each.runs} samples give Cpk, or sigma where there are no limits, to within 5 %"
        )
    if refused:
        raise typer.Exit(1)


def _failures(answers: "dict[str, WhatIf]") -> list[str]:
    """Return how many runs would have no value, in one line for all responses with the same share."""
    by_words: dict[str, list[str]] = {}
    for name, answer in answers.items():
        if answer.missing is not None and answer.dropped:
            now = answer.dropped / (answer.n + answer.dropped)
            words = f"{100 * answer.missing:.3g} % of the runs would have no value (now {100 * now:.3g} %)"
            by_words.setdefault(words, []).append(name)
    return [f"{', '.join(names)}: {words}; the numbers describe the others" for words, names in by_words.items()]


def _print(answers: "dict[str, WhatIf]", units: dict[str, str]) -> None:
    """Print a table with one row per response."""
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
    if not high > low:
        return number(estimate.value)
    if not math.isfinite(high - low):
        return f"{number(estimate.value)} (no interval)"
    # enough digits to distinguish the ends of the interval
    digits = 2 + math.floor(math.log10(max(abs(low), abs(high))) - math.log10(high - low))
    places = min(max(digits + 1, 5), 17)
    return f"{number(estimate.value, places)} ({number(low, places)} to {number(high, places)})"


def _ppm(answer: "WhatIf") -> str:
    """Return the share out of limits; only its bound if it is below one of the effective number of samples."""
    from reporting.format_numbers import ppm

    if answer.refusal or answer.ppm is None:
        return "-"
    if answer.ppm.value * answer.effective < 1e6:
        return f"at most {ppm(answer.ppm.interval[1])}"
    low, high = answer.ppm.interval
    return ppm(answer.ppm.value) if not high > low else f"{ppm(answer.ppm.value)} ({ppm(low)} to {ppm(high)})"
