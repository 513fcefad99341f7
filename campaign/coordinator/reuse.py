"""Reuse the rows of another campaign if a new one differs only in its number of samples or its limits.

A row depends on the variables, on what is simulated, and on the number of its sample. It does not depend on the number
of samples, the limits, or the name of the campaign.
"""

import json
import logging
from collections.abc import Iterator, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from campaign.errors import StoreError
from campaign.inputs.sampling import sampler_named
from campaign.plan import Plan
from campaign.store import Store
from campaign.store.files.files import LARGEST
from campaign.store.layout import PLAN
from campaign.store.repeat_sets import read_repeats, repeat_plans

logger = logging.getLogger(__name__)

# Keys that no row depends on.
IRRELEVANT = ("name", "title", "header", "samples", "responses", "stop", "repeats", "format")
# Statuses that do not depend on the machine.
DETERMINED = ("ok", "not_at_rest", "not_converged", "jammed", "diverged", "invalid")


def reuse_rows(store: Store, plan: Plan) -> int:
    """Copy rows of a new plan, and their repeats, from other campaigns of the store; return the number of rows.

    With a sampler whose first samples depend on the number of samples, nothing is reused, and a message says why.
    """
    reused = 0
    for other in _plans_with_same_rows(store, plan):
        if reason := sampler_named(plan.spec.sampler).not_extendable:
            logger.info("the rows of %s cannot be reused: %s", other.campaign_id, reason)
            return 0
        reused += _copy(store, other, plan)
        _copy_repeats(store, other, plan)
    return reused


def _plans_with_same_rows(store: Store, plan: Plan) -> Iterator[Plan]:
    """Yield the other plans of the store whose rows are also rows of this plan."""
    required = _what_rows_depend_on(json.loads(plan.to_json()))
    for campaign_id in store.campaigns():
        try:
            content = store.read_json(campaign_id, PLAN, LARGEST) or {}
            if campaign_id != plan.campaign_id and _what_rows_depend_on(content) == required:
                yield store.plan(campaign_id)
        except StoreError:
            continue  # the plan is damaged or of another version


def _what_rows_depend_on(content: Mapping[str, Any]) -> list[Any]:
    """Return everything in a plan's document that a row depends on, besides the number of its sample."""
    document = content.get("spec", {})
    spec = {key: value for key, value in document.items() if key not in IRRELEVANT}
    # of this table only further attempts change a row; the other keys say when to stop and what a verdict needs
    spec["failures"] = document.get("failures", {}).get("retry", [])
    order = list(document.get("variables", {}))  # of columns, and of the dimensions of a sampler
    return [spec, order, *(content.get(key) for key in ("row_build", "mechanism_digest"))]


def _copy(store: Store, other: Plan, plan: Plan) -> int:
    """Write the parts of a plan that the rows of another campaign fill completely; return the number of rows."""
    there = store.survey(plan).parts
    waiting = (batch for batch in range(len(plan.batches)) if batch not in there)
    batch, copied, kept = next(waiting, None), 0, plan.schema.empty_table()
    for rows in store.stream(other):
        kept = pa.concat_tables([kept, rows.replace_schema_metadata(plan.schema.metadata)])
        while batch is not None and kept.num_rows and sum(plan.batches[batch]) <= kept["sample"][-1].as_py() + 1:
            first, count = plan.batches[batch]
            part = kept.filter((pc.field("sample") >= first) & (pc.field("sample") < first + count))
            if part.num_rows == count and set(part["status"].to_pylist()) <= set(DETERMINED):
                store.write_part(plan, batch, part)
                copied += count
            kept = kept.filter(pc.field("sample") >= first + count)
            batch = next(waiting, None)
    return copied


def _copy_repeats(store: Store, other: Plan, plan: Plan) -> None:
    """Write the parts of a plan's repeats that the repeats of another campaign fill completely."""
    rows, sets = read_repeats(store, other), repeat_plans(store, plan)
    if rows is None or not sets:
        return
    usable = rows.filter(pc.field("status").isin(DETERMINED)).sort_by("sample")
    for repeats in sets:
        for batch in store.survey(repeats).missing:
            first, count = repeats.batches[batch]
            part = usable.filter(pc.field("sample").isin(repeats.numbers_of(first, first + count)))
            if part.num_rows == count:
                store.write_part(repeats, batch, part.replace_schema_metadata(repeats.schema.metadata))
