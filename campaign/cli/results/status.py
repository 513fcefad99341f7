"""``clearcap status``: the progress of a campaign."""

from datetime import timedelta
from typing import TYPE_CHECKING, Any

from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.plan_header import PlanHeader
    from campaign.store import Store


def status(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Show the progress of a campaign: state, rows done, failed and left, and the last message of its coordinator."""
    from campaign.coordinator.state import state_of
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK
    from campaign.store.layout import HEARTBEAT

    opened = open_store(store, QUICK)
    header = opened.plan_header(opened.find(campaign))
    state, counts = state_of(opened, header.campaign_id), count_rows(opened, header)
    heartbeat = opened.read_json(header.campaign_id, HEARTBEAT) if state["state"] == "running" else None
    if json:
        document = {"campaign": header.campaign_id, "store": opened.url, **state, **counts}
        print_json({**document, "heartbeat": heartbeat})
        return
    done, failed, left = counts["done"], counts["failed"], counts["left"]
    print(f"{header.campaign_id}: {state['state']}, {done} of {counts['samples']} done, {failed} failed, {left} left")
    if state["message"]:
        print(f"  {state['message']}")
    if heartbeat:
        eta = "-" if heartbeat["eta_s"] is None else timedelta(seconds=round(heartbeat["eta_s"]))
        print(f"  {heartbeat['rate']:.1f} runs/s on {heartbeat['workers']} workers, ETA {eta}")
    for status, count in counts["statuses"].items():
        if status != "ok":
            print(f"  {count} {status}")


def count_rows(store: "Store", header: "PlanHeader") -> dict[str, Any]:
    """Return how many rows of a campaign are done and how they ended; print which parts are bad."""
    survey = store.survey(header)
    for reason in dict.fromkeys(survey.bad.values()):
        say(f"{header.campaign_id}: {reason}; clearcap resume computes its samples again")
    done, ok = survey.rows, survey.statuses.get("ok", 0)
    samples = store.end(header)
    counts = {"samples": samples, "done": done, "ok": ok, "failed": done - ok, "left": samples - done}
    return {**counts, "statuses": survey.statuses}
