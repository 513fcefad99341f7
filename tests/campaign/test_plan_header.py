"""The header of a plan: read quickly, it agrees with the plan, and a damaged one is refused."""

import json

import pytest

from campaign.errors import StoreError
from campaign.spec.result_columns import results_schema
from tests.campaign.store.test_store import fill


def test_header_is_the_plan(store, plan):
    """The quick reading of a plan agrees with the plan."""
    header = store.plan_header(plan.campaign_id)
    assert header.schema.equals(plan.schema, check_metadata=True)
    assert plan.schema.equals(results_schema(plan.mechanism, plan.targets, plan.campaign_id), check_metadata=True)
    assert (header.batches, header.columns, header.samples) == (plan.batches, plan.columns, 25)
    fill(store, plan)
    assert store.survey(header) == store.survey(plan)


@pytest.mark.parametrize("key", ["batches", "spec", "schema", "campaign"])
def test_header_of_a_damaged_plan(store, plan, key):
    """A plan that lacks something, or whose batches have a hole, is refused."""
    content = json.loads(plan.to_json())
    del content[key]
    name = f"{plan.campaign_id}/plan.json"
    store.files.write(name, json.dumps(content).encode())
    with pytest.raises(StoreError, match=r"plan\.json cannot be read"):
        store.plan_header(plan.campaign_id)
    store.files.write(name, plan.to_json().replace("[\n   10,\n   10\n  ],", "").encode())
    with pytest.raises(StoreError, match="a batch begins at sample 20 in place of 10"):
        store.plan_header(plan.campaign_id)
