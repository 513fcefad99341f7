"""The outcome of a campaign and the verdict on each response, for the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from campaign.plan import Plan
    from campaign.store import Store


@dataclass(frozen=True)
class Verdicts:
    """The conclusions of a report."""

    headline: str = ""  # a sentence or two; empty if no report was written and enough runs are ok
    # By response, such as "capable, not certain"; empty if not known.
    words: dict[str, str] = field(default_factory=dict)


def reported_verdicts(store: "Store", plan: "Plan") -> Verdicts:
    """Return the verdicts of the report just written."""
    from campaign.store.files.files import LARGEST
    from campaign.store.layout import REPORT
    from reporting.write import NAMES

    content = store.read_json(plan.campaign_id, f"{REPORT}/{NAMES['json']}", LARGEST) or {}
    words = {
        response["spec"]["name"]: response["verdict"] + (", not certain" if response["certain"] is False else "")
        for response in content["responses"]
    }
    return Verdicts(content["headline"], words)


def verdicts_without_report(plan: "Plan", statuses: Mapping[str, int]) -> Verdicts:
    """Return the verdicts known without a report: no verdict on any response if too few runs are ok."""
    from campaign.coordinator.failed_runs import lack_of_ok

    lack = lack_of_ok(plan, statuses)
    if not lack:
        return Verdicts()
    limits = {name: response.limits()[:2] for name, response in plan.spec.responses.items()}
    return Verdicts(lack, {name: "no verdict" for name, ends in limits.items() if ends != (None, None)})
