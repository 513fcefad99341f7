"""Functions shared by the verbs that compute a campaign: show progress, write the report, print results."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import typer

from campaign.waits import counted
from clearcap.cli.output import console, mean_number, number, print_json, print_table, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.cluster.workers import PrestartedWorkers
    from campaign.coordinator.coordinate import Outcome
    from campaign.plan import Plan
    from campaign.store import Store


@dataclass(frozen=True)
class Verdicts:
    """The conclusions of a report."""

    headline: str = ""  # a sentence or two; empty if no report was written and enough runs are ok
    # By response, such as "capable, not certain"; empty if not known.
    words: dict[str, str] = field(default_factory=dict)
    indices: dict[str, str] = field(default_factory=dict)  # those that decide, by response


def reported_verdicts(store: "Store", plan: "Plan") -> Verdicts:
    """Return the verdicts of the report just written."""
    from campaign.store.files.files import LARGEST
    from campaign.store.layout import REPORT
    from reporting.format_numbers import index
    from reporting.write import NAMES

    content = store.read_json(plan.campaign_id, f"{REPORT}/{NAMES['json']}", LARGEST) or {}
    words = {
        response["spec"]["name"]: response["verdict"] + (", not certain" if response["certain"] is False else "")
        for response in content["responses"]
    }
    indices = {r["spec"]["name"]: index(r["index"]) for r in content["responses"] if r["index"] is not None}
    return Verdicts(content["headline"], words, indices)


def verdicts_without_report(plan: "Plan", statuses: Mapping[str, int]) -> Verdicts:
    """Return the verdicts known without a report: no verdict on any response if too few runs are ok."""
    from campaign.coordinator.coordinate import lack_of_ok

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
    quiet: bool = False,
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
    from campaign.coordinator.coordinate import TooManyFailed, coordinate
    from clearcap.cli.progress import display

    def computed(plan: "Plan") -> "Outcome":
        with nullcontext(lambda _: None) if quiet else display(console(stderr=True)) as show:
            return coordinate(store, plan, cluster, show, connect=workers.connect)

    try:
        with early or PrestartedWorkers(cluster) as workers:
            outcome = computed(plan)
            if with_report if decide is None else decide:
                from clearcap.questions.decision import decide as decided  # loads reporting, after the runs

                decided(store, plan, computed, say)
    except (KeyboardInterrupt, SystemExit) as ending:
        command = store.command("resume", plan.campaign_id, *cluster.options())
        say(f"interrupted; the finished rows are kept in {store.url}. Continue with:\n  {command}")
        raise typer.Exit(130 if isinstance(ending, KeyboardInterrupt) else int(str(ending.code))) from None
    except TooManyFailed:
        if with_report:
            say(f"report of the runs so far: {_report(store, plan)['html']}")
        raise
    finish(store, outcome, with_report=with_report, as_json=as_json)


def finish(store: "Store", outcome: "Outcome", *, with_report: bool, as_json: bool) -> None:
    """Write the report, print the results, and fail if too few runs succeeded."""
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
    from campaign.coordinator.coordinate import lack_of_ok, what_to_do

    lack = lack_of_ok(plan, statuses)
    if lack:
        say(f"error: {lack}\n{what_to_do(store, plan)}")
        raise typer.Exit(1)


def _summary(store: "Store", outcome: "Outcome", files: dict[str, str], verdicts: Verdicts) -> dict[str, Any]:
    statuses = outcome.survey.statuses
    ok = statuses.get("ok", 0)
    return {
        "campaign": outcome.plan.campaign_id,
        "store": store.url,
        "samples": outcome.samples,
        "ok": ok,
        "failed": outcome.plan.failed(statuses),
        "computed": outcome.computed,
        "wall_s": outcome.wall_s,
        "statuses": statuses,
        "headline": verdicts.headline,
        "verdicts": verdicts.words,
        "stop": outcome.verdict.to_json() if outcome.verdict else None,
        "report": files,
    }


def _print_results(store: "Store", outcome: "Outcome", verdicts: Verdicts) -> None:
    """Print the outcome in a sentence, the runs by status, and the capability of each response."""
    from clearcap.questions.report import brief_indices
    from reporting.format_numbers import index

    plan, table = outcome.plan, []
    for each in brief_indices(store, plan):
        label = each.response if each.unit in ("", "1") else f"{each.response} [{each.unit}]"
        limits = number(each.lsl), number(each.usl)
        ppm = "-" if each.ppm is None else f"{each.ppm:.3g}" if each.is_weighted else f"{each.ppm:.0f}"
        cells = (mean_number(each.mean, each.std), number(each.std, 3), *limits, index(each.cpk), ppm)
        table.append((label, verdicts.words.get(each.response, "-"), verdicts.indices.get(each.response, "-"), *cells))
    heads = ("response", "verdict", "index", "mean", "sigma", "LSL", "USL", "Cpk", "ppm out")
    if verdicts.headline:
        print_text(verdicts.headline)
    print_table(plan.spec.title or plan.spec.name, heads, table, texts=2, bold="index")
    counts = ", ".join(f"{count} {status}" for status, count in outcome.survey.statuses.items())
    print_text(f"{counted(outcome.samples, 'run')}: {counts}; {outcome.computed} computed in {outcome.wall_s:.1f} s")
    if outcome.verdict:
        precision = "precise enough" if outcome.verdict.sure else "not precise enough yet"
        print_text(f"{precision}: {outcome.verdict.text()}")
