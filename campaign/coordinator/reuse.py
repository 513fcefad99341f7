"""More samples of a campaign that is there: its rows are taken over, not computed again.

A row is a function of what is varied and simulated, and of its number; not of how many rows there are, what their
limits are, or what the campaign is called.
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
from campaign.store.layout import PLAN

logger = logging.getLogger(__name__)

DOES_NOT_MATTER = ("name", "title", "header", "samples", "responses", "stop", "format")  # to a row
DETERMINED = ("ok", "not_converged", "diverged", "invalid")  # statuses that any machine would come to


def reuse_rows(store: Store, plan: Plan) -> int:
    """Write those parts of a new plan whose rows another campaign of the store has; return how many rows.

    Where the sampler's first samples are others when there are more of them, nothing is taken over, and it is said why.
    """
    taken = 0
    for other in _akin(store, plan):
        if reason := sampler_named(plan.spec.sampler).not_extendable:
            logger.info("the rows of %s cannot be taken over: %s", other.campaign_id, reason)
            return 0
        taken += _copy(store, other, plan)
    return taken


def _akin(store: Store, plan: Plan) -> Iterator[Plan]:
    """Yield the plans whose rows are rows of this one."""
    wanted = _what_rows_depend_on(json.loads(plan.to_json()))
    for campaign_id in store.campaigns():
        try:
            content = store.read_json(campaign_id, PLAN) or {}
            if campaign_id != plan.campaign_id and _what_rows_depend_on(content) == wanted:
                yield store.plan(campaign_id)
        except StoreError:
            continue  # broken, or of another version: none of ours


def _what_rows_depend_on(content: Mapping[str, Any]) -> list[Any]:
    """Return, of a plan's document, all that a row is a function of, but its number."""
    said = content.get("spec", {})
    spec = {key: value for key, value in said.items() if key not in DOES_NOT_MATTER}
    spec["failures"] = said.get("failures", {}).get("retry", [])
    order = list(said.get("variables", {}))  # of columns, and of the dimensions of a sampler
    return [spec, order, *(content.get(key) for key in ("engine_build", "mechanism_digest"))]


def _copy(store: Store, other: Plan, plan: Plan) -> int:
    """Write the parts of a plan that another campaign's rows fill; return how many rows."""
    waiting = iter([b for b in range(len(plan.batches)) if b not in store.survey(plan).parts])
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
