"""The job that writes the report of a campaign."""

from collections.abc import Collection

from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.report import report
from reporting.write import USUAL


def written_report(
    store: str, campaign: str, against: str | None = None, kinds: Collection[str] = USUAL
) -> dict[str, str]:
    """Write the report of a campaign, or its comparison with another; return the path or URL of each file by kind."""
    opened = open_store(store, QUICK)
    return report(opened, opened.plan(campaign), kinds=kinds, against=against)
