"""``clearcap whatif`` and ``clearcap advise``: questions to the samples there are, without new runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.campaigns import Id, StoreUrl
from campaign.cli.output import Json, number, print_json, say

if TYPE_CHECKING:
    from reporting.tolerance.advice import Advice
    from reporting.tolerance.allocation import Allocation
    from reporting.tolerance.whatif import Estimate, WhatIf

Settings = Annotated[
    list[str],
    typer.Option(
        "--set", metavar="VARIABLE.KEY=VALUE", help="Change a distribution, as J1.std=0.01; repeat for others."
    ),
]


def whatif(campaign: Id = None, settings: Settings = [], store: StoreUrl = "runs", json: Json = False) -> None:  # noqa: B006
    """Say what the capability would be under other distributions, by weighting the samples there are.

    Exit status 1 if the samples cannot say: then the answer takes new runs, and how many is told.
    """
    from dataclasses import asdict

    import numpy as np

    from campaign.errors import SpecError
    from campaign.inputs.sampling import production_batch
    from campaign.reports.whatif import what_if
    from campaign.store import open_store

    if not settings:
        raise SpecError("nothing is changed; write for example --set J1.std=0.01")
    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    found = what_if(opened, plan, settings)
    if json:
        answers = {name: asdict(answer) for name, answer in found.items()}
        print_json({"campaign": plan.campaign_id, "store": opened.url, "set": settings, "responses": answers})
    else:
        _print_what_if(found, plan.mechanism.response_units())
    if production_batch(plan.spec, np.zeros(1, np.int64)) is not None:
        say("samples of a production batch share its shift; the intervals take them for independent and are too narrow")
    refused = {answer.refusal: answer.runs for answer in found.values() if answer.refusal}
    for reason, runs in refused.items():
        say(f"no answer: {reason}; run a campaign with these distributions, {runs} samples know Cpk to 5 %")
    if refused:
        raise typer.Exit(1)


def advise(
    campaign: Id = None,
    cost: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Cost file: propose the cheapest standard deviations.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Say how far each tolerance may grow, or with --cost which set of them is cheapest."""
    from dataclasses import asdict

    from campaign.reports.cost_file import read_costs
    from campaign.reports.tolerances import cheapest_tolerances, tolerance_advice
    from campaign.store import open_store

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    about = {"campaign": plan.campaign_id, "store": opened.url}
    if cost is None:
        advice, below = tolerance_advice(opened, plan)
        if json:
            lifted = {name: [asdict(each) for each in found] for name, found in below.items()}
            print_json({**about, "advice": [asdict(each) for each in advice], "below": lifted})
        else:
            _print_advice(advice, below)
        return
    proposal = cheapest_tolerances(opened, plan, read_costs(cost, plan))
    if json:
        print_json({**about, "allocation": asdict(proposal)})
    else:
        _print_allocation(proposal)
    if proposal.refusal:
        say(f"no proposal: {proposal.refusal}")
        raise typer.Exit(1)


def _print_what_if(found: "dict[str, WhatIf]", units: dict[str, str]) -> None:
    """Print one row a response."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="under the new distributions, 95 % intervals")
    for head in ("response", "mean", "sigma", "Cpk", "ppm out of limits", "worth samples"):
        table.add_column(head, justify="left" if head == "response" else "right")
    for name, answer in found.items():
        unit = units[name]
        label = name if unit == "1" else f"{name} [{unit}]"
        if answer.refusal:
            table.add_row(label, *["-"] * 4, f"{answer.effective:.0f}")
            continue
        cells = (_cell(each) for each in (answer.mean, answer.std, answer.cpk, answer.ppm))
        table.add_row(label, *cells, f"{answer.effective:.0f}")
    Console().print(table)


def _cell(estimate: "Estimate | None") -> str:
    """Return a number with its interval."""
    if estimate is None:
        return "-"
    low, high = estimate.interval
    return f"{number(estimate.value)} ({number(low, 4)} to {number(high, 4)})"


def _print_advice(advice: "tuple[Advice, ...]", below: "dict[str, tuple[Advice, ...]]") -> None:
    """Print one row a variable: how far it may grow, and how far it must shrink for each response that is below."""
    from rich.console import Console
    from rich.table import Table

    if advice:
        table = Table(title="how many times its sigma each variable may have, alone, with every Cpk of 1.33 staying so")
        for head in ("variable", "factor", "ended by", "its Cpk there", "method"):
            table.add_column(head)
        for each in advice:
            factor = "none" if each.factor is None else f"{'' if each.bounded else 'at least '}{each.factor:.3g}"
            binding = (each.binding or "-") if each.bounded else "nothing"
            table.add_row(each.variable, factor, binding, number(each.cpk, 4), each.method)
        Console().print(table)
    for response, found in below.items():
        table = Table(title=f"{response} is below Cpk 1.33: how many times its sigma each variable must have, alone")
        for head in ("variable", "factor", f"Cpk of {response} there", "method"):
            table.add_column(head)
        for each in found:
            factor = "none helps" if each.factor is None else f"{each.factor:.3g}"
            table.add_row(each.variable, factor, number(each.cpk, 4), each.method)
        Console().print(table)


def _print_allocation(proposal: "Allocation") -> None:
    """Print the proposal: sigmas, cost, what each response would have, and the run that confirms it."""
    from rich.console import Console
    from rich.table import Table

    if proposal.refusal:
        return
    table = Table(title=f"cheapest standard deviations: cost {number(proposal.cost)}, now {number(proposal.cost_now)}")
    for head in ("variable", "sigma", "times the present one"):
        table.add_column(head)
    for name, tolerance in proposal.tolerances.items():
        table.add_row(name, number(tolerance, 4), f"{proposal.factors[name]:.3g}")
    Console().print(table)
    for r in proposal.responses:
        bound = f", which sets the tolerances; 0.01 more costs {number(r.price, 3)}" if r.binding else ""
        print(f"{r.response}: Cpk {r.cpk:.4g} (target {r.target:g}){bound}")
    for note in proposal.notes:
        say(note)
    print(f"by {proposal.method}; confirm it by a campaign of {proposal.runs} samples with these sigmas")
