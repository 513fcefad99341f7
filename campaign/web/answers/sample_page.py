"""A page of the samples of a campaign, sorted by margin or by number, as a worker process computes it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.reports.samples import limits_of
from campaign.run_status import FailedStatus
from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from campaign.web.answers.questions import AskedRows
from engine.arrays import Array

SORTS = ("margin", "sample")
OK, FAILED = "ok", "failed"
STATUSES = (OK, FAILED, *FailedStatus)  # "failed" stands for all that are not ok


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
