"""The cheapest tolerances, confirmed by fresh runs of the simulator: round after round, until nothing is missed.

A round proposes tolerances from the rows of a campaign and judges them by a campaign of their own, drawn anew. If a
response misses its target there, or a tolerance had to stop where the rows do, the fresh rows, which lie where the
proposal is, propose the next set. Each campaign is a function of the rows before it, so a later call continues with the
same campaigns.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from campaign.coordinator.failed_runs import lack_of_ok
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError, SpecError
from campaign.plan import Plan, make_plan
from campaign.samples import independent_samples, lots_of
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.load import Campaign
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.submissions import Capacity, submit_related
from clearcap.questions.tolerances import Costs, cheapest_tolerances, read_cost_text
from clearcap.questions.whatif import changed_variables
from reporting.capability.intervals import Interval
from reporting.tolerance.allocation import Allocation
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import what_if_all

MOST_ROUNDS = 4
_WORTH = 0.01  # share of the cost that must be saved for a further round of what may grow farther
_LEFT_OUT = ("stop", "importance", "sampler")  # samples are drawn from the distributions themselves, all of them

Verdict = Literal["reached", "within error", "missed"]
Outcome = Literal["confirmed", "missed", "refused", "computing"]


@dataclass(frozen=True)
class FreshResponse:
    """A response of fresh runs beside what was promised."""

    response: str
    target: float
    promised: float  # Cpk, with its interval
    promised_interval: Interval | None
    cpk: float | None  # of the fresh runs, with its 95 % interval; None without spread
    cpk_interval: Interval | None
    ppm_interval: Interval | None  # 95 %, of the share out of limits
    verdict: Verdict  # whether the interval lies above the target, contains it, or lies below


@dataclass(frozen=True)
class Round:
    """A proposal and the fresh runs that judge it."""

    rows: str  # id of the campaign whose rows propose
    proposal: Allocation
    campaign: str  # id of the fresh runs
    state: str  # of that campaign
    responses: tuple[FreshResponse, ...] = ()  # empty before it is complete
    fault: str = ""  # why its runs judge nothing; empty if they do

    @property
    def missed(self) -> bool:
        """Whether fresh runs refute the proposal."""
        return bool(self.fault) or any(each.verdict == "missed" for each in self.responses)


@dataclass(frozen=True)
class Confirmation:
    """Rounds of proposals and fresh runs; the last proposal is the one to use if the outcome is "confirmed"."""

    outcome: Outcome
    proposal: Allocation  # the last one
    rounds: tuple[Round, ...] = field(default=())

    @property
    def text(self) -> str:
        """The outcome in a sentence."""
        last = self.rounds[-1] if self.rounds else None
        if self.outcome == "refused" or last is None:
            return f"no proposal: {self.proposal.refusal}"
        if self.outcome == "computing":
            return f"{last.campaign} judges the proposal and is {last.state}; ask again when it is completed"
        runs = f"{self.proposal.runs} fresh runs ({last.campaign})"
        near = ", ".join(each.response for each in last.responses if each.verdict == "within error")
        if self.outcome == "confirmed" and near:
            return f"not refuted by {runs}: the interval of the Cpk contains the target of {near}"
        if self.outcome == "confirmed":
            return f"confirmed by {runs}"
        names = ", ".join(each.response for each in last.responses if each.verdict == "missed")
        return f"not confirmed: {last.fault or f'{names}: Cpk of {runs} is below the target'}"


def confirm(
    store: Store,
    plan: Plan,
    costs: Costs,
    compute: Callable[[Plan], object] | None = None,
    by: str = "",
    capacity: Capacity | None = None,
) -> Confirmation:
    """Return the rounds, whose fresh campaigns `compute` completes.

    Without `compute` they are queued, and the outcome is "computing" as soon as one is not complete.
    """
    rounds, of, within = list[Round](), plan, _with_bounds(plan, costs)
    while True:
        proposal = _of_first(rounds, plan, cheapest_tolerances(store, of, within))
        if proposal.refusal:
            return Confirmation("refused", proposal, tuple(rounds))
        if rounds and not rounds[-1].missed and _saving(rounds[-1].proposal, proposal) < _WORTH:
            return Confirmation("confirmed", rounds[-1].proposal, tuple(rounds))
        campaign = _fresh_campaign(of, plan, proposal)
        name = make_plan(campaign).campaign_id
        if name not in store.campaigns():
            submit_related(store, plan, campaign, by, capacity or Capacity())
        fresh = store.plan(name)
        if compute is not None and store.survey(fresh).missing:
            compute(fresh)
        rounds.append(_judged(store, of, fresh, proposal))
        if store.survey(fresh).missing:
            return Confirmation("computing", proposal, tuple(rounds))
        last = rounds[-1]
        if len(rounds) == MOST_ROUNDS or last.fault or not (last.missed or proposal.covered):
            return Confirmation("missed" if last.missed else "confirmed", proposal, tuple(rounds))
        of = fresh


def confirm_in_store(store: str, campaign_id: str, costs: str, by: str, capacity: Capacity) -> dict[str, Any]:
    """Return the document of the rounds so far, and queue the campaign of the next; for a job of a server."""
    opened = open_store(store, QUICK)
    plan = opened.plan(campaign_id)
    found = confirm(opened, plan, read_cost_text(costs, plan), by=by, capacity=capacity)
    return confirmation_document(plan, opened.url, found)


def confirmation_document(plan: Plan, store_url: str, found: Confirmation) -> dict[str, Any]:
    """Return the rounds as ``clearcap advise --cost FILE --confirm --json`` and the web service write them."""
    return {"campaign": plan.campaign_id, "store": store_url, "text": found.text, "confirmation": asdict(found)}


def _with_bounds(plan: Plan, costs: Costs) -> Costs:
    """Return costs whose bounds do not depend on the campaign that is asked: those of the first one."""
    bounded = {}
    for name, cost in costs.variables.items():
        std = plan.spec.variables[name].moments()[1]
        lower, upper = cost.bounds(std)
        bounded[name] = cost.model_copy(update={"lower": lower, "upper": upper})
    return costs.model_copy(update={"variables": bounded})


def _of_first(rounds: list[Round], plan: Plan, proposal: Allocation) -> Allocation:
    """Return a proposal of a later round with factors, present cost and what to write of the first campaign."""
    if not rounds or proposal.refusal:
        return proposal
    before = rounds[-1].proposal
    now = {name: plan.spec.variables[name].moments()[1] for name in proposal.tolerances}
    return replace(
        proposal,
        factors={name: tolerance / now[name] for name, tolerance in proposal.tolerances.items()},
        cost_now=before.cost_now,
        written={name: lines or before.written.get(name, ()) for name, lines in proposal.written.items()},
    )


def _saving(before: Allocation, after: Allocation) -> float:
    if not before.cost or after.cost is None:
        return 0.0
    return 1 - after.cost / before.cost


def _fresh_campaign(of: Plan, plan: Plan, proposal: Allocation) -> Campaign:
    """Return the campaign that judges a proposal: its sigmas as they are written, drawn anew."""
    settings = [line for lines in proposal.written.values() for line in lines]
    variables = {**plan.spec.variables, **changed_variables(plan.spec, settings).variables}
    given = plan.spec.model_dump(exclude_none=True)
    tables: dict[str, Any] = {key: value for key, value in given.items() if key not in _LEFT_OUT}
    tables |= {"samples": proposal.runs, "seed": of.spec.seed + 1}
    tables |= {"variables": {name: each.model_dump(exclude_none=True) for name, each in variables.items()}}
    try:
        return Campaign(CampaignSpec.model_validate(tables), plan.mechanism)
    except ValidationError as error:
        reasons = "; ".join(each["msg"].removeprefix("Value error, ") for each in error.errors())
        raise SpecError(f"{plan.campaign_id}: no campaign can confirm its tolerances: {reasons}") from error


def _judged(store: Store, of: Plan, fresh: Plan, proposal: Allocation) -> Round:
    """Return the round with what its fresh runs say, if they are complete."""
    survey, name = store.survey(fresh), fresh.campaign_id
    known = Round(of.campaign_id, proposal, name, state_of(store, name)["state"])
    if survey.missing:
        return known
    if fault := lack_of_ok(fresh, survey.statuses):
        return replace(known, state="completed", fault=fault)
    columns = independent_samples(store, fresh)
    limits = {r.response: fresh.spec.responses[r.response].limits()[:2] for r in proposal.responses}
    values = {each: columns.values[each] for each in limits}
    answers = what_if_all(values, Change(np.zeros(columns.number.size)), limits, lots=lots_of(fresh, columns.number))
    responses = []
    for r in proposal.responses:
        answer = answers[r.response]
        if answer.refusal:
            raise CampaignError(f"{name}: {r.response}: {answer.refusal}")
        cpk, ppm = answer.cpk, answer.ppm
        responses.append(
            FreshResponse(
                response=r.response,
                target=r.target,
                promised=r.cpk,
                promised_interval=r.cpk_interval,
                cpk=None if cpk is None else cpk.value,
                cpk_interval=None if cpk is None else cpk.interval,
                ppm_interval=None if ppm is None else ppm.interval,
                verdict=_verdict(None if cpk is None else cpk.interval, r.target),
            )
        )
    return replace(known, state="completed", responses=tuple(responses))


def _verdict(interval: Interval | None, target: float) -> Verdict:
    if interval is None or interval[0] >= target:
        return "reached"
    return "missed" if interval[1] < target else "within error"
