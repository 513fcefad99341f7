"""The folders of a campaign's reports: its own, and one for each campaign that it was compared with."""

from campaign.store.files.files import TEMPORARY
from campaign.store.layout import COMPARISONS, REPORT
from campaign.store.store import Store


def report_folder(campaign_id: str, against: str | None = None) -> str:
    """Return the folder of a campaign's report, or of its comparison with another campaign, relative to the store."""
    return f"{campaign_id}/{REPORT}" if against is None else f"{campaign_id}/{COMPARISONS}/{against}"


def comparisons(store: Store, campaign_id: str) -> dict[str, list[str]]:
    """Return the names of the files of a campaign's comparisons, by the id of the other campaign.

    A comparison is kept if the other campaign is deleted.
    """
    others = store.files.names(f"{campaign_id}/{COMPARISONS}")
    written = {other: store.files.names(report_folder(campaign_id, other)) for other in others}
    whole = {other: [name for name in names if not name.endswith(TEMPORARY)] for other, names in written.items()}
    return {other: names for other, names in whole.items() if names}
