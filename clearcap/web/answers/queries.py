"""Questions about the samples of a campaign, as a worker process answers them, with plain data in and out.

A worker keeps the plans and mapped columns of the campaigns that were used last, so that a question takes only as long
as its arithmetic.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.errors import CampaignError, SpecError
from campaign.plan import Plan
from campaign.run_status import FailedStatus
from campaign.samples import SampleColumns, limits_of
from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.cost_file import costs_of
from clearcap.questions.tolerances import advice_document, advice_from, cheapest_from
from clearcap.questions.whatif import change_of, what_if_document, what_if_from
from clearcap.web.answers.column_cache import ColumnCache
from engine.arrays import Array
from engine.platform.toml_file import UnfitToml, parse_toml
from reporting import ReportError, capability
from reporting.shape.histogram import histogram
from reporting.tolerance.reweighting import Weights, weights

PREVIEW_ROWS = 100_000  # these rows give the Cpk of a million rows to within 0.001
KEPT_CAMPAIGNS = 8  # plans and mapped columns that a worker keeps
SORTS = ("margin", "sample")
OK, FAILED = "ok", "failed"
STATUSES = (OK, FAILED, *FailedStatus)  # "failed" stands for all that are not ok


@dataclass(frozen=True)
class AskedRows:
    """The rows that a question is about."""

    store: str  # path or URL, including what is needed for access
    campaign: str
    version: str  # see `clearcap.web.answers.query_service`
    folder: str  # of the cache of columns
    at_most: int  # size of that cache [bytes]


@dataclass(frozen=True)
class _Opened:
    """A campaign that a worker has opened: the URL of its store, its plan and its columns."""

    url: str
    plan: Plan
    columns: SampleColumns


@lru_cache(maxsize=KEPT_CAMPAIGNS)
def _opened(rows: AskedRows) -> _Opened:
    """Return a campaign with its columns; each version of its rows has its own cache entry."""
    store = open_store(rows.store, QUICK)
    plan = store.plan(rows.campaign)
    return _Opened(store.url, plan, ColumnCache(Path(rows.folder), rows.at_most).columns(store, plan, rows.version))


def what_if_answer(rows: AskedRows, settings: tuple[str, ...], preview: bool) -> dict[str, Any]:
    """Return the document of ``clearcap whatif --json``; see `query_service.QueryService.what_if`."""
    opened = _opened(rows)
    columns, mark = _asked(opened.columns, preview)
    answers = what_if_from(opened.plan, columns, settings)
    return what_if_document(opened.plan, opened.url, settings, answers) | mark


def histogram_answer(rows: AskedRows, response: str, settings: tuple[str, ...], preview: bool) -> dict[str, Any]:
    """Return the bins of a response, as sampled and under changed distributions.

    Keys: ``response``, ``unit``, ``lsl``, ``usl``, ``edges`` (k + 1), ``before`` (k counts of samples), ``after`` (k
    weighted counts; null without settings, or if no weights are possible, for the reason in ``refusal``), and ``mean``,
    ``std`` and ``cpk`` without weights. ``before`` and ``after`` both add up to the number of samples with a value.
    """
    opened = _opened(rows)
    plan, (columns, mark) = opened.plan, _asked(opened.columns, preview)
    if response not in plan.mechanism.responses:
        allowed = ", ".join(plan.mechanism.responses)
        raise SpecError(f"response {response}: campaign {plan.campaign_id} has no such response; allowed: {allowed}")
    bins = _bins(plan, columns, response, _weights(plan, columns, settings))
    return {"campaign": plan.campaign_id, "set": list(settings), **bins} | mark


def histograms_answer(rows: AskedRows, settings: tuple[str, ...], preview: bool) -> dict[str, Any]:
    """Return ``campaign``, ``set`` and ``histograms``, the bins of each response; see `histogram_answer`."""
    opened = _opened(rows)
    plan, (columns, mark) = opened.plan, _asked(opened.columns, preview)
    found = _weights(plan, columns, settings)
    bins = [_bins(plan, columns, name, found) for name in plan.mechanism.responses]
    return {"campaign": plan.campaign_id, "set": list(settings), "histograms": bins} | mark


def _weights(plan: Plan, columns: SampleColumns, settings: tuple[str, ...]) -> Weights | None:
    """Return the weights of the samples under settings; None without settings."""
    if not settings:
        return None
    try:
        return weights(change_of(plan, columns, settings))
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error


def _bins(plan: Plan, columns: SampleColumns, response: str, found: Weights | None) -> dict[str, Any]:
    """Return the bins of a response with and without weights."""
    values, limits = columns.values[response], limits_of(plan)[response]
    finite = np.isfinite(values)
    bins, now = histogram(values[finite], *limits), capability(values, *limits, ordered=False)
    after = None
    if bins and found and not found.refusal:
        weight = found.weight[finite]
        weighted, _ = np.histogram(values[finite], np.array(bins.edges), weights=weight * (weight.size / weight.sum()))
        after = weighted.tolist()
    return {
        "response": response,
        "unit": plan.mechanism.response_units()[response],
        "lsl": limits[0],
        "usl": limits[1],
        "mean": now.mean,
        "std": now.std,
        "cpk": now.cpk,
        "edges": bins.edges if bins else [],
        "before": bins.counts if bins else [],
        "after": after,
        "refusal": found.refusal if found and bins else "",
    }


def advice_answer(rows: AskedRows) -> dict[str, Any]:
    """Return the document of ``clearcap advise --json``."""
    opened = _opened(rows)
    advised = advice_document(advice_from(opened.plan, opened.columns))
    return {"campaign": opened.plan.campaign_id, "store": opened.url, **advised}


def allocation_answer(rows: AskedRows, costs: Mapping[str, Any] | str) -> dict[str, Any]:
    """Return the document of ``clearcap advise --cost FILE --json`` for the text or the tables of a cost file."""
    opened = _opened(rows)
    try:
        tables = parse_toml(costs.encode("utf-8", "surrogateescape")) if isinstance(costs, str) else costs
    except UnfitToml as error:
        raise SpecError(f"costs: {error}") from error
    found = cheapest_from(opened.plan, opened.columns, costs_of(tables, opened.plan, "costs:"))
    return {"campaign": opened.plan.campaign_id, "store": opened.url, "allocation": asdict(found)}


def comparison_answer(rows: AskedRows, other: AskedRows) -> dict[str, Any]:
    """Return the comparison of two campaigns; see `clearcap.questions.report`."""
    from clearcap.questions.report import comparison_document  # loads packages that only reports need

    if rows.campaign == other.campaign:
        raise SpecError(f"{other.campaign}: is the campaign itself; name another one to compare with")
    store = open_store(rows.store, QUICK)
    return comparison_document(store, store.plan(rows.campaign), store.plan(other.campaign))


def _asked(columns: SampleColumns, preview: bool) -> tuple[SampleColumns, dict[str, Any]]:
    """Return the samples that a question uses, and the ``preview`` entry of its document if these are not all."""
    total = columns.number.size
    if not preview or total <= PREVIEW_ROWS:
        return columns, {}
    return columns.first(PREVIEW_ROWS), {"preview": {"rows": PREVIEW_ROWS, "of": total}}


def samples_answer(rows: AskedRows, sort: str, status: str | None, cursor: int, count: int) -> dict[str, Any]:
    """Return `count` samples of a campaign after the first `cursor`, of one of `STATUSES` or, for None, of all.

    `sort` is ``margin``, smallest first and samples without a margin last, or ``sample``, by number. The margin is the
    smallest distance of a response from its limit, in standard deviations of that response over the samples, negative
    outside the limits; ``nearest`` is that response. Without a response that has a limit and a value they are NaN (null
    as JSON) and None. ``next`` is the cursor of the next page or None.
    """
    _check(sort, status)
    store = open_store(rows.store, QUICK)
    plan = store.plan(rows.campaign)
    table = pa.concat_tables(store.stream(plan, ["sample", "status", "message", *plan.mechanism.responses]))
    margin, nearest = _margins(plan, {name: table[name].to_numpy() for name in plan.mechanism.responses})
    wanted = np.flatnonzero(_having(table, status))
    if sort == "margin":
        wanted = wanted[np.argsort(margin[wanted], kind="stable")]  # NaN comes last
    chosen = wanted[cursor : cursor + count]
    shown = table.take(pa.array(chosen)).to_pylist()
    names = plan.mechanism.responses
    samples = [
        {
            **{key: row[key] for key in ("sample", "status", "message")},
            "responses": {name: row[name] for name in names},
            "margin": float(margin[at]),
            "nearest": list(names)[nearest[at]] if np.isfinite(margin[at]) else None,
        }
        for at, row in zip(chosen, shown, strict=True)
    ]
    following = cursor + count
    return {"samples": samples, "total": int(wanted.size), "next": following if following < wanted.size else None}


def _check(sort: str, status: str | None) -> None:
    """Raise SpecError for an unknown sort order or status."""
    if sort not in SORTS:
        raise SpecError(f"sort = {sort!r:.40}; allowed: {', '.join(SORTS)}")
    if status is not None and status not in STATUSES:
        raise SpecError(f"status = {status!r:.40}; allowed: {', '.join(STATUSES)}")


def _having(table: pa.Table, status: str | None) -> Any:
    """Return a boolean mask of the rows with a status, shape (n,)."""
    if status is None:
        return np.ones(table.num_rows, bool)
    found = table["status"].to_numpy() == (OK if status == FAILED else status)
    return ~found if status == FAILED else found


def _margins(plan: Plan, values: Mapping[str, Array]) -> tuple[Array, Any]:
    """Return the smallest distance of each sample from a limit [sigmas], and the index of the response, both (n,)."""
    distances = []
    for name, (lsl, usl) in limits_of(plan).items():
        x = values[name]
        finite = x[np.isfinite(x)]
        sigma = float(finite.std(ddof=1)) if finite.size > 1 else 0.0
        below = np.full(x.size, np.inf) if lsl is None else x - lsl
        above = np.full(x.size, np.inf) if usl is None else usl - x
        least = np.minimum(below, above)
        distances.append(np.where(np.isfinite(least), least / sigma, np.inf) if sigma > 0 else np.full(x.size, np.inf))
    stacked = np.array(distances)
    least = stacked.min(axis=0)
    return np.where(np.isfinite(least), least, np.nan), stacked.argmin(axis=0)
