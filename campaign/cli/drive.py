"""What the verbs that compute a campaign share: plan it, show its progress, write its report, print its results."""

from collections import Counter
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import typer

from campaign.cli.output import console, number, print_json, print_table, print_text, say

if TYPE_CHECKING:
    import pyarrow as pa

    from campaign.cluster.cluster import Cluster
    from campaign.coordinator.coordinate import Outcome
    from campaign.plan import Plan
    from campaign.store import Store


def drive(
    store: "Store", plan: "Plan", cluster: "Cluster", *, with_report: bool, as_json: bool, quiet: bool = False
) -> None:
    """Compute a campaign to its end, write its report, and print the results.

    Raises
    ------
    typer.Exit
        1 if no run succeeded, or fewer than the campaign asks for; 130 on Ctrl-C, 143 on SIGTERM, 129 on SIGHUP.
    """
    from campaign.cli.progress import display
    from campaign.coordinator.coordinate import coordinate

    try:
        with nullcontext(lambda _: None) if quiet else display(console(stderr=True)) as show:
            outcome = coordinate(store, plan, cluster, show)
    except (KeyboardInterrupt, SystemExit) as ending:
        command = store.command("resume", plan.campaign_id, *cluster.options())
        say(f"interrupted; the finished rows are kept in {store.url}. Continue with:\n  {command}")
        raise typer.Exit(130 if isinstance(ending, KeyboardInterrupt) else int(str(ending.code))) from None
    finish(store, outcome, with_report=with_report, as_json=as_json)


def finish(store: "Store", outcome: "Outcome", *, with_report: bool, as_json: bool) -> None:
    """Write the report, print the results, and fail if too few runs succeeded."""
    plan, files = outcome.plan, {}
    if with_report:
        from campaign.reports.report import report

        files = report(store, plan)
    if as_json:
        print_json(_summary(store, outcome, files))
    else:
        _print_results(store, outcome)
        if files:
            print_text(f"report: {files['html']}")
    ok, least = outcome.survey.statuses.get("ok", 0), plan.spec.failures.min_ok
    if ok == 0:
        messages = Counter(text for rows in store.stream(plan, ["message"]) for text in rows["message"].to_pylist())
        worst, count = messages.most_common(1)[0]
        say(f"error: no run succeeded; the message of {count} of {messages.total()} runs: {worst}")
    elif ok < least * outcome.samples:
        say(f"error: {ok} of {outcome.samples} runs succeeded; failures.min_ok asks for {least:g} of them")
    else:
        return
    raise typer.Exit(1)


def _summary(store: "Store", outcome: "Outcome", files: dict[str, str]) -> dict[str, Any]:
    statuses = outcome.survey.statuses
    ok = statuses.get("ok", 0)
    return {
        "campaign": outcome.plan.campaign_id,
        "store": store.url,
        "samples": outcome.samples,
        "ok": ok,
        "failed": outcome.samples - ok,
        "computed": outcome.computed,
        "wall_s": outcome.wall_s,
        "statuses": statuses,
        "stop": outcome.verdict.to_json() if outcome.verdict else None,
        "report": files,
    }


def _print_results(store: "Store", outcome: "Outcome") -> None:
    """Print how the runs ended, and the capability of each response."""
    import pyarrow as pa

    from campaign.inputs.sampling import sampler_named
    from campaign.worker.moments import plain_rows
    from reporting import capability

    plan = outcome.plan
    names = list(plan.mechanism.responses)
    columns = [*names, *sampler_named(plan.spec.sampler).columns]
    rows = pa.concat_tables([plan.schema.empty_table().select(columns), *store.stream(plan, columns)])
    plain = plain_rows(rows)
    table = []
    units = plan.mechanism.response_units()
    for name in names:
        response = plan.spec.responses.get(name)
        lsl, usl, target = response.limits() if response else (None, None, None)
        values = plain[name].drop_null().to_numpy()
        c = capability(values, lsl=lsl, usl=usl, target=target)
        ppm = "-" if c.ppm_observed is None else f"{c.ppm_observed:.0f}"
        if "log_weight" in columns and c.ppm_observed is not None:
            ppm = f"{_weighted_ppm(rows, name, lsl, usl):.3g}"
        cells = (number(c.mean), number(c.std, 3), number(lsl), number(usl), number(c.cpk, 3), ppm)
        table.append((name, units[name], *cells))
    heads = ("response", "unit", "mean", "sigma", "LSL", "USL", "Cpk", "ppm out")
    print_table(plan.spec.title or plan.spec.name, heads, table, texts=2)
    counts = ", ".join(f"{count} {status}" for status, count in outcome.survey.statuses.items())
    print_text(f"{outcome.samples} runs: {counts}; {outcome.computed} computed in {outcome.wall_s:.1f} s")
    if outcome.verdict:
        precision = "precise enough" if outcome.verdict.sure else "not precise enough yet"
        print_text(f"{precision}: {outcome.verdict.text()}")


def _weighted_ppm(rows: "pa.Table", name: str, lsl: float | None, usl: float | None) -> float:
    """Return the share of rejects by the weights of importance sampling [ppm]."""
    import numpy as np

    y, weights = rows[name].to_numpy(), np.exp(rows["log_weight"].to_numpy())
    rejects = (y < (-np.inf if lsl is None else lsl)) | (y > (np.inf if usl is None else usl))
    return float(1e6 * np.sum(weights[rejects]) / rows.num_rows)
