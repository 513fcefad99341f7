"""``clearcap compact``: few files, and bad parts by name."""

import json

from campaign.store import part_name
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


def test_compact(store, plan, capsys, monkeypatch):
    """Parts are merged, bad ones are named, and what was done is said."""
    fill(store, plan)
    store.files.write(part_name(plan, 2), b"damaged")
    code, output, messages = clearcap_here(capsys, monkeypatch, "compact", "--store", store.url, "--json")
    document = json.loads(output)
    assert code == 0
    assert document["written"] == ["rows-000000-000001.parquet"]
    assert (document["removed"], document["files"], document["bad_batches"]) == (2, 1, [2])
    assert "part-000002.parquet is truncated or damaged" in messages
    code, output, _ = clearcap_here(capsys, monkeypatch, "compact", plan.campaign_id, "--store", store.url)
    assert (code, output) == (0, f"{plan.campaign_id}: 0 files merged into 0; the campaign has 1 files of rows now\n")
