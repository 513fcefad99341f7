"""``clearcap run``: a campaign to its end on this machine, then the report."""

import shlex
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.output import Json, number, print_json, say

if TYPE_CHECKING:
    from campaign.run import Outcome
    from campaign.store import Store


def run(
    campaign: Annotated[str, typer.Argument(help="A shipped campaign (c60) or a campaign file.")],
    samples: Annotated[int | None, typer.Option(help="Samples, instead of the file's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the file's.")] = None,
    store: Annotated[str, typer.Option(help="Folder or URL of the results.")] = "runs",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default one a core.")] = None,
    batch_size: Annotated[int | None, typer.Option(min=1, help="Samples a batch, of a new campaign.")] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Leave the report out.")] = False,
    json: Json = False,
) -> None:
    """Simulate a campaign and write its capability report.

    The same command goes on where an earlier one stopped, and computes nothing when all is there.
    """
    from campaign.errors import SpecError
    from campaign.load import load_campaign
    from campaign.store import open_store

    opened = open_store(store)
    if not opened.files.shared:
        raise SpecError(f"store {store}: workers cannot reach the memory of this process; name a folder or a URL")
    asked = load_campaign(campaign, samples=samples, seed=seed)
    opened.files.check_writable()
    from rich.console import Console

    from campaign.local import cores
    from campaign.progress import watcher
    from campaign.run import run_campaign, submit

    console = Console(stderr=True)
    plan = submit(opened, asked, batch_size)
    say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {store}")
    try:
        outcome = run_campaign(
            opened,
            plan,
            workers or cores(),
            lambda total, done, failed: watcher(console, total, done, failed),
        )
    except KeyboardInterrupt:
        _say_how_to_resume(opened, campaign, store, samples, seed, workers)
        raise typer.Exit(130) from None
    _finish(opened, outcome, with_report=not no_report, as_json=json)


def _finish(store: "Store", outcome: "Outcome", *, with_report: bool, as_json: bool) -> None:
    """Write the report, print the results, and fail if no run succeeded."""
    plan, table = outcome.plan, outcome.scan.table
    files: dict[str, str] = {}
    if with_report:
        from campaign.report import report

        files = report(store, plan, table)
    ok = outcome.statuses.get("ok", 0)
    if as_json:
        print_json(_summary(store, outcome, files))
    else:
        _print_results(outcome)
        if files:
            print(f"report: {files['html']}")
    if ok == 0:
        worst, count = Counter(table["message"].to_pylist()).most_common(1)[0]
        say(f"error: not one run succeeded; {count} of {table.num_rows} say: {worst}")
        raise typer.Exit(1)


def _summary(store: "Store", outcome: "Outcome", files: dict[str, str]) -> dict[str, Any]:
    samples, statuses = outcome.plan.spec.samples, outcome.statuses
    return {
        "campaign": outcome.plan.campaign_id,
        "store": store.url,
        "samples": samples,
        "ok": statuses.get("ok", 0),
        "failed": samples - statuses.get("ok", 0),
        "computed": outcome.computed,
        "wall_s": outcome.wall_s,
        "statuses": statuses,
        "report": files,
    }


def _print_results(outcome: "Outcome") -> None:
    """Print how the runs ended and what the responses are worth."""
    from rich.console import Console
    from rich.table import Table

    from reporting import capability

    plan, rows = outcome.plan, outcome.scan.table
    shown = Table(title=plan.spec.title or plan.spec.name)
    for head in ("response", "unit", "mean", "sigma", "LSL", "USL", "Cpk", "ppm out"):
        shown.add_column(head, justify="left" if head in ("response", "unit") else "right", no_wrap=True)
    units = plan.mechanism.response_units()
    for name in plan.mechanism.responses:
        asked = plan.spec.responses.get(name)
        lsl, usl, target = asked.limits() if asked else (None, None, None)
        values = rows[name].drop_null().to_numpy()
        c = capability(values, lsl=lsl, usl=usl, target=target)
        ppm = "-" if c.ppm_observed is None else f"{c.ppm_observed:.0f}"
        cells = (number(c.mean), number(c.std, 3), number(lsl), number(usl), number(c.cpk, 3), ppm)
        shown.add_row(name, units[name], *cells)
    Console().print(shown)
    counts = ", ".join(f"{count} {status}" for status, count in outcome.statuses.items())
    print(f"{plan.spec.samples} runs: {counts}; {outcome.computed} computed in {outcome.wall_s:.1f} s")


def _say_how_to_resume(
    store: "Store", campaign: str, url: str, samples: int | None, seed: int | None, workers: int | None
) -> None:
    """Tell an interrupted user the command that goes on."""
    words = ["clearcap", "run", campaign, "--store", url]
    for option, value in (("--samples", samples), ("--seed", seed), ("--workers", workers)):
        words += [] if value is None else [option, str(value)]
    say(f"interrupted; what is finished is kept in {store.url}. Go on with:\n  {shlex.join(words)}")
