"""Verbs that compute campaigns: ``run``, ``resume``, ``rerun``, ``repeat``, ``submit`` and ``cancel``."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import FailedStatus, SpecError
from campaign.waits import counted
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
    opened_store,
)
from clearcap.cli.output import (
    Json,
    console,
    display,
    labelled,
    mean_number,
    number,
    print_json,
    print_table,
    print_text,
    say,
)

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.coordinate import Outcome
    from campaign.plan import Plan
    from campaign.spec.load import Campaign as Loaded
    from campaign.store import Store


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
        bool, typer.Option("--dry-run", help="Check the campaign and print its variables, and with --cluster its jobs.")
    ] = False,
    json: Json = False,
) -> None:
    """Compute a campaign, with further runs for verdicts that are not certain, and write its capability report.

    If the samples leave a verdict uncertain, up to 4,000 further runs are drawn where rejects are likely, as campaigns
    of their own; the table decide of the campaign file sets another number. The same command, given again, continues
    where the earlier one stopped, and computes nothing if the campaign is complete.
    """
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.submit import plan_campaign
    from campaign.spec.load import load_campaign
    from campaign.store.layout import CANCEL

    if dry_run:
        _print_plan(load_campaign(campaign, samples=samples, seed=seed), where)
        return
    with PrestartedWorkers(where) as early:
        opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, when_new=early.begin)
        opened.remove(plan.campaign_id, CANCEL)
        say(f"campaign {plan.campaign_id}: {counted(plan.spec.samples, 'sample')}, store {opened.url}")
        drive(opened, plan, where, with_report=not no_report, as_json=json, early=early, decide=decide)


def _print_plan(loaded: "Loaded", where: "Cluster") -> None:
    """Print what a campaign varies, and the jobs that a batch system would get; nothing is computed or submitted."""
    from engine.mechanism import full_key

    say(f"{counted(loaded.spec.samples, 'sample')}; nothing is computed")
    targets, variables = loaded.spec.targets(), loaded.spec.variables
    rows = [[name, full_key(loaded.mechanism, targets[name]), each.text()] for name, each in variables.items()]
    print_table("What varies", ["variable", "key", "distribution"], rows)
    if not where.starts_here and not where.scheduler:
        from campaign.cluster.batch_systems import submission

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
        said = _counts(result.after) or "none"
        if result.repeats:
            repeats = sum(result.repeats.values())
            said += f"; {repeats} repeats with half the step: {_counts(result.repeats)}"
        print_text(f"{counted(result.samples, 'row')} computed again: {said}")
        print_text(f"update the report with: {opened.command('report', plan.campaign_id)}")
    fail_without_enough_ok(opened, plan, opened.survey(plan).statuses)


def _counts(statuses: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {status}" for status, count in statuses.items())


@on_cluster
def repeat(
    where: "Cluster",
    campaign: CampaignId,
    share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of the samples to repeat, those already repeated included.")
    ] = 0.1,
    store: StoreUrl = "runs",
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Simulate samples again with half the step, so that the report shows how much results depend on it."""
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
        str | None,
        typer.Option(metavar="NAME", help="Owner of a new campaign, who is responsible for it; by default you."),
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
            raise SpecError(
                "--server: the server decides where and in which batches to compute; leave those options out"
            )
        from campaign.spec.campaign_cautions import campaign_questions

        for question in campaign_questions(campaign):
            say(question)
        with remote:
            made = remote.submit(campaign, samples=samples, seed=seed, owner=owner, tags=tag)
        campaign_id, number, place, driver = (
            made["campaign"],
            made["samples"],
            remote.address,
            dict[str, Any](AT_SERVER),
        )
        words = f"server {place}; {'; '.join(filter(None, (made['cost']['text'], made['note'])))}"
    else:
        from campaign.coordinator.submit import assign_coordinator, plan_campaign
        from campaign.store.labels import LabelChange

        labels = LabelChange(owner, tuple(tag))
        opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, labels)
        assignment = assign_coordinator(opened, plan, where.options(), queue_only=queue_only)
        campaign_id, number, place, driver = plan.campaign_id, plan.spec.samples, opened.url, assignment.to_json()
        words = f"store {place}; {assignment.text(opened)}"
    say(f"campaign {campaign_id}: {counted(number, 'sample')}, {words}")
    document = {"campaign": campaign_id, "store": place, "samples": number, **driver}
    if json:
        print_json(document)
    else:
        print_text(document["campaign"])


def cancel(
    context: typer.Context, campaign: Id = None, store: StoreUrl = "runs", server: ServerUrl = None, json: Json = False
) -> None:
    """Stop a campaign; finished rows stay, unfinished runs are given up, and "clearcap resume" continues it."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            before = remote.cancel(campaign_id)["before"]
        place, command = remote.address, command_at(remote, "resume", campaign_id)
    else:
        from campaign.coordinator.requests import cancel_campaign
        from campaign.coordinator.state import resume_command

        opened = opened_store(store, is_patient=True)
        campaign_id = opened.find(campaign)
        before = cancel_campaign(opened, campaign_id)
        place, command = opened.url, resume_command(opened, campaign_id)
    if json:
        print_json({"campaign": campaign_id, "store": place, "before": before})
    else:
        happens = "is completed; there is nothing to cancel"
        if before == "running":
            happens = f"is running and stops within seconds; its finished rows stay. Continue it with: {command}"
        elif before != "completed":
            happens = "was cancelled before" if before == "cancelled" else f"is cancelled; it was {before}"
            happens += f". Continue it with: {command}"
        print_text(f"{campaign_id} {happens}")


@dataclass(frozen=True)
class Verdicts:
    """The conclusions of a report."""

    headline: str = ""  # a sentence or two; empty if no report was written and enough runs are ok
    words: dict[str, str] = field(default_factory=dict)  # by response, as "capable, not certain"; empty if not known
    indices: dict[str, str] = field(default_factory=dict)  # those that decide, by response


def reported_verdicts(store: "Store", plan: "Plan") -> Verdicts:
    """Return the verdicts of the report just written."""
    from campaign.store.files.files import LARGEST
    from campaign.store.layout import REPORT
    from reporting.format_numbers import deciding_index
    from reporting.write import NAMES

    content = store.read_json(plan.campaign_id, f"{REPORT}/{NAMES['json']}", LARGEST) or {}
    responses = {response["spec"]["name"]: response for response in content["responses"]}
    words = {name: r["verdict"] + (", not certain" if r["certain"] is False else "") for name, r in responses.items()}
    indices = {name: deciding_index(r["index"], r["index_low"]) for name, r in responses.items()}
    return Verdicts(content["headline"], words, indices)


def verdicts_without_report(plan: "Plan", statuses: Mapping[str, int]) -> Verdicts:
    """Return the verdicts known without a report: no verdict on any response if too few runs are ok."""
    from campaign.coordinator.failed_runs import lack_of_ok

    lack = lack_of_ok(plan, statuses)
    if not lack:
        return Verdicts()
    limits = {name: response.limits()[:2] for name, response in plan.spec.responses.items()}
    return Verdicts(lack, {name: "no verdict" for name, ends in limits.items() if ends != (None, None)})


def drive(
    store: "Store",
    plan: "Plan",
    cluster: "Cluster",
    *,
    with_report: bool,
    as_json: bool,
    early: "PrestartedWorkers | None" = None,
    decide: bool | None = False,
) -> None:
    """Compute a campaign to its end, write its report, and print the results.

    With ``decide``, further runs that aim at rejects decide the verdicts that the samples leave open; None means with a
    report. ``early`` are workers of the cluster that have already been started. Raises TooManyFailed, after the report
    of the finished rows is written, if more runs failed than the campaign allows. Exits with 1 if no run succeeded, or
    fewer than the campaign requires; with 130 on Ctrl-C, 143 on SIGTERM, 129 on SIGHUP.
    """
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.coordinate import coordinate
    from campaign.coordinator.failed_runs import TooManyFailed

    def computed(plan: "Plan") -> "Outcome":
        with display(console(stderr=True)) as show:
            return coordinate(store, plan, cluster, show, connect=workers.connect)

    command = store.command("resume", plan.campaign_id, *cluster.options())
    try:
        with continued_by(store, command), early or PrestartedWorkers(cluster) as workers:
            outcome = computed(plan)
            if with_report if decide is None else decide:
                from clearcap.questions.decision import decide as decided  # loads reporting, after the runs

                decided(store, plan, computed, say)
    except TooManyFailed:
        if with_report:
            say(f"report of the runs so far: {_report(store, plan)['html']}")
        raise
    plan, statuses = outcome.plan, outcome.survey.statuses
    files = _report(store, plan) if with_report else {}
    verdicts = reported_verdicts(store, plan) if with_report else verdicts_without_report(plan, statuses)
    if as_json:
        print_json(_summary(store, outcome, files, verdicts))
    else:
        _print_results(store, outcome, verdicts)
        if files:
            print_text(f"report: {files['html']}")
    fail_without_enough_ok(store, plan, statuses)


@contextmanager
def continued_by(store: "Store", command: str) -> Iterator[None]:
    """Where a computation is interrupted, say by which command it continues, and end with the status of the signal."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as ending:
        say(f"interrupted; the finished rows are kept in {store.url}. Continue with:\n  {command}")
        raise typer.Exit(130 if isinstance(ending, KeyboardInterrupt) else int(str(ending.code))) from None


def _report(store: "Store", plan: "Plan") -> dict[str, str]:
    """Write the report; return the path of each file by kind. That of a signed campaign stays as it is."""
    from campaign.coordinator.requests import SignedCampaign
    from campaign.store.store import report_folder
    from clearcap.questions.report import report
    from reporting.write import NAMES

    try:
        return report(store, plan)
    except SignedCampaign as signed:
        say(str(signed))
        folder = report_folder(plan.campaign_id)
        files = {kind: f"{folder}/{name}" for kind, name in NAMES.items()}
        return {kind: store.files.address(name) for kind, name in files.items() if store.files.exists(name)}


def fail_without_enough_ok(store: "Store", plan: "Plan", statuses: Mapping[str, int]) -> None:
    """If too few runs of a campaign are ok, print the reason and the remedy, and end with exit status 1."""
    from campaign.coordinator.failed_runs import lack_of_ok, what_to_do

    if lack := lack_of_ok(plan, statuses):
        say(f"error: {lack}\n{what_to_do(store, plan)}")
        raise typer.Exit(1)


def _summary(store: "Store", outcome: "Outcome", files: dict[str, str], verdicts: Verdicts) -> dict[str, Any]:
    statuses = outcome.survey.statuses
    counts = {"samples": outcome.samples, "ok": statuses.get("ok", 0), "failed": outcome.plan.failed(statuses)}
    return {
        **{"campaign": outcome.plan.campaign_id, "store": store.url, **counts},
        **{"computed": outcome.computed, "wall_s": outcome.wall_s, "statuses": statuses},
        **{"headline": verdicts.headline, "verdicts": verdicts.words},
        "stop": outcome.verdict.to_json() if outcome.verdict else None,
        "report": files,
    }


def _print_results(store: "Store", outcome: "Outcome", verdicts: Verdicts) -> None:
    """Print the outcome in a sentence, the runs by status, and the capability of each response."""
    from clearcap.questions.report import brief_indices
    from reporting.format_numbers import index

    plan, table = outcome.plan, []
    for each in brief_indices(store, plan):
        limits = number(each.lsl), number(each.usl)
        ppm = "-" if each.ppm is None else f"{each.ppm:.3g}" if each.is_weighted else f"{each.ppm:.0f}"
        cells = (mean_number(each.mean, each.std), number(each.std, 3), *limits, index(each.cpk), ppm)
        found = (known.get(each.response, "-") for known in (verdicts.words, verdicts.indices))
        table.append((labelled(each.response, each.unit), *found, *cells))
    heads = ("response", "verdict", "index", "mean", "sigma", "LSL", "USL", "Cpk", "ppm out")
    if verdicts.headline:
        print_text(verdicts.headline)
    print_table(plan.spec.title or plan.spec.name, heads, table, texts=2, bold="index")
    counts = _counts(outcome.survey.statuses)
    print_text(f"{counted(outcome.samples, 'run')}: {counts}; {outcome.computed} computed in {outcome.wall_s:.1f} s")
    if outcome.verdict:
        precision = "precise enough" if outcome.verdict.sure else "not precise enough yet"
        print_text(f"{precision}: {outcome.verdict.text()}")
