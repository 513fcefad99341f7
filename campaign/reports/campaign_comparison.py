"""Two campaigns of a store side by side, as data."""

from dataclasses import asdict
from typing import Any

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.reports.report import report_rows, report_spec
from campaign.store import Store
from reporting import ReportError
from reporting.analysis import compare_rows


def comparison_document(store: Store, plan: Plan, other: Plan) -> dict[str, Any]:
    """Return what a report of a campaign says of another one, as its ``capability.json`` does under ``comparison``.

    Parameters
    ----------
    store : Store
        Where both campaigns are.
    plan, other : Plan
        The campaign, and the one that it is compared with.

    Raises
    ------
    CampaignError
        If one of them has no rows, their samples are corners, or they have no response in common.
    """
    mine, theirs = ((report_rows(store, each), report_spec(each, store)) for each in (plan, other))
    try:
        compared = compare_rows(*mine, *theirs)
    except ReportError as error:
        raise CampaignError(f"comparison of {plan.campaign_id} with {other.campaign_id}: {error}") from error
    return {"campaign": plan.campaign_id, "store": store.url, "comparison": asdict(compared)}
