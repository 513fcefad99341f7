"""``clearcap cancel``: end a campaign."""

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text


def cancel(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Stop a campaign; unfinished runs are given up, finished rows stay, and ``resume`` continues it."""
    from campaign.coordinator.cancellation import cancel_campaign
    from campaign.store import open_store

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    before = cancel_campaign(opened, campaign_id)
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, "before": before})
    elif before == "completed":
        print_text(f"{campaign_id} is completed; nothing to cancel")
    else:
        print_text(f"{campaign_id} was {before}; continue it with: {opened.command('resume', campaign_id)}")
