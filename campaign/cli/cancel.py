"""``clearcap cancel``: end a campaign."""

import typer

from campaign.cli.at_server import ServerUrl, asked_server, command_at
from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text


def cancel(
    context: typer.Context,
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    json: Json = False,
) -> None:
    """Stop a campaign; unfinished runs are given up, finished rows stay, and "clearcap resume" continues it."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            before = remote.cancel(campaign_id)["before"]
        place, command = remote.address, command_at(remote, "resume", campaign_id)
    else:
        from campaign.coordinator.requests import cancel_campaign
        from campaign.store import open_store

        opened = open_store(store)
        campaign_id = opened.find(campaign)
        before = cancel_campaign(opened, campaign_id)
        place, command = opened.url, opened.command("resume", campaign_id)
    if json:
        print_json({"campaign": campaign_id, "store": place, "before": before})
    else:
        print_text(f"{campaign_id} {_what_happens(before, command)}")


def _what_happens(before: str, command: str) -> str:
    """Describe what happens to a campaign that was in a state, and how to continue it."""
    if before == "completed":
        return "is completed; there is nothing to cancel"
    if before == "running":
        return f"is running and stops within seconds; its finished rows stay. Continue it with: {command}"
    words = "was cancelled before" if before == "cancelled" else f"is cancelled; it was {before}"
    return f"{words}. Continue it with: {command}"
