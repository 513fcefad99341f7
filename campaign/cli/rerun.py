"""``clearcap rerun``: compute failed rows again."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.drive import fail_without_enough_ok
from campaign.cli.options import CampaignId, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, print_text, say
from campaign.run_status import FailedStatus

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.coordinator.rerun import RerunResult


@on_cluster
def rerun(
    where: "Cluster",
    campaign: CampaignId,
    sample: Annotated[
        list[int] | None, typer.Option(min=0, help="Also the sample of this number; may be repeated.")
    ] = None,
    status: Annotated[
        list[FailedStatus] | None, typer.Option(help="All runs with this status; may be repeated.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Compute failed rows again, after you have removed the cause of the failures.

    Without --sample and --status, all failed rows. Exit status 1 if no run has a status that --status names, or if too
    few runs of the campaign are ok for a verdict.
    """
    from campaign.coordinator.rerun import failed_samples
    from campaign.coordinator.rerun import rerun as compute
    from campaign.store import open_store
    from campaign.store.repeat_sets import repeat_plans

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    by_status = failed_samples(opened, plan, status or ()) if status or not sample else []
    selected = sorted({*(sample or ()), *by_status})
    repeated = {*(sample or ())}
    for table in repeat_plans(opened, plan) if status or not sample else ():
        repeated.update(failed_samples(opened, table, status or ()))
    document = {"campaign": plan.campaign_id, "store": opened.url}
    if not selected and not repeated:
        wanted = f"has the status {' or '.join(status)}" if status else "failed"
        nothing = {**document, "samples": 0, "before": {}, "after": {}, "repeats": {}}
        print_json(nothing) if json else print_text(f"{plan.campaign_id}: no run {wanted}, nothing to compute")
        raise typer.Exit(1 if status else 0)
    say(f"computing {_rows(len(selected))} again")
    result = compute(opened, plan, selected, where, repeated=repeated)
    if json:
        print_json({**document, **result.to_json()})
    else:
        _print(result)
        print_text(f"update the report with: {opened.command('report', plan.campaign_id)}")
    fail_without_enough_ok(opened, plan, opened.survey(plan).statuses)


def _print(result: "RerunResult") -> None:
    """Print the number of rows computed again, and their statuses."""
    counts = ", ".join(f"{count} {status}" for status, count in result.after.items()) or "none"
    if result.repeats:
        counts += f"; {sum(result.repeats.values())} repeats with half the step: "
        counts += ", ".join(f"{count} {status}" for status, count in result.repeats.items())
    print_text(f"{_rows(result.samples)} computed again: {counts}")


def _rows(count: int) -> str:
    """Return a number of rows in words."""
    return f"{count} row{'' if count == 1 else 's'}"
