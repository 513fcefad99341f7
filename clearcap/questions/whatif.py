"""Predict the responses under other distributions of the variables, without new runs."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.samples import SampleColumns, independent_samples, limits_of, lots_of
from campaign.store import Store
from clearcap.questions.changed_distributions import change_distributions, check_drawn
from clearcap.questions.variable_settings import changed_variables
from reporting import ReportError
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import WhatIf, what_if_all


@dataclass(frozen=True)
class Refused:
    """Responses that share the reason why there is no answer."""

    reason: str  # why the samples give no answer
    responses: tuple[str, ...]
    runs: int  # new runs that give Cpk, or sigma without limits, of each of these responses to within 5 %


def what_if(store: Store, plan: Plan, settings: Sequence[str]) -> dict[str, WhatIf]:
    """Return `what_if_from` for the samples in the store."""
    check_drawn(plan.spec)
    changed_variables(plan.spec, settings)  # report faults of settings before reading any row
    return what_if_from(plan, independent_samples(store, plan), settings)


def what_if_from(plan: Plan, columns: SampleColumns, settings: Sequence[str]) -> dict[str, WhatIf]:
    """Return every response under changed distributions; for the settings see `changed_variables`.

    Raises SpecError if a setting is impossible, or the samples are not drawn from distributions; CampaignError if
    `reporting` refuses the samples.
    """
    change = change_of(plan, columns, settings)
    responses = {name: columns.values[name] for name in plan.mechanism.responses}
    try:
        return what_if_all(responses, change, limits_of(plan), lots=lots_of(plan, columns.number))
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error


def change_of(plan: Plan, columns: SampleColumns, settings: Sequence[str]) -> Change:
    """Return the effect of settings on the samples; raises the same errors as `what_if_from`."""
    check_drawn(plan.spec)
    return change_distributions(plan.spec, changed_variables(plan.spec, settings).variables, columns.values)


def refusals(answers: Mapping[str, WhatIf]) -> list[Refused]:
    """Return the responses without an answer, grouped by reason."""
    by_reason: dict[str, list[str]] = {}
    for name, answer in answers.items():
        if answer.refusal:
            by_reason.setdefault(answer.refusal, []).append(name)
    return [
        Refused(reason, tuple(names), max(answers[name].runs for name in names)) for reason, names in by_reason.items()
    ]


def what_if_document(
    plan: Plan, store_url: str, settings: Sequence[str], answers: Mapping[str, WhatIf]
) -> dict[str, Any]:
    """Return the answers as data, as ``clearcap whatif --json`` and the web service write them."""
    return {
        "campaign": plan.campaign_id,
        "store": store_url,
        "set": list(settings),
        "assumed": changed_variables(plan.spec, settings).assumptions,
        "responses": {name: asdict(answer) for name, answer in answers.items()},
        "refused": [asdict(each) for each in refusals(answers)],
    }
