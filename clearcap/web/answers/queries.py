"""Questions about the samples of a campaign, as a worker process answers them, with plain data in and out.

A worker keeps the plans and mapped columns of the campaigns that were used last, so that a question takes only as long
as its arithmetic.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.samples import SampleColumns
from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.samples import list_samples
from clearcap.questions.tolerances import advice_document, advice_from, allocation_document, cheapest_from, costs_of
from clearcap.questions.whatif import histograms, what_if_document, what_if_from
from clearcap.web.answers.column_cache import ColumnCache
from engine.platform.toml_file import UnfitToml, parse_toml

PREVIEW_ROWS = 100_000  # these rows give the Cpk of a million rows to within 0.001
KEPT_CAMPAIGNS = 8  # plans and mapped columns that a worker keeps


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
    """Return ``campaign``, ``set`` and the `Bins` of a response."""
    opened = _opened(rows)
    columns, mark = _asked(opened.columns, preview)
    (bins,) = histograms(opened.plan, columns, settings, [response])
    return {"campaign": opened.plan.campaign_id, "set": list(settings), **bins.model_dump()} | mark


def histograms_answer(rows: AskedRows, settings: tuple[str, ...], preview: bool) -> dict[str, Any]:
    """Return ``campaign``, ``set`` and ``histograms``, the `Bins` of each response."""
    opened = _opened(rows)
    columns, mark = _asked(opened.columns, preview)
    bins = histograms(opened.plan, columns, settings, opened.plan.mechanism.responses)
    return (
        {"campaign": opened.plan.campaign_id, "set": list(settings)}
        | {"histograms": [each.model_dump() for each in bins]}
        | mark
    )


def advice_answer(rows: AskedRows) -> dict[str, Any]:
    """Return the document of ``clearcap advise --json``."""
    opened = _opened(rows)
    return advice_document(opened.plan, opened.url, advice_from(opened.plan, opened.columns))


def allocation_answer(rows: AskedRows, costs: Mapping[str, Any] | str) -> dict[str, Any]:
    """Return the document of ``clearcap advise --cost FILE --json`` for the text or the tables of a cost file."""
    opened = _opened(rows)
    try:
        tables = parse_toml(costs.encode("utf-8", "surrogateescape")) if isinstance(costs, str) else costs
    except UnfitToml as error:
        raise SpecError(f"costs: {error}") from error
    found = cheapest_from(opened.plan, opened.columns, costs_of(tables, opened.plan, "costs:"))
    return allocation_document(opened.plan, opened.url, found)


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
    """Return a page of the samples."""
    store = open_store(rows.store, QUICK)
    return list_samples(store, store.plan(rows.campaign), sort, status, cursor, count).model_dump()
