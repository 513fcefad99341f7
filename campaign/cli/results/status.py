"""``clearcap status``: the progress of a campaign."""

from datetime import datetime
from typing import TYPE_CHECKING, Any

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.coordinator.heartbeat import Heartbeat
    from campaign.plan_header import PlanHeader
    from campaign.store import Store

ENDED = ("cancelled", "failed", "interrupted", "incomplete")  # states that only `resume` changes


def status(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Show the progress of a campaign: state, rows done, failed and left, and the last message of its coordinator."""
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK
    from campaign.store.report_folders import comparisons, report_folder

    opened = open_store(store, QUICK)
    header = opened.plan_header(opened.find(campaign))
    state, counts = progress(opened, header)
    others = comparisons(opened, header.campaign_id)
    heartbeat = _heartbeat(opened, header.campaign_id) if state["state"] == "running" else None
    compared = {other: opened.files.address(report_folder(header.campaign_id, other)) for other in others}
    if state["fault"]:
        say(f"{header.campaign_id}: {state['fault']}")
    if json:
        document = {"campaign": header.campaign_id, "store": opened.url, **state, **counts}
        print_json({**document, "heartbeat": heartbeat and heartbeat.to_json(), "comparisons": compared})
        return
    done, failed, left = counts["done"], counts["failed"], counts["left"]
    done_so_far = f"{done} of {counts['samples']} done, {failed} failed, {left} left"
    repeats = f", {counts['repeated']} of {counts['repeats']} repeats" if counts["repeats"] else ""
    print_text(f"{header.campaign_id}: {state['state']}, {done_so_far}{repeats}")
    if state["message"]:
        print_text(f"  {state['message']}")
    if heartbeat:
        from campaign.cli.progress import eta

        print_text(f"  {heartbeat.rate:.1f} runs/s on {heartbeat.workers} workers, ETA {eta(heartbeat.eta_s)}")
    for status, count in counts["statuses"].items():
        if status != "ok":
            print_text(f"  {count} {status}")
    for other, place in compared.items():
        print_text(f"  compared with {other}: {place}")
    if state["state"] in ENDED:
        print_text(f"  continue it with: {opened.command('resume', header.campaign_id)}")


def progress(store: "Store", header: "PlanHeader") -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the state of a campaign, its date as ISO 8601, and how many of its rows are done and how they ended.

    A campaign that was completed and lost rows since is ``incomplete``.
    """
    from campaign.coordinator.state import state_of

    state, counts = state_of(store, header.campaign_id), _count_rows(store, header)
    if state["state"] == "completed" and counts["left"]:
        message = f"{counts['left']} rows were lost after the campaign was completed"
        state |= {"state": "incomplete", "message": message}
    since = state["since"]
    date = None if since is None else datetime.fromtimestamp(since).astimezone().isoformat(timespec="seconds")
    return {**state, "since": date}, counts


def _heartbeat(store: "Store", campaign_id: str) -> "Heartbeat | None":
    """Return the last heartbeat of a campaign's coordinator; None if there is none, or none that can be read."""
    from campaign.coordinator.heartbeat import (
        Heartbeat,  # loads the engine's names, which an idle campaign does without
    )
    from campaign.store.layout import HEARTBEAT

    written = store.read_json(campaign_id, HEARTBEAT)
    heartbeat = Heartbeat.from_json(written or {})
    if written and not heartbeat:
        say(f"{campaign_id}: {HEARTBEAT} was not written by clearcap; its coordinator replaces it")
    return heartbeat


def _count_rows(store: "Store", header: "PlanHeader") -> dict[str, Any]:
    """Return how many rows of a campaign are done and how they ended; print which parts are bad."""
    from campaign.store.repeat_sets import repeat_plans, survey_repeats

    survey, repeats = store.survey(header), survey_repeats(store, repeat_plans(store, header))
    for reason in dict.fromkeys([*survey.bad.values(), *repeats.bad]):
        command = store.command("resume", header.campaign_id)
        say(f"{header.campaign_id}: {reason}; compute its samples again with: {command}")
    done, ok = survey.rows, survey.statuses.get("ok", 0)
    samples = store.end(header)
    counts = {"samples": samples, "done": done, "ok": ok, "failed": done - ok, "left": samples - done}
    return {**counts, "statuses": survey.statuses, "repeats": repeats.planned, "repeated": repeats.done}
