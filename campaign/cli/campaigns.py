"""``clearcap status`` and ``clearcap report``: what a store holds of a campaign."""

from typing import Annotated

import typer

from campaign.cli.output import Json, print_json

Id = Annotated[str | None, typer.Argument(help="Id of the campaign; not needed if it is the only one.")]
StoreUrl = Annotated[str, typer.Option("--store", help="Folder or URL of the results.")]


def status(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Say how far a campaign is: rows done, failed and left."""
    from campaign.store import count_statuses, open_store, warn_of_bad_parts

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    scan = opened.scan(plan)
    warn_of_bad_parts(plan, scan)
    statuses = count_statuses(scan)
    done, ok = scan.table.num_rows, statuses.get("ok", 0)
    left = plan.spec.samples - done
    if json:
        document = {"campaign": plan.campaign_id, "store": opened.url, "samples": plan.spec.samples}
        counts = {"done": done, "ok": ok, "failed": done - ok, "left": left, "statuses": statuses}
        print_json({**document, **counts})
    else:
        print(f"{plan.campaign_id}: {done} of {plan.spec.samples} done, {done - ok} failed, {left} left")


def report(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Write the report of a campaign again, from the rows there are."""
    from campaign.report import report as write
    from campaign.store import open_store

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    files = write(opened, opened.plan(campaign_id), opened.table(campaign_id))
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, "report": files})
    else:
        print(f"report: {files['html']}")
