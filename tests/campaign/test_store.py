"""The store tells sound rows from bad ones, and never uses or drops the bad ones in silence."""

import secrets

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from campaign.errors import SpecError, StoreError
from campaign.load import load_campaign
from campaign.plan import make_plan
from campaign.store import open_store, part_name
from campaign.task import Task, run_batch
from tests.campaign import fake_engine


def fill(store, plan, batches=(0, 1, 2)):
    """Compute batches."""
    task = Task(store.url, plan.campaign_id, plan.engine_build, fake_engine.simulate)
    for batch in batches:
        run_batch(task, batch)


@pytest.mark.parametrize("url", ["folder", "memory"])
def test_table_is_complete_and_sorted(plan, tmp_path, url):
    """All rows in the order of the samples, with units, whatever the order of arrival."""
    opened = open_store(str(tmp_path) if url == "folder" else f"memory://{secrets.token_hex(4)}")
    opened.create_plan(plan)
    fill(opened, plan, (2, 0, 1))
    table = open_store(opened.url).table()
    assert table["sample"].to_pylist() == list(range(25))
    assert table.schema.equals(plan.schema, check_metadata=True)
    assert opened.scan(plan).missing == []


def test_what_is_missing(store, plan):
    """Batches without a part are missing; the rows there are can be read."""
    fill(store, plan, [1])
    scan = store.scan(plan)
    assert (scan.missing, scan.bad) == ([0, 2], {})
    assert scan.table["sample"].to_pylist() == list(range(10, 20))


def truncate(store, plan, name):
    store.files.write(name, store.files.read(name)[:-100])


def empty(store, plan, name):
    store.files.write(name, b"")


def damage(store, plan, name):
    content = bytearray(store.files.read(name))
    content[40] ^= 0xFF
    store.files.write(name, bytes(content))


def foreign(store, plan, name):
    table = store.read_part(plan, 1)
    buffer = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"format": "1", "campaign": "other-0123456789"}), buffer)
    store.files.write(name, buffer.getvalue().to_pybytes())


def other_samples(store, plan, name):
    store.files.write(name, store.files.read(part_name(plan, 0)))


def other_columns(store, plan, name):
    table = store.read_part(plan, 1).drop_columns(["FC-2"])
    buffer = pa.BufferOutputStream()
    pq.write_table(table, buffer)
    store.files.write(name, buffer.getvalue().to_pybytes())


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (truncate, "not a whole Parquet file"),
        (empty, "not a whole Parquet file"),
        (damage, "not a whole Parquet file"),
        (foreign, "belongs to campaign other-0123456789"),
        (other_samples, "does not hold exactly the samples 10 to 19"),
        (other_columns, "has other columns or units than the plan"),
    ],
)
def test_bad_part_is_named_set_aside_and_replaced(store, plan, caplog, spoil, reason):
    """A bad part is not used; readers say so, writers set it aside and compute its batch again."""
    fill(store, plan)
    whole = store.table()
    spoil(store, plan, part_name(plan, 1))
    assert store.table()["sample"].to_pylist() == [*range(10), *range(20, 25)]
    assert reason in caplog.text
    scan = store.scan(plan)
    assert scan.missing == [1]
    store.set_aside(plan, scan)
    assert store.files.names(f"{plan.campaign_id}/parts") == [
        "part-000000.parquet",
        "part-000001.parquet.bad",
        "part-000002.parquet",
    ]
    fill(store, plan, [1])
    assert store.table().equals(whole)


def test_leftovers_of_writers_are_not_parts(store, plan):
    """Temporary files are invisible to readers."""
    fill(store, plan, [0])
    content = store.files.read(part_name(plan, 0))
    store.files.write(f"{part_name(plan, 1)}.4711-ab.tmp", content)
    assert store.scan(plan).missing == [1, 2]


def test_first_plan_wins(store, plan, campaign):
    """The same campaign with other batches finds the plan that is there."""
    assert store.create_plan(make_plan(campaign, 4)).batches == plan.batches


def test_which_campaign(store, plan, campaign_file):
    """The only campaign need not be named; several must be, and an unknown one is refused with the list."""
    assert store.find(None) == plan.campaign_id
    other = make_plan(load_campaign(str(campaign_file), seed=1))
    store.create_plan(other)
    assert store.find(other.campaign_id) == other.campaign_id
    for campaign_id in (None, "../etc", "demo"):
        with pytest.raises(SpecError, match=plan.campaign_id):
            store.find(campaign_id)
    with pytest.raises(SpecError, match="campaigns there: none"):
        open_store(store.url + "-not-there").find(None)


def test_plan_in_the_wrong_folder(store, plan):
    """A renamed campaign folder is noticed."""
    store.files.write("demo-0000000000/plan.json", plan.to_json().encode())
    with pytest.raises(StoreError, match=f"folder demo-0000000000 holds the plan of {plan.campaign_id}"):
        store.plan("demo-0000000000")


def test_spec_is_kept_as_toml(store, plan, tmp_path):
    """The campaign file in the store is the campaign."""
    path = tmp_path / "runs" / plan.campaign_id / "campaign.toml"
    assert make_plan(load_campaign(str(path))).campaign_id == plan.campaign_id
