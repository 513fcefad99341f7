"""``clearcap status`` and ``clearcap report``: what a store holds of a campaign."""

from datetime import timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.plan_header import PlanHeader
    from campaign.store import Store

Id = Annotated[str | None, typer.Argument(help="Id of the campaign; not needed if it is the only one.")]
StoreUrl = Annotated[str, typer.Option("--store", help="Folder or URL of the results.")]


def status(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Say how far a campaign is: its state, rows done, failed and left, and what its coordinator said last."""
    from campaign.coordinator.state import state_of
    from campaign.store import open_store
    from campaign.store.layout import HEARTBEAT

    opened = open_store(store)
    header = opened.plan_header(opened.find(campaign))
    state, counts = state_of(opened, header.campaign_id), progress(opened, header)
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


def progress(store: "Store", header: "PlanHeader") -> dict[str, Any]:
    """Return how many rows of a campaign are done and how they ended; say which parts are bad."""
    survey = store.survey(header)
    for reason in dict.fromkeys(survey.bad.values()):
        say(f"{header.campaign_id}: {reason}; run the campaign again to replace it")
    done, ok = survey.rows, survey.statuses.get("ok", 0)
    samples = store.end(header)
    counts = {"samples": samples, "done": done, "ok": ok, "failed": done - ok, "left": samples - done}
    return {**counts, "statuses": survey.statuses}


def watch(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Follow a campaign until nobody drives it any more; it does not mind."""
    from rich.console import Console

    from campaign.cli.progress import shown
    from campaign.coordinator.follow import heartbeats
    from campaign.store import open_store

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    heartbeat = None
    try:
        with shown(Console(stderr=True)) as show:
            for heartbeat in heartbeats(opened, campaign_id):
                show(heartbeat)
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    if json and heartbeat:
        print_json(heartbeat.to_json())


def report(
    campaign: Id = None,
    store: StoreUrl = "runs",
    against: Annotated[
        str | None, typer.Option(metavar="ID", help="Compare with another campaign of the store.")
    ] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf/--no-pdf", help="Write report.pdf too; it takes most of the time.")
    ] = False,
    excel: Annotated[bool, typer.Option("--excel/--no-excel", help="Write report.xlsx too.")] = True,
    json: Json = False,
) -> None:
    """Write the report of a campaign again, from the rows there are; it may be running."""
    from campaign.reports.report import report as write
    from campaign.store import open_store

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    kinds = ["html", "json", "parquet", *(["pdf"] if pdf else []), *(["xlsx"] if excel else [])]
    files = write(opened, opened.plan(campaign_id), kinds=kinds, against=against)
    if pdf and "pdf" not in files:
        say("report.pdf takes WeasyPrint: pip install 'clearcap[pdf]'")
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, "report": files})
        return
    for path in files.values():
        print(f"report: {path}")
