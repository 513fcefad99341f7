"""Verbs that compute campaigns: ``run``, ``resume``, ``rerun``, ``repeat``, ``submit`` and ``cancel``."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import FailedStatus
from campaign.waits import counted
from clearcap.cli.drive import drive, fail_without_enough_ok
from clearcap.cli.options import (
    AT_SERVER,
    BatchSize,
    Campaign,
    CampaignId,
    Decide,
    Id,
    NoReport,
    Samples,
    Seed,
    ServerUrl,
    StoreUrl,
    asked_server,
    command_at,
    on_cluster,
    opened_campaign,
)
from clearcap.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.coordinator.rerun import RerunResult


@on_cluster
def run(
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    batch_size: BatchSize = None,
    decide: Decide = None,
    no_report: NoReport = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the campaign and print what would be submitted with --cluster.")
    ] = False,
    json: Json = False,
) -> None:
    """Simulate a campaign to its end, decide what it leaves open, and write its capability report.

    If plain samples leave a verdict not certain, up to 4,000 further runs are drawn where rejects are expected, as
    campaigns of their own; the table decide of the campaign file sets another number. The same command, given again,
    continues where the earlier one stopped, and computes nothing if the campaign is complete.
    """
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.submit import plan_campaign
    from campaign.store.layout import CANCEL

    if dry_run:
        _print_submission(where, campaign, samples, seed)
        return
    with PrestartedWorkers(where) as early:
        opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, when_new=early.begin)
        opened.remove(plan.campaign_id, CANCEL)
        say(f"campaign {plan.campaign_id}: {counted(plan.spec.samples, 'sample')}, store {opened.url}")
        drive(opened, plan, where, with_report=not no_report, as_json=json, early=early, decide=decide)


def _print_submission(where: "Cluster", campaign: str, samples: int | None, seed: int | None) -> None:
    """Print what would be submitted for a campaign, after its file has been checked."""
    from campaign.cluster.batch_systems import submission
    from campaign.errors import SpecError
    from campaign.spec.load import load_campaign

    if where.starts_here or where.scheduler:
        raise SpecError(
            "--dry-run: submits nothing in any case without --cluster slurm, oar, pbs or kubernetes; add it"
        )
    loaded = load_campaign(campaign, samples=samples, seed=seed)
    say(f"{counted(loaded.spec.samples, 'sample')}; nothing is submitted")
    print_text(submission(where), lines=True)


@on_cluster
def resume(
    context: typer.Context,
    where: "Cluster",
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    detach: Annotated[
        bool, typer.Option("--detach", help="Hand the campaign to a coordinator and return, as submit does.")
    ] = False,
    decide: Decide = None,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Continue a campaign that was interrupted or cancelled, or that failed; at a server it is queued."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            note = remote.resume(campaign_id)["note"]
        say(f"campaign {campaign_id}: {note}")
        if json:
            print_json({"campaign": campaign_id, "store": remote.address, **AT_SERVER})
        return
    from campaign.coordinator.submit import assign_coordinator
    from campaign.store.layout import CANCEL

    opened, plan = opened_campaign(store, campaign, is_patient=True)
    opened.remove(plan.campaign_id, CANCEL)
    if not detach:
        drive(opened, plan, where, with_report=not no_report, as_json=json, decide=decide)
        return
    assignment = assign_coordinator(opened, plan, where.options())
    say(assignment.text(opened))
    if json:
        print_json({"campaign": plan.campaign_id, "store": opened.url, **assignment.to_json()})


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
    from campaign.store.store import repeat_plans

    opened, plan = opened_campaign(store, campaign, is_patient=True)
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
    say(f"computing {counted(len(selected), 'row')} again")
    result = compute(opened, plan, selected, where, repeated=repeated)
    if json:
        print_json({**document, **result.to_json()})
    else:
        _print_rerun(result)
        print_text(f"update the report with: {opened.command('report', plan.campaign_id)}")
    fail_without_enough_ok(opened, plan, opened.survey(plan).statuses)


def _print_rerun(result: "RerunResult") -> None:
    """Print the number of rows computed again, and their statuses."""
    counts = ", ".join(f"{count} {status}" for status, count in result.after.items()) or "none"
    if result.repeats:
        counts += f"; {sum(result.repeats.values())} repeats with half the step: "
        counts += ", ".join(f"{count} {status}" for status, count in result.repeats.items())
    print_text(f"{counted(result.samples, 'row')} computed again: {counts}")


@on_cluster
def repeat(
    where: "Cluster",
    campaign: CampaignId,
    share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of the samples to repeat; counting those that already are.")
    ] = 0.1,
    store: StoreUrl = "runs",
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Repeat samples with half the step, so that the report tells how far results depend on it."""
    from campaign.coordinator.lease import hold_lease
    from campaign.coordinator.requests import refuse_signed
    from campaign.store.layout import CANCEL
    from campaign.store.store import add_share, repeated_shares
    from campaign.worker.messages import check_build

    opened, plan = opened_campaign(store, campaign, is_patient=True)
    check_build(plan.campaign_id, plan.row_build)
    with hold_lease(opened, plan.campaign_id):
        before = repeated_shares(opened, plan)[-1]
        refuse_signed(opened, plan.campaign_id)
        add_share(opened, plan, share)
    if share <= before:
        say(f"{plan.campaign_id} repeats {before:g} of its samples already; for more give a larger --share")
    opened.remove(plan.campaign_id, CANCEL)
    drive(opened, plan, where, with_report=not no_report, as_json=json)


@on_cluster
def submit(
    context: typer.Context,
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    batch_size: BatchSize = None,
    queue_only: Annotated[
        bool, typer.Option("--queue-only", help="Only queue the campaign, for a coordinator that serves the store.")
    ] = False,
    owner: Annotated[
        str | None, typer.Option(metavar="NAME", help="Who answers for a new campaign; by default you.")
    ] = None,
    tag: Annotated[list[str], typer.Option(metavar="TAG", help="Give it a tag; may be repeated.")] = [],  # noqa: B006
    json: Json = False,
) -> None:
    """Hand a campaign to a coordinator in the background, print its id, and return.

    If a coordinator serves the store, it computes the campaign; otherwise one is started, which goes on after this
    terminal is closed. A server gets the campaign file with the files that it names, which must lie beside it, and
    decides itself where and in which batches it computes.
    """
    if remote := asked_server(context, server):
        if batch_size is not None or where.options():
            from campaign.errors import SpecError

            raise SpecError("--server: decides where and in which batches it computes; leave those options out")
        from campaign.spec.campaign_cautions import campaign_questions

        for question in campaign_questions(campaign):
            say(question)
        with remote:
            made = remote.submit(campaign, samples=samples, seed=seed, owner=owner, tags=tag)
        words = "; ".join(filter(None, (made["cost"]["text"], made["note"])))
        say(f"campaign {made['campaign']}: {counted(made['samples'], 'sample')}, server {remote.address}; {words}")
        document = {"campaign": made["campaign"], "store": remote.address, "samples": made["samples"]}
        _print_submitted(document | AT_SERVER, json)
        return
    from campaign.coordinator.submit import assign_coordinator, plan_campaign
    from campaign.store.labels import LabelChange

    labels = LabelChange(owner, tuple(tag))
    opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, labels)
    assignment = assign_coordinator(opened, plan, where.options(), queue_only=queue_only)
    number = counted(plan.spec.samples, "sample")
    say(f"campaign {plan.campaign_id}: {number}, store {opened.url}; {assignment.text(opened)}")
    document = {"campaign": plan.campaign_id, "store": opened.url, "samples": plan.spec.samples}
    _print_submitted(document | assignment.to_json(), json)


def _print_submitted(document: dict[str, Any], as_json: bool) -> None:
    """Print the id, or the whole document as JSON."""
    if as_json:
        print_json(document)
    else:
        print_text(document["campaign"])


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
        from campaign.coordinator.state import resume_command
        from campaign.store import open_store

        opened = open_store(store)
        campaign_id = opened.find(campaign)
        before = cancel_campaign(opened, campaign_id)
        place, command = opened.url, resume_command(opened, campaign_id)
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
