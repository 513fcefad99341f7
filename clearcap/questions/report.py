"""Write the report from a plan and its rows: pass the meaning of the columns to `reporting` as plain data."""

import logging
import os
import platform
import shlex
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from datetime import UTC, datetime
from itertools import chain
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pydantic import BaseModel

from campaign.coordinator.requests import refuse_signed, unsigned
from campaign.errors import CampaignError, SpecError, unwritable
from campaign.inputs.distributions import Continuous
from campaign.inputs.distributions.bounded import Position
from campaign.inputs.sampling import production_batch, sampler_named
from campaign.inputs.sampling.sampler import joint_variables
from campaign.plan import Plan, resolution
from campaign.row_build import clearcap_version, differences
from campaign.samples import limits_of
from campaign.spec.campaign_file import CampaignSpec, Response
from campaign.store import Store, open_store
from campaign.store.files.files import TEMPORARY
from campaign.store.files.retry_policy import QUICK
from campaign.store.layout import STATE, STOPPED, SUBMISSION
from campaign.store.store import read_repeats, repeat_plans, repeated_shares, report_folder, survey_repeats
from campaign.worker.messages import plain_rows
from clearcap.pictures.sketch import sketch_mechanism
from clearcap.questions.fixed_assumptions import fixed_assumptions
from clearcap.questions.mechanisms import geometry_provenance
from clearcap.questions.plan_differences import plan_differences
from clearcap.questions.report_source import decided_by, report_source, sha256, stated_date, stated_source
from clearcap.questions.tolerances import Spreads
from clearcap.questions.whatif import check_drawn
from engine import Mechanism, MechanismError
from engine.mechanism import unit_of
from engine.mechanism.keys.values import set_values
from reporting import Design, ReportError, ReportSpec, ResponseSpec, VariableSpec, capability, write_report
from reporting.analysis import Analysis, Decision, OtherSpreads, analyse, compare_rows
from reporting.arrays import centred_ranks
from reporting.capability.verdict import CAPABLE
from reporting.comparison import Comparison
from reporting.samples import AMBIGUOUS, AT_IMPACT, LATER, Repeats, leveled, read_samples
from reporting.samples import read_repeats as checked
from reporting.spec import MechanismDrawing, ProposalPart
from reporting.tolerance.advice import ToleranceAdvice
from reporting.write import NAMES, USUAL

logger = logging.getLogger(__name__)
ASKED, MOST = 0.1, 1.0  # shares
BUILD_DATE = "SOURCE_DATE_EPOCH"  # reproducible-builds.org/docs/source-date-epoch
_LATEST = 32_503_680_000.0  # s since 1970: the year 3000
BATCH = "production batch"
_CDF_POINTS = 401
_OFF_DRAWING = "deviation.off", "deviation.tilt", "lobes.height"  # ends of keys
COMMAND = "command of this report"
_CERTIFICATE = ("sample", "status", "message", "wall_s", "max_residual", "max_penetration", "settled")


def report(store: Store, plan: Plan, *, kinds: Collection[str] = USUAL, against: str | None = None) -> dict[str, str]:
    """Write the report of a campaign, or its comparison with another one, into a folder of its own in the store.

    The result is the path or URL of each file by kind, one of `reporting.write.NAMES`. Raises CampaignError if there is
    nothing to report on, or the campaign is signed.
    """
    other = None if against is None else store.find(against)
    if other is None:
        refuse_signed(store, plan.campaign_id)  # before a minute of work
    folder = report_folder(plan.campaign_id, other)
    with tempfile.TemporaryDirectory(prefix="clearcap-report-") as temporary:
        written = write_into(Path(temporary), store, plan, kinds, against)
        # not while it is being signed: what was looked at is what is signed
        with nullcontext() if other is not None else unsigned(store, plan.campaign_id):
            return put_report(store, folder, written)


def put_report(store: Store, folder: str, written: Mapping[str, str]) -> dict[str, str]:
    """Copy the files of a report into a folder of the store; return the path or URL of each by kind."""
    names = {kind: f"{folder}/{Path(path).name}" for kind, path in written.items()}
    for kind, path in written.items():
        store.files.write(names[kind], Path(path).read_bytes())
    return {kind: store.files.address(name) for kind, name in names.items()}


@contextmanager
def refusals_of(campaign: str, what: str = "report") -> Iterator[None]:
    """Turn a ReportError into the CampaignError of a campaign, or the error of a place that cannot be written."""
    try:
        yield
    except ReportError as error:
        message = f"{what} of {campaign}: {error}"
        raise (unwritable(message, error.__cause__) if error.__cause__ else CampaignError(message)) from error


def write_into(
    folder: Path,
    store: Store,
    plan: Plan,
    kinds: Collection[str],
    against: str | None = None,
    written: str | None = None,
) -> dict[str, str]:
    """Write the files of a report into a folder, and return their paths by kind; raises what `report` raises."""
    other = None if against is None else store.plan(store.find(against))
    if other is not None and other.campaign_id == plan.campaign_id:
        raise SpecError(f"--against {against}: is the campaign itself; name another one, see: {store.command('list')}")
    comparison = None if other is None else (report_rows(store, other), report_spec(other, store))
    spec = report_spec(plan, store)
    spec = replace(spec, written=written or spec.written)
    if other is not None:
        command = f"{spec.provenance[COMMAND]} --against {other.campaign_id}"
        spec = replace(spec, provenance={**spec.provenance, COMMAND: command})
    with refusals_of(plan.campaign_id):
        more = _beside_rows(store, plan)
        return write_report(report_rows(store, plan), spec, folder, kinds=kinds, against=comparison, **more)


def written_report(
    store: str, campaign: str, against: str | None = None, kinds: Collection[str] = USUAL
) -> dict[str, str]:
    """Write a report as `report` does, as a job, which gets the address of the store."""
    opened = open_store(store, QUICK)
    return report(opened, opened.plan(campaign), kinds=kinds, against=against)


def report_written_again(store: str, campaign: str) -> dict[str, Any]:
    """Write the report of a campaign again, to compare, as a job: the SHA-256 of its files, and what it was made of."""
    opened = open_store(store, QUICK)
    files = report_again(opened, opened.plan(campaign))
    digests = {name: sha256(content) for name, content in files.items()}
    return {"source": stated_source(files[NAMES["json"]]), "files": digests}


def report_again(store: Store, plan: Plan) -> dict[str, bytes]:
    """Return the files of a campaign's report, written again from the rows with the date that it states.

    On the same machine, from the same rows and by the same version they are those of the store to the byte, unless
    somebody changed one. Raises CampaignError if there is no report, a file of it cannot be written here, or its folder
    holds anything else.
    """
    folder, kinds = report_folder(plan.campaign_id), {name: kind for kind, name in NAMES.items()}
    names = sorted(name for name in store.files.names(folder) if not name.endswith(TEMPORARY))
    if NAMES["json"] not in names:
        raise CampaignError(f"{plan.campaign_id} has no report; write it first: an approver signs what it says")
    if unknown := [name for name in names if name not in kinds]:
        raise CampaignError(f"{folder}/{unknown[0]:.100}: is not a file of a report; remove it from the store")
    date = stated_date(store.files.read(f"{folder}/{NAMES['json']}"))
    with tempfile.TemporaryDirectory(prefix="clearcap-report-") as temporary:
        write_into(Path(temporary), store, plan, [kinds[name] for name in names], written=date)
        written = {path.name: path.read_bytes() for path in Path(temporary).iterdir()}
    if missing := [name for name in names if name not in written]:
        raise CampaignError(f"{folder}/{missing[0]}: cannot be written here, for its package is missing; remove it")
    return {name: written[name] for name in names}


def analysis(store: Store, plan: Plan) -> Analysis:
    """Return the content of a campaign's report as data; raise CampaignError if there is nothing to report on."""
    spec = report_spec(plan, store)
    with refusals_of(plan.campaign_id, "analysis"):
        return analyse(read_samples(report_rows(store, plan), spec), spec, **_beside_rows(store, plan))


def advice_of(store: Store, plan: Plan) -> ToleranceAdvice:
    """Return the report's advice: which spreads must shrink for required indices, and which may grow.

    Raises CampaignError if no response has limits, or there is nothing to report on.
    """
    check_drawn(plan.spec)
    if all(pair == (None, None) for pair in limits_of(plan).values()):
        raise CampaignError(f"advice of {plan.campaign_id}: no response has limits; give limits to at least one")
    found = analysis(store, plan)
    return ToleranceAdvice(found.kept, found.kept_at, found.advice, found.shortfalls, found.advice_note)


def _beside_rows(store: Store, plan: Plan) -> dict[str, Any]:
    """Return how spreads change rows, the repeats, and the complete campaigns that decide what samples leave open."""
    return {"spreads": other_spreads(plan), "repeats": repeats_of(store, plan), "decided": decisions(store, plan)}


def other_spreads(plan: Plan) -> OtherSpreads:
    """Return what the samples of a campaign become at other spreads of its variables."""
    spreads = Spreads(plan.spec, plan.mechanism)
    return OtherSpreads(spreads.change, spreads.drawn)


def decisions(store: Store, plan: Plan) -> tuple[Decision, ...]:
    """Return the complete campaigns that decide what the samples of one leave open."""
    return tuple(
        Decision(report_rows(store, decides), report_spec(decides, store), names)
        for decides, names in decided_by(store, plan)
        if not store.survey(decides).missing
    )


class BriefIndices(BaseModel):
    """What a line says of a response: without intervals, which take the whole analysis."""

    response: str
    unit: str
    lsl: float | None
    usl: float | None
    mean: float | None
    std: float | None
    cpk: float | None
    ppm: float | None  # share of rejects
    is_weighted: bool  # the share, by the weights of importance sampling


def brief_indices(store: Store, plan: Plan) -> list[BriefIndices]:
    """Return mean, sigma, Cpk and share of rejects of each response, from one pass over the rows."""
    sampler, units = sampler_named(plan.spec.sampler), plan.mechanism.response_units()
    columns = [*plan.mechanism.responses, *sampler.columns]
    rows = pa.concat_tables([plan.schema.empty_table().select(columns), *store.stream(plan, columns)])
    plain, found = plain_rows(rows), []
    for name in plan.mechanism.responses:
        lsl, usl, target = plan.spec.responses.get(name, Response()).limits()
        values = leveled(plain[name].drop_null().to_numpy(), *resolution(plan.mechanism, name))
        c = capability(values, lsl=lsl, usl=usl, target=target, ordered=False)
        ppm, is_weighted = c.ppm_observed, "log_weight" in columns and c.ppm_observed is not None
        if is_weighted:
            y, weights = rows[name].to_numpy(), np.exp(rows["log_weight"].to_numpy())
            rejects = (y < (-np.inf if lsl is None else lsl)) | (y > (np.inf if usl is None else usl))
            ppm = float(1e6 * np.sum(weights[rejects]) / rows.num_rows)
        ends = {"lsl": lsl, "usl": usl, "mean": c.mean, "std": c.std, "cpk": c.cpk}
        found.append(BriefIndices(response=name, unit=units[name], **ends, ppm=ppm, is_weighted=is_weighted))
    return found


def comparison(mine: tuple[Store, Plan], other: tuple[Store, Plan]) -> Comparison:
    """Return the comparison of a campaign with another one, which may be in another store."""
    here, there = ((report_rows(store, plan), report_spec(plan, store)) for store, plan in (mine, other))
    with refusals_of(f"{mine[1].campaign_id} with {other[1].campaign_id}", "comparison"):
        return compare_rows(*here, *there)


def comparison_document(store: Store, plan: Plan, other: Plan) -> dict[str, Any]:
    """Return what differs in the plans of two campaigns, and their comparison as in ``capability.json``."""
    compared = asdict(comparison((store, plan), (store, other)))
    differs = [asdict(each) for each in plan_differences(store, plan.campaign_id, store, other.campaign_id)]
    return {"campaign": plan.campaign_id, "store": store.url, "differs": differs, "comparison": compared}


def report_rows(store: Store, plan: Plan) -> Iterator[pa.Table]:
    """Yield an empty table, then the columns that a report reads, with the number of the production batch, if any."""
    columns = [*_CERTIFICATE, *plan.spec.variables, *plan.mechanism.responses]
    columns += [name for name in LATER if name in plan.schema.names]
    columns += sampler_named(plan.spec.sampler).columns
    columns += [name for name in (AT_IMPACT, AMBIGUOUS) if name in plan.schema.names]
    tables = chain([plan.schema.empty_table().select(columns)], store.stream(plan, columns))
    for table in tables:
        batch = production_batch(plan.spec, table["sample"].to_numpy())
        yield table if batch is None else table.append_column(BATCH, pa.array(batch))


def report_spec(plan: Plan, store: Store | None = None) -> ReportSpec:
    """Return the data about a campaign that `reporting` needs; without its store all its samples count as requested."""
    spec, sampler = plan.spec, sampler_named(plan.spec.sampler)
    place = [] if store is None else store.files.option
    drawing, note = mechanism_drawing(plan)
    components = spec.importance.components if spec.importance else ()
    return ReportSpec(
        title=spec.title or spec.name,
        campaign=plan.campaign_id,
        header=dict(spec.header),
        responses=tuple(_response(plan, name) for name in plan.mechanism.responses),
        variables=tuple(_variable(plan, name) for name in spec.variables),
        provenance=provenance(plan, place) | ({} if store is None else report_source(store, plan)),
        requested=spec.samples if store is None else store.end(plan),
        simulate=_simulate_command(plan),
        sampler=spec.sampler,
        replay=shlex.join(["clearcap", "replay", *place, plan.campaign_id]),
        correlations=(*(spec.correlations or ()), *_joint_correlations(spec)),
        production_batch_column="" if production_batch(spec, np.zeros(1, np.int64)) is None else BATCH,
        stop=stopping_rule(plan, store),
        design=Design(sampler.production, sampler.report),
        ordered=False,
        corners=sampler.corners,
        designed=sampler.designed(spec),
        proposal=tuple(
            ProposalPart(c.share, c.scale, tuple((v, z) for v, z in c.shift.items() if z), c.source) for c in components
        ),
        min_ok=spec.failures.min_ok,
        max_not_assemblable=spec.failures.max_not_assemblable,
        author=author(plan, store),
        ended=campaign_end(plan, store),
        written=report_date(),
        assumptions=fixed_assumptions(plan),
        drawing=drawing,
        drawing_note=note,
    )


def _joint_correlations(spec: CampaignSpec) -> Iterator[tuple[str, str, float]]:
    """Yield the rank correlations of variables that share the rows of a table."""
    for names in joint_variables(spec.variables).values():
        columns = [np.array(getattr(spec.variables[name], "values", None)) for name in names]
        ranks = np.atleast_2d(np.corrcoef([centred_ranks(column) for column in columns]))
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            yield names[i], names[j], float(np.nan_to_num(ranks[i, j]))


def provenance(plan: Plan, place: Iterable[str] = ()) -> dict[str, str]:
    """Return the data needed to reproduce the rows of a campaign; `place` names the store, as on the command line."""
    spec, simulation = plan.spec, plan.mechanism.simulation
    unit = unit_of(plan.mechanism, "simulation.step")
    return {
        "campaign": plan.campaign_id,
        "mechanism": spec.mechanism,
        "mechanism digest": plan.mechanism.digest(),
        **geometry_provenance(plan.mechanism.geometry),
        "samples": str(spec.samples),
        "sampler": spec.sampler,
        "seed": str(spec.seed),
        "step": f"{spec.simulation.step or simulation.step:g} {unit}",
        "horizon": f"{spec.simulation.horizon or simulation.horizon:g} {unit}",
        "engine build": plan.engine_build,
        "build of the rows": plan.row_build or "not recorded",
        "clearcap": clearcap_version(),
        "python": platform.python_version(),
        "report written on": f"{platform.node()}, {platform.machine()}, {platform.system()}",
        COMMAND: shlex.join(["clearcap", "report", plan.campaign_id, *place]),
    }


def stopping_rule(plan: Plan, store: Store | None) -> str:
    """Return what a stopping rule asked for, and whether it was reached; empty without one."""
    rule = plan.spec.stop
    if rule is None:
        return ""
    request = f"Asked for: {rule.statistic} of {rule.response} to ±{rule.half_width:g} at {100 * rule.confidence:g} %."
    verdict = None if store is None else store.read_json(plan.campaign_id, STOPPED)
    if verdict is None:
        return f"{request} Not reached: all samples are computed."
    value, *interval = (
        f"{verdict[key]:.5g}" if isinstance(verdict.get(key), float) else "" for key in ("value", "low", "high")
    )
    result = f": {value} ({' to '.join(interval)})." if all(interval) else "."
    return f"{request} Reached after {verdict['samples']} samples{result}"


def _simulate_command(plan: Plan) -> str:
    simulation = plan.spec.simulation
    words = ["clearcap", "simulate", plan.spec.mechanism]
    options = {"--bench": plan.spec.bench, "--preset": plan.spec.preset}
    for option, value in (options | {"--step": simulation.step, "--horizon": simulation.horizon}).items():
        words += [] if value is None else [option, str(value)]
    return shlex.join(words)


def _response(plan: Plan, name: str) -> ResponseSpec:
    response = plan.spec.responses.get(name, Response())
    lsl, usl, target = response.limits()
    title, unit = plan.mechanism.responses[name].title, plan.mechanism.response_units()[name]
    return ResponseSpec(
        *(name, title, unit, lsl, usl, target, response.source),
        *resolution(plan.mechanism, name),
        requirement=plan.spec.requirement(name) or CAPABLE,
        characteristic_class=plan.spec.requirement_class(name),
        index=response.index or "share",
        boundary=response.boundary or "",
        historical=None if response.historical is None else (response.historical.mean, response.historical.sigma),
    )


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


def author(plan: Plan, store: Store | None) -> str:
    """Return the person responsible for a campaign: its author, else the author in its header, else the submitter."""
    if plan.spec.author is not None:
        return plan.spec.author
    named = next((text for name, text in plan.spec.header.items() if name.strip().lower() == "author"), "")
    submission = None if named or store is None else store.read_json(plan.campaign_id, SUBMISSION)
    user = (submission or {}).get("user")
    return named or (user if isinstance(user, str) else "")


def campaign_end(plan: Plan, store: Store | None) -> str:
    """Return when a campaign was completed; empty if it is not complete, or its store has no date."""
    state = None if store is None else store.read_json(plan.campaign_id, STATE)
    since = (state or {}).get("since")
    if (state or {}).get("state") != "completed" or isinstance(since, bool) or not isinstance(since, int | float):
        return ""
    return _in_utc(since) if 0.0 <= since < _LATEST else ""


def report_date() -> str:
    """Return the current time, or that of SOURCE_DATE_EPOCH, with which a report can be reproduced bit for bit."""
    given = os.environ.get(BUILD_DATE)
    if given is None:
        return _in_utc(time.time())
    if not (given.isascii() and given.isdigit() and int(given) < _LATEST):
        raise SpecError(f"{BUILD_DATE} = {given!r:.40}: not a date; allowed: whole seconds since 1970, or unset it")
    return _in_utc(int(given))


def _in_utc(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M UTC")


def repeats_of(store: Store, plan: Plan) -> Repeats:
    """Return the stored repeats of a campaign, and advice on how to get more."""
    responses = tuple(plan.mechanism.responses)
    survey = survey_repeats(store, repeat_plans(store, plan))
    table, remedy = read_repeats(store, plan, ["sample", "status", *responses]), ""
    if differences(plan.row_build):
        remedy = "Repeats need the build of clearcap that planned the campaign; a new clearcap run plans it again."
    elif survey.missing:
        remedy = f"To compute the missing ones: {store.command('resume', plan.campaign_id)}."
    elif (share := repeated_shares(store, plan)[-1]) < MOST:
        more = f"{min(max(2 * share, ASKED), MOST):g}"
        command = store.command("repeat", plan.campaign_id, "--share", more)
        remedy = f"To repeat {'more' if share else 'some'}: {command}"
    return checked(table, responses, survey.planned, remedy)


def mechanism_drawing(plan: Plan) -> tuple[MechanismDrawing | None, str]:
    """Return the drawing of a mechanism, or None and why there is none: a report is written without it."""
    try:
        return sketch_mechanism(plan.mechanism, widest(plan.mechanism, plan.spec)), ""
    except Exception as error:  # anything: a mechanism from an earlier version, a failing compiler
        logger.warning("report of %s: the mechanism could not be drawn: %r", plan.campaign_id, error)
        return None, f"The mechanism could not be drawn ({type(error).__name__}: {str(error)[:200]})."


def widest(mechanism: Mechanism, spec: CampaignSpec) -> Mechanism:
    """Return a mechanism with the largest distances, tilts and lobes that its campaign draws, each at its bound."""
    targets, ends = spec.targets(), dict[str, float]()
    for name, variable in spec.variables.items():
        is_zone = isinstance(variable, Position) or targets[name].endswith(_OFF_DRAWING)
        high = variable.cut()[1] if is_zone and isinstance(variable, Continuous) else inf
        if isfinite(high):
            ends[targets[name]] = high
    try:
        return set_values(mechanism, ends)
    except MechanismError:  # together they may be refused
        return mechanism
