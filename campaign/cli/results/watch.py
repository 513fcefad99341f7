"""``clearcap watch``: follow a campaign that another process computes."""

import typer

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, console, print_json, say


def watch(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Follow the progress of a campaign until its coordinator ends; Ctrl-C ends only the following."""
    from campaign.cli.progress import display
    from campaign.coordinator.follow import heartbeats
    from campaign.store import open_store

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    heartbeat = None
    try:
        with display(console(stderr=True)) as show:
            for heartbeat in heartbeats(opened, campaign_id):
                show(heartbeat)
    except KeyboardInterrupt:
        say(f"no longer watching {campaign_id}, which goes on; watch it with: {opened.command('watch', campaign_id)}")
        raise typer.Exit(130) from None
    if json and heartbeat:
        print_json(heartbeat.to_json())
