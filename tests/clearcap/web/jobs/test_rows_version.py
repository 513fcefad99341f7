"""The version of the rows: new with every change of them, the same without one."""

import json

import pytest

from campaign.errors import StoreError
from campaign.store.layout import STOPPED
from clearcap.web.jobs.queries import rows_version


def test_it_changes_with_rows_and_with_nothing_else(growing):
    """Rows, merged files, the manifest and the end of the campaign count; state and report do not."""
    store, plan, compute = growing
    versions = [rows_version(store, plan.campaign_id)]

    def is_new():
        versions.append(rows_version(store, plan.campaign_id))
        return versions[-1] not in versions[:-1]

    compute(0)
    assert is_new()
    compute(1, 2)
    assert is_new()
    store.write_json(plan.campaign_id, "state.json", {"state": "running"})
    assert not is_new()
    store.record(plan, store.survey(plan).parts.values())
    assert is_new()
    store.compact(plan)
    assert is_new()
    store.write_json(plan.campaign_id, STOPPED, {"samples": 120})
    assert is_new()
    assert not is_new()
    assert rows_version(store.hasty, plan.campaign_id) == versions[-1]


def test_a_part_of_another_size_counts(own_filled):
    """A file that the manifest knows and that was replaced is another version."""
    store, plan = own_filled
    store.record(plan, store.survey(plan).parts.values())
    before = rows_version(store, plan.campaign_id)
    name = f"{plan.campaign_id}/parts/part-000003.parquet"
    store.files.write(name, store.files.read(name)[:-1])
    assert rows_version(store, plan.campaign_id) != before


@pytest.mark.parametrize("name", ["nobody-0123456789", "../etc", "a/../../b", "x\ny"])
def test_what_is_no_campaign_is_refused(filled, name):
    """With one message, and nothing outside the store is read."""
    with pytest.raises(StoreError, match=r"no campaign|not a valid file name"):
        rows_version(filled[0], name)


def test_behind_a_url_it_is_found_too(filled, tmp_path):
    """Where files have no times, sizes and digests are enough."""
    from campaign.store import open_store

    store, plan = filled
    remote = open_store("memory://versions")
    for name in store.files.names(f"{plan.campaign_id}/parts"):
        path = f"{plan.campaign_id}/parts/{name}"
        remote.files.write(path, store.files.read(path))
    remote.files.write(f"{plan.campaign_id}/plan.json", store.files.read(f"{plan.campaign_id}/plan.json"))
    assert rows_version(remote, plan.campaign_id) == rows_version(store, plan.campaign_id)
    remote.write_json(plan.campaign_id, STOPPED, json.loads('{"samples": 100}'))
    assert rows_version(remote, plan.campaign_id) != rows_version(store, plan.campaign_id)
