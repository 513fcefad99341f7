"""From a plan and its rows to the report: says to reporting, in plain data, what the columns mean."""

import platform
import shlex
import tempfile
from pathlib import Path

import pyarrow as pa

from campaign.errors import CampaignError
from campaign.plan import Plan
from campaign.spec import Response
from campaign.store import Store
from campaign.version import clearcap_version
from reporting import ReportError, ReportSpec, ResponseSpec, VariableSpec, write_report


def report(store: Store, plan: Plan, table: pa.Table) -> dict[str, str]:
    """Write the report of a campaign into its folder of the store.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    plan : Plan
        The campaign.
    table : pyarrow.Table
        Its rows.

    Returns
    -------
    dict of str to str
        Path or URL of each file by kind: ``html``, ``json``.

    Raises
    ------
    CampaignError
        If there is nothing to report on.
    """
    try:
        return _write(store, plan, table)
    except ReportError as error:
        raise CampaignError(f"report of {plan.campaign_id}: {error}") from error


def _write(store: Store, plan: Plan, table: pa.Table) -> dict[str, str]:
    """Write the report next to the parts; behind a URL, upload it."""
    folder = f"{plan.campaign_id}/report"
    spec = report_spec(plan)
    if store.files.local:
        return write_report(table, spec, Path(store.files.path(folder)))
    with tempfile.TemporaryDirectory(prefix="clearcap-report-") as temporary:
        written = write_report(table, spec, Path(temporary))
        names = {kind: f"{folder}/{Path(path).name}" for kind, path in written.items()}
        for kind, path in written.items():
            store.files.write(names[kind], Path(path).read_bytes())
    return {kind: store.files.fs.unstrip_protocol(store.files.path(name)) for kind, name in names.items()}


def report_spec(plan: Plan) -> ReportSpec:
    """Return what reporting must know of a plan."""
    spec = plan.spec
    return ReportSpec(
        title=spec.title or spec.name,
        campaign=plan.campaign_id,
        header=dict(spec.header),
        responses=tuple(_response(plan, name) for name in plan.mechanism.responses),
        variables=tuple(_variable(plan, name) for name in spec.variables),
        provenance=provenance(plan),
        requested=spec.samples,
        simulate=_simulate(plan),
        sampler=spec.sampler,
    )


def provenance(plan: Plan) -> dict[str, str]:
    """Return what is needed to get the same rows again."""
    spec = plan.spec
    simulation = plan.mechanism.simulation
    unit = plan.mechanism.unit_of("simulation.step")
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
    }


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
    unit = plan.mechanism.unit_of(key)
    low, high = (None if abs(end) == float("inf") else end for end in variable.support())
    mean, std = variable.moments()
    return VariableSpec(name, unit, variable.text(), low, high, mean, std, variable.density_points(), key)
