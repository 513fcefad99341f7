"""``clearcap advise``: how far tolerances may grow, answered by the samples of a campaign without new runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, number, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from reporting.tolerance.advice import Advice
    from reporting.tolerance.allocation import Allocation

_ENDS = {
    "samples": "the samples, which say nothing of more",
    "bounds": "its bounds, which allow no more",
    "search": "nothing that was tried",
}


def advise(
    campaign: Id = None,
    cost: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Cost file: propose the cheapest standard deviations.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Show how far each tolerance may grow, or with --cost which set of tolerances is cheapest."""
    from dataclasses import asdict

    from campaign.reports.cost_file import read_costs
    from campaign.reports.tolerances import cheapest_tolerances, tolerance_advice
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK

    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    document = {"campaign": plan.campaign_id, "store": opened.url}
    if cost is None:
        advice, below = tolerance_advice(opened, plan)
        if json:
            lifting = {name: [asdict(each) for each in needed] for name, needed in below.items()}
            print_json({**document, "advice": [asdict(each) for each in advice], "below": lifting})
        else:
            _print_advice(advice, below)
        return
    proposal = cheapest_tolerances(opened, plan, read_costs(cost, plan))
    if json:
        print_json({**document, "allocation": asdict(proposal)})
    else:
        _print_allocation(proposal)
    if proposal.refusal:
        say(f"no proposal: {proposal.refusal}")
        raise typer.Exit(1)


def _print_advice(advice: "tuple[Advice, ...]", below: "dict[str, tuple[Advice, ...]]") -> None:
    """Print one row a variable: how far it may grow, and how far it must shrink for each response below Cpk 1.33."""
    heads = ("variable", "factor", "95 % interval", "limited by", "Cpk at the factor", "method")
    if advice:
        title = "factor on the present sigma of each variable alone with which no response falls below Cpk 1.33"
        print_table(title, heads, [_row(each) for each in advice])
    for response, needed in below.items():
        title = f"{response} is below Cpk 1.33: factor on the present sigma of each variable alone that reaches 1.33"
        print_table(title, heads, [_row(each) for each in needed])


def _row(advice: "Advice") -> tuple[str, ...]:
    """Return the cells of one variable."""
    if advice.refusal:
        return advice.variable, "no answer", "-", advice.refusal, "-", "-"
    numbers = number(advice.cpk, 4), advice.method
    if advice.factor is None:
        return advice.variable, "no factor", "-", f"{advice.binding}, down to {advice.reach:.3g}", *numbers
    low, high = advice.interval
    if not advice.bounded:
        return advice.variable, f"at least {advice.factor:.3g}", "-", f"{_ENDS[advice.ended_by]}", *numbers
    interval = f"{number(low, 3)} {'or more' if high is None else f'to {high:.3g}'}"
    return advice.variable, f"{advice.factor:.3g}", interval, advice.binding or "-", *numbers


def _print_allocation(proposal: "Allocation") -> None:
    """Print the proposal: sigmas, cost, Cpk of each response, and the campaign that confirms it."""
    if proposal.refusal:
        return
    heads: tuple[str, ...] = ("variable", "sigma", "factor on the present sigma")
    rows: list[tuple[str, ...]] = [
        (name, number(sigma, 4), f"{proposal.factors[name]:.3g}") for name, sigma in proposal.tolerances.items()
    ]
    if proposal.processes:
        heads, rows = (*heads, "process"), [(*row, proposal.processes.get(row[0], "-")) for row in rows]
    now = "not known" if proposal.cost_now is None else number(proposal.cost_now)
    print_table(f"cheapest standard deviations: cost {number(proposal.cost)}, now {now}", heads, rows)
    for r in proposal.responses:
        bound = ", which limits the tolerances" if r.binding else ""
        price = f"; 0.01 more Cpk costs {number(r.price, 3)}" if r.binding and r.price is not None else ""
        print_text(f"{r.response}: Cpk {r.cpk:.4g} (target {r.target:g}){bound}{price}")
    for note in proposal.notes:
        say(note)
    print_text(f"computed by {proposal.method}; confirm it with a campaign of {proposal.runs} samples and these sigmas")
