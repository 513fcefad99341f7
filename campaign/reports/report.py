"""From a plan and its rows to the report: says to reporting, in plain data, what the columns mean."""

import platform
import shlex
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.errors import CampaignError
from campaign.inputs.distributions import Array, Continuous
from campaign.inputs.sampling import production_batch, sampler_named
from campaign.plan import Plan
from campaign.reports.changed_distributions import widened
from campaign.spec.campaign_file import Response
from campaign.store import Store
from campaign.store.layout import REPORT, STOPPED
from campaign.version import clearcap_version
from engine.mechanism import unit_of
from reporting import Design, ReportError, ReportSpec, ResponseSpec, VariableSpec, write_report
from reporting.tolerance.reweighting import Change
from reporting.write import USUAL

BATCH = "production batch"
_CDF_POINTS = 401
_CERTIFICATE = ("sample", "status", "message", "wall_s", "max_residual", "max_penetration", "settled")


def report(
    store: Store,
    plan: Plan,
    rows: "pa.Table | Iterable[pa.Table] | None" = None,
    *,
    kinds: Collection[str] = USUAL,
    against: str | None = None,
) -> dict[str, str]:
    """Write the report of a campaign into its folder of the store.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    plan : Plan
        The campaign.
    rows : pyarrow.Table or iterable of pyarrow.Table, optional
        Its rows; read from the store, a file at a time, if not given.
    kinds : collection of str
        Files to write, see `reporting.write.NAMES`.
    against : str, optional
        Id of another campaign of the store to compare with.

    Returns
    -------
    dict of str to str
        Path or URL of each file by kind: ``html``, ``json``, ...

    Raises
    ------
    CampaignError
        If there is nothing to report on.
    """
    other = None if against is None else store.plan(store.find(against))
    compared = None if other is None else (_rows(store, other), report_spec(other, store))
    told = {"kinds": kinds, "widen": partial(_widened, plan), "against": compared}
    try:
        return _write(store, plan, _with_batches(plan, _rows(store, plan) if rows is None else rows), told)
    except ReportError as error:
        raise CampaignError(f"report of {plan.campaign_id}: {error}") from error


def _widened(plan: Plan, variable: str, columns: Mapping[str, Array], factor: float) -> Change:
    return widened(plan.spec, {variable: factor}, columns)


def _rows(store: Store, plan: Plan) -> "Iterator[pa.Table]":
    """Yield the columns of a campaign that a report reads, a file at a time; at least an empty table."""
    columns = [*_CERTIFICATE, *plan.spec.variables, *plan.mechanism.responses]
    yield plan.schema.empty_table().select(columns)
    yield from store.stream(plan, columns)


def _with_batches(plan: Plan, rows: "pa.Table | Iterable[pa.Table]") -> "pa.Table | Iterable[pa.Table]":
    """Return the rows with the number of their production batch, if there are any."""
    if not _batched(plan):
        return rows
    tables = [rows] if isinstance(rows, pa.Table) else rows
    return (t.append_column(BATCH, pa.array(production_batch(plan.spec, t["sample"].to_numpy()))) for t in tables)


def _batched(plan: Plan) -> bool:
    return production_batch(plan.spec, np.zeros(1, np.int64)) is not None


def _write(store: Store, plan: Plan, rows: "pa.Table | Iterable[pa.Table]", told: dict[str, Any]) -> dict[str, str]:
    """Write the report next to the parts; behind a URL, upload it."""
    folder = f"{plan.campaign_id}/{REPORT}"
    spec = report_spec(plan, store)
    if store.files.local:
        return write_report(rows, spec, Path(store.files.path(folder)), **told)
    with tempfile.TemporaryDirectory(prefix="clearcap-report-") as temporary:
        written = write_report(rows, spec, Path(temporary), **told)
        names = {kind: f"{folder}/{Path(path).name}" for kind, path in written.items()}
        for kind, path in written.items():
            store.files.write(names[kind], Path(path).read_bytes())
    return {kind: store.files.address(name) for kind, name in names.items()}


def report_spec(plan: Plan, store: Store | None = None) -> ReportSpec:
    """Return what reporting must know of a plan, and of the store it is in."""
    spec, sampler = plan.spec, sampler_named(plan.spec.sampler)
    place = [] if store is None or store.url == "runs" else ["--store", store.url]
    return ReportSpec(
        title=spec.title or spec.name,
        campaign=plan.campaign_id,
        header=dict(spec.header),
        responses=tuple(_response(plan, name) for name in plan.mechanism.responses),
        variables=tuple(_variable(plan, name) for name in spec.variables),
        provenance=provenance(plan, place),
        requested=spec.samples if store is None else store.end(plan),
        simulate=_simulate(plan),
        sampler=spec.sampler,
        replay=shlex.join(["clearcap", "replay", *place, plan.campaign_id]),
        correlations=spec.correlations or (),
        production_batch_column=BATCH if _batched(plan) else "",
        stop=_stop(plan, store),
        design=Design(sampler.production, sampler.report),
        corners=sampler.corners,
        designed=sampler.designed(spec),
    )


def provenance(plan: Plan, place: Iterable[str] = ()) -> dict[str, str]:
    """Return what is needed to get the same rows again; ``place`` are options that say where the store is."""
    spec = plan.spec
    simulation = plan.mechanism.simulation
    unit = unit_of(plan.mechanism, "simulation.step")
    return {
        "campaign": plan.campaign_id,
        "mechanism": spec.mechanism,
        "mechanism digest": plan.mechanism.digest(),
        "samples": str(spec.samples),
        "sampler": spec.sampler,
        "seed": str(spec.seed),
        "step": f"{spec.simulation.step or simulation.step:g} {unit}",
        "horizon": f"{spec.simulation.horizon or simulation.horizon:g} {unit}",
        "engine build": plan.engine_build,
        "clearcap": clearcap_version(),
        "python": platform.python_version(),
        "report written on": f"{platform.node()}, {platform.machine()}, {platform.system()}",
        "command of this report": shlex.join(["clearcap", "report", plan.campaign_id, *place]),
    }


def _stop(plan: Plan, store: Store | None) -> str:
    """Return what the stopping rule says, in words."""
    rule = plan.spec.stop
    if rule is None:
        return ""
    asked = f"Asked for: {rule.statistic} of {rule.response} to ±{rule.half_width:g} at {100 * rule.confidence:g} %."
    found = None if store is None else store.read_json(plan.campaign_id, STOPPED)
    if found is None:
        return f"{asked} Not reached: all samples are computed."
    words = "".join(
        f" {found[key]:.5g}" if isinstance(found.get(key), float) else "" for key in ("value", "low", "high")
    )
    told = " to ".join(words.split()[1:])
    return f"{asked} Reached after {found['samples']} samples" + (f": {words.split()[0]} ({told})." if told else ".")


def _simulate(plan: Plan) -> str:
    """Return the command of a single run with the campaign's settings; the inputs are still to be set."""
    simulation = plan.spec.simulation
    words = ["clearcap", "simulate", plan.spec.mechanism]
    for option, value in (("--bench", plan.spec.bench), ("--step", simulation.step), ("--horizon", simulation.horizon)):
        words += [] if value is None else [option, str(value)]
    return shlex.join(words)


def _response(plan: Plan, name: str) -> ResponseSpec:
    asked = plan.spec.responses.get(name, Response())
    lsl, usl, target = asked.limits()
    title, unit = plan.mechanism.responses[name].title, plan.mechanism.response_units()[name]
    return ResponseSpec(name, title, unit, lsl, usl, target, asked.source)


def _variable(plan: Plan, name: str) -> VariableSpec:
    variable, key = plan.spec.variables[name], plan.spec.targets()[name]
    unit = unit_of(plan.mechanism, key)
    low, high = (None if abs(end) == float("inf") else end for end in variable.support())
    mean, std = variable.moments()
    x = np.linspace(*variable.ends(), _CDF_POINTS)
    cdf = tuple(zip(x.tolist(), variable.cdf(x).tolist(), strict=True))
    batch = variable.batch.size if isinstance(variable, Continuous) and variable.batch else 0
    density = variable.density_points()
    return VariableSpec(name, unit, variable.text(), low, high, mean, std, density, key, cdf, batch)
