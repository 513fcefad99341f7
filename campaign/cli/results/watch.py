"""``clearcap watch``: follow a campaign that another process computes."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import typer

from campaign.cli.at_server import ServerUrl, asked_server, command_at
from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, console, print_json, say

if TYPE_CHECKING:
    from campaign.client.remote_server import RemoteServer
    from campaign.coordinator.heartbeat import Heartbeat


def watch(
    context: typer.Context,
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    json: Json = False,
) -> None:
    """Follow the progress of a campaign until its coordinator ends; Ctrl-C stops only this display."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            command = command_at(remote, "watch", campaign_id)
            last = _follow(_heartbeats_of(remote, campaign_id), campaign_id, command)
    else:
        from campaign.coordinator.heartbeat import heartbeats
        from campaign.store import open_store

        opened = open_store(store)
        campaign_id = opened.find(campaign)
        last = _follow(heartbeats(opened, campaign_id), campaign_id, opened.command("watch", campaign_id))
    if json and last:
        print_json(last.to_json())


def _follow(heartbeats: "Iterable[Heartbeat]", campaign_id: str, command: str) -> "Heartbeat | None":
    """Show heartbeats as they arrive; return the last one."""
    from campaign.cli.progress import display

    heartbeat = None
    try:
        with display(console(stderr=True)) as show:
            for heartbeat in heartbeats:
                show(heartbeat)
    except KeyboardInterrupt:
        say(f"no longer watching {campaign_id}, which continues; watch it with: {command}")
        raise typer.Exit(130) from None
    return heartbeat


def _heartbeats_of(remote: "RemoteServer", campaign_id: str) -> "Iterator[Heartbeat]":
    """Yield the events of a server as heartbeats; before a coordinator has written one, count the rows."""
    from campaign.coordinator.heartbeat import Heartbeat

    counts = ("samples", "done", "ok", "failed", "left", "statuses", "repeats", "repeated")
    for event in remote.events(campaign_id):
        counted = event if event["samples"] is not None else remote.status(campaign_id)
        yield Heartbeat(
            **{name: event[name] for name in ("campaign", "state", "message", "eta_s")},
            **{name: counted[name] for name in counts},
            rate=event["rate"] or 0.0,
            workers=event["workers"] or 0,
            responses={name: dict(response) for name, response in event["responses"].items()},
        )
