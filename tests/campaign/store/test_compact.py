"""Merging parts: the same table to the bit, whenever it is killed, whoever reads or writes meanwhile."""

import random
import subprocess
import sys
import time

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from campaign.errors import StoreError
from campaign.store import open_store, part_name
from campaign.store import rows as compaction
from campaign.store.parts import encode
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.store.test_store import fill


def parts(store, plan):
    """Return what is in the folder of the parts."""
    return store.files.names(f"{plan.campaign_id}/parts")


def test_same_table(store, plan):
    """A merged campaign is one file, the same table with schema and metadata, and nothing is missing."""
    fill(store, plan)
    whole = store.table()
    done = store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000002.parquet"] == done.written
    assert (done.removed, done.files) == (3, 1)
    assert store.table().equals(whole, check_metadata=True)
    assert store.survey(plan, verify=True).missing == store.survey(plan).missing == []
    again = store.compact(plan)
    assert (again.written, again.removed, again.files) == ([], 0, 1)
    assert store.read_part(plan, 1).equals(whole.slice(10, 10))


def test_done_batches_are_not_computed_again(store, plan):
    """Merged batches are done; one that a late worker computes all the same has the same rows."""
    fill(store, plan)
    store.compact(plan)
    whole = store.table()
    assert store.survey(plan).missing == []
    run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(1))
    assert parts(store, plan) == ["part-000001.parquet", "rows-000000-000002.parquet"]
    assert store.table().equals(whole)


def test_campaign_that_goes_on(store, plan):
    """Runs of what is there are merged; what comes later joins them."""
    fill(store, plan, [0, 1])
    store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000001.parquet"]
    fill(store, plan, [2])
    assert store.survey(plan).missing == []
    whole = store.table()
    store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000002.parquet"]
    assert store.table().equals(whole)


def test_holes_and_single_parts_stay(store, plan):
    """A part without neighbours stays as it is."""
    fill(store, plan, [0, 2])
    assert store.compact(plan).written == []
    assert parts(store, plan) == ["part-000000.parquet", "part-000002.parquet"]


def test_size_of_files(store, plan, monkeypatch):
    """A merged file ends where the next 100,000 samples begin."""
    monkeypatch.setattr(compaction, "MERGED_ROWS", 20)
    fill(store, plan)
    store.compact(plan)
    assert parts(store, plan) == ["part-000002.parquet", "rows-000000-000001.parquet"]


def test_row_groups(store, plan, monkeypatch):
    """Merged files are cut into groups, so that other readers need not hold them whole."""
    monkeypatch.setattr("campaign.store.parts.ROW_GROUP", 7)
    fill(store, plan)
    whole = store.table()
    store.compact(plan)
    file = pq.ParquetFile(store.files.path(f"{plan.campaign_id}/parts/rows-000000-000002.parquet"))
    assert file.metadata.num_row_groups == 4
    assert store.table().equals(whole)


def relabelled(store, plan, batch, attempts):
    """Return the rows of a batch, marked by their number of attempts."""
    table = store.read_part(plan, batch)
    at = table.schema.get_field_index("attempts")
    return table.set_column(at, table.schema.field(at), [[attempts] * table.num_rows])


def test_order_of_precedence(store, plan):
    """A batch's own part comes before a merged file, a longer merged file before a shorter one."""
    fill(store, plan)
    folder = f"{plan.campaign_id}/parts"
    store.compact(plan)
    shorter = store.read_part(plan, 0)
    rows = pa.concat_tables([relabelled(store, plan, batch, 2) for batch in (0, 1)])
    store.files.write(f"{folder}/rows-000000-000001.parquet", encode(plan, rows, 0, 1))
    assert store.table()["attempts"].to_pylist() == [1] * 25
    assert store.read_part(plan, 0).equals(shorter)
    store.write_part(plan, 1, relabelled(store, plan, 1, 3))
    expected = [1] * 10 + [3] * 10 + [1] * 5
    assert store.table()["attempts"].to_pylist() == expected
    assert store.read_part(plan, 1)["attempts"].to_pylist() == [3] * 10
    assert store.survey(plan).rows == 25
    store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000002.parquet"]
    assert store.table()["attempts"].to_pylist() == expected


def test_bad_part_with_a_merged_double(store, plan, caplog):
    """A bad part is named and quarantined, and its batch is not missing if a merged file holds it."""
    fill(store, plan)
    store.compact(plan)
    whole = store.table()
    store.files.write(part_name(plan, 1), b"damaged")
    survey = store.survey(plan)
    assert (survey.missing, list(survey.bad), survey.rows) == ([], [1], 25)
    assert store.table().equals(whole)
    assert "part-000001.parquet is truncated or damaged" in caplog.text
    assert store.read_part(plan, 1).num_rows == 10
    assert store.quarantine(plan, survey.bad) == ["part-000001.parquet.bad"]
    assert store.survey(plan).bad == {}


def test_bad_merged_file(store, plan):
    """All batches of a damaged merged file are missing, it is quarantined, and computing them gives the table again."""
    fill(store, plan)
    whole = store.table()
    store.compact(plan)
    name = f"{plan.campaign_id}/parts/rows-000000-000002.parquet"
    store.files.write(name, store.files.read(name)[:-200])
    survey = store.survey(plan)
    assert (survey.missing, sorted(survey.bad), survey.rows) == ([0, 1, 2], [0, 1, 2], 0)
    assert len(store.table()) == 0
    assert store.compact(plan).bad == survey.bad
    assert store.quarantine(plan, survey.bad) == ["rows-000000-000002.parquet.bad"]
    fill(store, plan)
    assert store.table().equals(whole)


def test_bad_part_is_not_merged(store, plan):
    """A bad part stays where it is, and ends a run."""
    fill(store, plan)
    store.files.write(part_name(plan, 1), b"damaged")
    assert list(store.compact(plan).bad) == [1]
    assert parts(store, plan) == [f"part-{batch:06d}.parquet" for batch in range(3)]


def test_a_write_that_does_not_read_back(store, plan, monkeypatch):
    """Parts go only when the merged file has been read back."""
    fill(store, plan)
    names = parts(store, plan)
    write = store.files.write
    monkeypatch.setattr(
        store.files, "write", lambda name, content: write(name, content[:-1] if "rows" in name else content)
    )
    store.compact(plan)
    assert [name for name in parts(store, plan) if name in names] == names
    assert store.survey(plan).missing == []


COMPACTS = """
import sys
from campaign.store import open_store
store = open_store(sys.argv[1])
plan = store.plan_header(store.find(None))
import pyarrow
print("go", flush=True)
store.compact(plan)
"""


@pytest.mark.processes
@pytest.mark.parametrize("seed", range(10))
def test_killed_anywhere(store, plan, seed):
    """Kill -9 at a random moment: every row is read once, and merging again completes it."""
    fill(store, plan)
    whole = store.table()
    with subprocess.Popen([sys.executable, "-c", COMPACTS, store.url], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        time.sleep(random.Random(seed).uniform(0.0, 0.04))
        process.kill()
    assert store.table().equals(whole)
    assert store.survey(plan).missing == []
    store.compact(plan)
    store.files.sweep(f"{plan.campaign_id}/parts")
    assert parts(store, plan) == ["rows-000000-000002.parquet"]
    assert store.table().equals(whole)


@pytest.mark.slow
@pytest.mark.parametrize("steps", range(5))
def test_stopped_at_every_step(store, plan, monkeypatch, steps):
    """Stopped before the write or before any removal, every row is read once, and merging again completes it."""
    fill(store, plan)
    whole = store.table()
    left = [steps]

    def counted(action):
        def act(*arguments):
            if not left[0]:
                raise KeyboardInterrupt
            left[0] -= 1
            return action(*arguments)

        return act

    with monkeypatch.context() as patch:
        patch.setattr(store.files, "write", counted(store.files.write))
        patch.setattr(store.files, "remove", counted(store.files.remove))
        with pytest.raises(KeyboardInterrupt):
            store.compact(plan)
    assert store.table().equals(whole)
    assert (store.survey(plan).missing, store.survey(plan).rows) == ([], 25)
    store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000002.parquet"]
    assert store.table().equals(whole)


def test_reader_meanwhile(store, plan):
    """A stream that was begun before the parts were merged yields each row once."""
    fill(store, plan)
    whole = store.table()
    stream = store.stream(plan)
    first = next(stream)
    store.compact(plan)
    rest = list(stream)
    assert pa.concat_tables([first, *rest]).combine_chunks().equals(whole)


@pytest.mark.processes
def test_computing_and_merging_at_once(store, plan):
    """Parts written by one process while another merges: nothing is lost, and all are merged in the end."""
    script = COMPACTS.replace("store.compact(plan)", "while True: store.compact(plan)")
    with subprocess.Popen([sys.executable, "-c", script, store.url], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        for _ in range(10):
            fill(store, plan)
            table = store.table()
            assert table["sample"].to_pylist() == list(range(25))
            store.write_part(plan, 1, store.read_part(plan, 1))
        process.kill()
    store.files.sweep(f"{plan.campaign_id}/parts")
    store.compact(plan)
    assert parts(store, plan) == ["rows-000000-000002.parquet"]
    assert open_store(store.url).table()["sample"].to_pylist() == list(range(25))


def test_other_rows_than_were_merged(store, plan, monkeypatch):
    """A merged file with other rows, though sealed, replaces nothing."""
    fill(store, plan)
    names = parts(store, plan)
    other = pa.concat_tables([relabelled(store, plan, batch, 9) for batch in range(3)])
    monkeypatch.setattr(compaction, "encode", lambda plan, rows, first, last: encode(plan, other, first, last))
    with pytest.raises(StoreError, match="does not read back as it was written; its parts are kept"):
        store.compact(plan)
    assert [name for name in parts(store, plan) if name in names] == names
    assert store.table()["attempts"].to_pylist() == [1] * 25
