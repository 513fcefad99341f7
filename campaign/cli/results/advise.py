"""``clearcap advise``: advice on tolerances from the samples of a campaign, without new runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, number, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from reporting.tolerance.advice import Advice
    from reporting.tolerance.allocation import Allocation
    from reporting.tolerance.tolerance_advice import ToleranceAdvice


def advise(
    campaign: Id = None,
    cost: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Cost file: propose the cheapest standard deviations.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Show which tolerances must shrink and which may grow, or with --cost which set of tolerances is cheapest.

    Exit status 1 if a variable has no answer, or there is no set that reaches the targets; a message then says which
    and why. The other answers are printed all the same.
    """
    from dataclasses import asdict

    from campaign.reports.cost_file import read_costs
    from campaign.reports.tolerances import advice_document, advice_of, cheapest_tolerances
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK

    opened = open_store(store, QUICK)
    plan = opened.plan(opened.find(campaign))
    document = {"campaign": plan.campaign_id, "store": opened.url}
    if cost is None:
        advised = advice_of(opened, plan)
        if json:
            print_json({**document, **advice_document(advised)})
        else:
            _print_advice(advised)
        if advised.note:
            say(advised.note)
        if not _is_answered(advised):
            raise typer.Exit(1)
        return
    proposal = cheapest_tolerances(opened, plan, read_costs(cost, plan))
    if json:
        print_json({**document, "allocation": asdict(proposal)})
    else:
        _print_allocation(proposal)
    if proposal.refusal:
        say(f"no proposal: {proposal.refusal}")
        raise typer.Exit(1)


def _is_answered(advised: "ToleranceAdvice") -> bool:
    """Return whether every variable has an answer; print which variables have none."""
    if not advised.shortfalls and not advised.growth:
        return False
    asked = [(f"what lifts {s.response}", (*s.alone, s.together)) for s in advised.shortfalls]
    unanswered: dict[tuple[str, str], list[str]] = {}
    for question, found in (*asked, ("how much they may grow", advised.growth)):
        for each in found:
            if each is not None and each.refusal:
                unanswered.setdefault((question, each.refusal), []).append(each.variable)
    for (question, reason), names in unanswered.items():
        say(f"no answer for {', '.join(names)} ({question}): {reason}")
    return not unanswered


def _print_advice(advised: "ToleranceAdvice") -> None:
    """Print what must shrink for each response below Cpk 1.33, then how far each variable may grow for the others."""
    heads = ("variable", "factor", "95 % interval", "limited by", "Cpk then", "write, or try in whatif --set", "method")
    for short in advised.shortfalls:
        title = (
            f"{short.response} is below Cpk 1.33: factor on the present sigma of one variable alone that reaches 1.33"
        )
        together = () if short.together is None else (short.together,)
        print_table(title, heads, [_row(each) for each in (*short.alone, *together)])
        print_text(short.text)
    if not advised.growth:
        return
    title = f"factor on the present sigma of one variable alone that keeps {', '.join(advised.kept)} at Cpk 1.33"
    print_table(title, heads, [_row(each) for each in advised.growth])
    print_text("Each factor holds only while all other variables stay as they are.")
    for each in advised.growth:
        for response, cpk in each.below.items():
            print_text(f"{each.variable} at {each.factor:.3g}: {response}, already below Cpk 1.33, falls to {cpk:.4g}")


def _row(advice: "Advice") -> tuple[str, ...]:
    """Return the cells of one variable."""
    if advice.refusal:
        return advice.variable, "no answer", "-", advice.refusal, "-", "-", "-"
    ends = number(advice.cpk, 4), " ".join(advice.settings) or "-", advice.method
    if advice.factor is None:
        return advice.variable, f"none down to {advice.reach:.3g}", "-", advice.binding or "-", *ends
    low, high = advice.interval
    if not advice.bounded and advice.factor == 1:
        return advice.variable, "1", "-", _end_of(advice), *ends
    if not advice.bounded:
        return advice.variable, f"at least {advice.factor:.3g}", "-", _end_of(advice), *ends
    interval = f"{number(low, 3)} {'or more' if high is None else f'to {high:.3g}'}"
    return advice.variable, f"{advice.factor:.3g}", interval, advice.binding or "-", *ends


def _end_of(advice: "Advice") -> str:
    """Return why an advice ends if no response limits it."""
    words = {"samples": "the samples, which reach no farther", "search": "nothing that was tried so far"}
    return advice.limit or words[advice.ended_by]


def _print_allocation(proposal: "Allocation") -> None:
    """Print the proposal: sigmas, cost, Cpk of each response, and the campaign to confirm it."""
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
