"""The comparison of two campaigns of a store, as data."""

from dataclasses import asdict
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.reports.report import report_rows, report_spec
from campaign.store import Store
from reporting import ReportError
from reporting.analysis import compare_rows


def comparison_document(store: Store, plan: Plan, other: Plan) -> dict[str, Any]:
    """Return the comparison of a campaign with another one, as under ``comparison`` in its ``capability.json``.

    Raises CampaignError if one of them has no rows, their samples are corners, or they have no response in common.
    """
    mine, theirs = ((report_rows(store, each), report_spec(each, store)) for each in (plan, other))
    try:
        compared = compare_rows(*mine, *theirs)
    except ReportError as error:
        raise CampaignError(f"comparison of {plan.campaign_id} with {other.campaign_id}: {error}") from error
    return {"campaign": plan.campaign_id, "store": store.url, "comparison": asdict(compared)}
