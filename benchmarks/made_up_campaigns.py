"""Campaigns with synthetic rows: the samples are drawn, and their responses are sums of the variables with noise."""

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa

from campaign.inputs.sampling import draw
from campaign.plan import Plan, make_plan
from campaign.spec.load import Campaign
from campaign.store import Store
from campaign.store.layout import PLAN


def made_up_campaign(store: Store, loaded: Campaign, samples: int, batch: int, name: str = "") -> Plan:
    """Write a campaign that imitates another, with `batch` rows in a file and their manifest; return its plan."""
    # Its name is by default derived from the number of rows.
    named = {"samples": samples, "name": name or f"{loaded.spec.name}-{samples}", "stop": None}
    plan = make_plan(replace(loaded, spec=loaded.spec.model_copy(update=named)), batch)
    with patch("os.fsync"):  # durability is not needed, and fsync would take most of the time
        store.files.write(f"{plan.campaign_id}/{PLAN}", plan.to_json().encode())  # `create_plan` would also check it
        parts = [
            store.write_part(plan, number, _rows(plan, first, count))
            for number, (first, count) in enumerate(plan.batches)
        ]
        store.record(plan, parts)
    return plan


def _rows(plan: Plan, first: int, count: int) -> pa.Table:
    """Return synthetic rows."""
    variables = draw(plan.spec, first, count)
    scaled = [(x - x.mean()) / (x.std() or 1.0) for x in variables.values()]
    rng = np.random.default_rng(first)
    columns: dict[str, Any] = {"sample": np.arange(first, first + count), **variables}
    for number, name in enumerate(plan.mechanism.responses):
        limits = plan.spec.responses[name].limits()[:2] if name in plan.spec.responses else (None, None)
        low, high = (side if side is not None else end for side, end in zip(limits, (0.0, 10.0), strict=True))
        spread = sum(x * (1 + (number + k) % 3) for k, x in enumerate(scaled)) + rng.standard_normal(count)
        columns[name] = (low + high) / 2 + (high - low) / 50 * spread
    constants = {"status": "ok", "message": "", "earlier_attempts": "", "settled": True, "steps": 80, "attempts": 1}
    for name in plan.schema.names:
        columns.setdefault(name, np.full(count, constants.get(name, 1e-9)))
    return pa.table({name: pa.array(columns[name]) for name in plan.schema.names}).cast(plan.schema)
