"""The store tells sound rows from bad ones, and never uses or drops the bad ones in silence."""

import os
import re
import secrets
import socket
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign.errors import StoreError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import BadPart, open_store, part_name
from campaign.store.parts import check, encode
from campaign.store.store import LARGEST_DOCUMENT
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC


def fill(store, plan, batches=(0, 1, 2)):
    """Compute batches."""
    address = CampaignAddress.of(store, plan, fake_engine.simulate)
    for batch in batches:
        run_batch(address, BatchRequest(batch))


@pytest.mark.parametrize("url", ["folder", "memory"])
def test_table_is_complete_and_sorted(plan, tmp_path, url):
    """All rows in the order of the samples, with units, whatever the order of arrival."""
    opened = open_store(str(tmp_path) if url == "folder" else f"memory://{secrets.token_hex(4)}")
    opened.create_plan(plan)
    fill(opened, plan, (2, 0, 1))
    table = open_store(opened.url).table()
    assert table["sample"].to_pylist() == list(range(25))
    assert table.schema.equals(plan.schema, check_metadata=True)
    assert opened.survey(plan).missing == []


def test_what_is_missing(store, plan):
    """Batches without a part are missing; the rows there are can be read."""
    fill(store, plan, [1])
    survey = store.survey(plan)
    assert (survey.missing, survey.bad) == ([0, 2], {})
    assert store.table()["sample"].to_pylist() == list(range(10, 20))


def truncate(store, plan, name):
    store.files.write(name, store.files.read(name)[:-100])


def empty(store, plan, name):
    store.files.write(name, b"")


def damage(store, plan, name):
    content = bytearray(store.files.read(name))
    content[40] ^= 0xFF
    store.files.write(name, bytes(content))


def unsealed(store, plan, name):
    buffer = pa.BufferOutputStream()
    pq.write_table(store.read_part(plan, 1), buffer)
    store.files.write(name, buffer.getvalue().to_pybytes())


def foreign(store, plan, name):
    other = replace(plan, campaign_id="other-0123456789")
    store.files.write(name, encode(other, store.read_part(plan, 1), 1, 1))


def other_samples(store, plan, name):
    store.files.write(name, store.files.read(part_name(plan, 0)))


def other_batches(store, plan, name):
    other = replace(plan, batches=((0, 10), (10, 15)))
    rows = pa.concat_tables([store.read_part(plan, 1), store.read_part(plan, 2)])
    store.files.write(name, encode(other, rows, 1, 1))


def other_columns(store, plan, name):
    other = SimpleNamespace(
        campaign_id=plan.campaign_id,
        sealed_as=plan.sealed_as,
        numbers_of=plan.numbers_of,
        batches=plan.batches,
        columns=[column for column in plan.columns if column["name"] != "FC-2"],
        schema=plan.schema.remove(plan.schema.get_field_index("FC-2")),
    )
    store.files.write(name, encode(other, store.read_part(plan, 1).drop_columns(["FC-2"]), 1, 1))


def huge(store, plan, name):
    with open(store.files.path(name), "wb") as file:
        file.truncate(10 * 2**30)


def odd(make):
    """Return what puts something else than a file in a part's place."""

    def spoil(store, plan, name):
        path = Path(store.files.path(name))
        path.unlink()
        make(path)

    return spoil


def listen(path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(path))  # the path of a socket has at most 107 characters


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (odd(os.mkfifo), "is a named pipe, not a regular file"),
        (odd(listen), "is a socket or a device, not a regular file"),
        (odd(os.mkdir), "is a folder, not a regular file"),
        (odd(lambda path: path.symlink_to("/dev/zero")), "is a symbolic link, not a regular file"),
        (odd(lambda path: path.symlink_to("part-000000.parquet")), "is a symbolic link, not a regular file"),
        (truncate, "is truncated or damaged"),
        (empty, "is truncated or damaged (0 bytes, without a seal)"),
        (damage, "seal broken"),
        (unsealed, "without a seal"),
        (foreign, "belongs to campaign other-0123456789"),
        (other_samples, "does not hold exactly the samples 10 to 19"),
        (other_batches, "does not hold exactly the samples 10 to 19"),
        (other_columns, "has other columns or units than the plan"),
        (huge, "has 10737418240 bytes; allowed: up to"),
    ],
)
def test_bad_part_is_named_quarantined_and_replaced(store, plan, caplog, monkeypatch, tmp_path, spoil, reason):
    """A bad part is not used; readers say so, writers quarantine it, as often as it comes, and compute it again."""
    monkeypatch.chdir(tmp_path)
    fill(store, plan)
    whole = store.table()
    for quarantined in (["part-000001.parquet.bad"], ["part-000001.parquet.bad", "part-000001.parquet.bad-2"]):
        spoil(store, plan, part_name(plan, 1))
        assert store.table()["sample"].to_pylist() == [*range(10), *range(20, 25)]
        assert reason in caplog.text
        with pytest.raises(BadPart, match=re.escape(reason)):
            store.read_part(plan, 1)
        survey = store.survey(plan)
        assert (survey.missing, list(survey.bad), survey.rows) == ([1], [1], 15)
        assert reason in survey.bad[1]
        assert store.quarantine(plan, survey.bad) == quarantined[-1:]
        assert store.files.names(f"{plan.campaign_id}/parts") == [
            "part-000000.parquet",
            *quarantined,
            "part-000002.parquet",
        ]
        fill(store, plan, [1])
        assert store.table().equals(whole)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
@pytest.mark.parametrize("name", ["plan.json", "state.json", "lease.json", "stopped.json"])
def test_document_that_is_no_file_is_one_message(store, plan, make, name):
    """It is neither waited for nor read: an error names it and says to move it away."""
    path = Path(store.files.path(f"{plan.campaign_id}/{name}"))
    path.unlink(missing_ok=True)
    make(path)
    with pytest.raises(StoreError, match=rf"{name} is a .*, not a regular file, so clearcap did not write it; move"):
        store.plan(plan.campaign_id) if name == "plan.json" else store.read_json(plan.campaign_id, name)


def test_a_link_to_a_document_is_not_read(store, plan, tmp_path):
    """Even to a document that clearcap wrote: who can make links in a store does not choose what is read."""
    path = Path(store.files.path(f"{plan.campaign_id}/plan.json"))
    path.rename(tmp_path / "plan.json")
    path.symlink_to(tmp_path / "plan.json")
    with pytest.raises(StoreError, match=r"plan\.json is a symbolic link"):
        store.plan(plan.campaign_id)


def test_manifest_that_is_no_file_costs_time_only(store, plan, caplog):
    """The parts are read instead, and the next manifest takes its place."""
    fill(store, plan)
    os.mkfifo(path := Path(store.files.path(f"{plan.campaign_id}/manifest.json")))
    survey = store.survey(plan)
    assert (survey.missing, "is a named pipe" in caplog.text) == ([], True)
    store.record(plan, survey.parts.values())
    assert path.is_file()


def test_plan_that_is_gone(store):
    """A folder that somebody has removed is named, with the remedy."""
    with pytest.raises(StoreError, match=r"demo-0000000000/plan\.json"):
        store.hasty.plan("demo-0000000000")


def test_no_link_leads_out_of_a_store(store, plan, tmp_path):
    """A folder that is a link to elsewhere is neither read nor written; the store itself may be a link."""
    fill(store, plan)
    parts = Path(store.files.path(f"{plan.campaign_id}/parts"))
    (outside := tmp_path / "outside").mkdir()
    parts.rename(outside / "parts")
    parts.symlink_to(outside / "parts")
    for operation in (store.survey, lambda plan: fill(store, plan, [1])):
        with pytest.raises(StoreError, match=r"\blink\b"):
            operation(plan)
    parts.unlink()
    (outside / "parts").rename(parts)
    (tmp_path / "link").symlink_to(tmp_path / "runs")
    assert open_store(str(tmp_path / "link")).survey(plan).missing == []


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, '{"token": ' + "9" * 10_000 + "}", "[1]", "{"])
def test_document_that_is_no_json_of_ours(store, plan, text):
    """Depth and digits without end are refused by name, as is what is no object."""
    store.files.write(f"{plan.campaign_id}/lease.json", text.encode())
    with pytest.raises(StoreError, match=r"lease\.json"):
        store.read_json(plan.campaign_id, "lease.json")
    store.files.write(f"{plan.campaign_id}/lease.json", b" " * (LARGEST_DOCUMENT + 1))
    with pytest.raises(StoreError, match=r"lease\.json.*1048577.*1048576"):
        store.read_json(plan.campaign_id, "lease.json")


@settings(max_examples=300, deadline=None)
@given(position=st.floats(0, 1, exclude_max=True), flip=st.integers(1, 255))
def test_no_flipped_byte_goes_unnoticed(sealed, position, flip):
    """One changed byte, wherever in a part, makes it a bad one."""
    plan, content = sealed
    damaged = bytearray(content)
    damaged[int(position * len(content))] ^= flip
    with pytest.raises(BadPart):
        check(plan, bytes(damaged), 1, 1, merged=False)


@pytest.mark.parametrize("tenths", range(10))
def test_no_truncation_goes_unnoticed(sealed, tenths):
    """A part cut at any tenth is a bad one."""
    plan, content = sealed
    with pytest.raises(BadPart, match="is truncated or damaged"):
        check(plan, content[: len(content) * tenths // 10], 1, 1, merged=False)


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    """Return a plan and the content of its part 1, made once."""
    folder = tmp_path_factory.mktemp("sealed")
    (folder / "demo.toml").write_text(SPEC)
    plan = make_plan(load_campaign(str(folder / "demo.toml")), 10)
    store = open_store(str(folder / "runs"))
    store.create_plan(plan)
    fill(store, plan, [1])
    content = store.files.read(part_name(plan, 1))
    assert check(plan, content, 1, 1, merged=False)[0].rows == 10
    return plan, content


def test_part_that_became_sound_stays(store, plan):
    """A bad part that was replaced since it was found is not quarantined."""
    fill(store, plan)
    truncate(store, plan, part_name(plan, 1))
    survey = store.survey(plan)
    store.files.remove(part_name(plan, 1))
    fill(store, plan, [1])
    assert store.quarantine(plan, survey.bad) == []
    assert store.survey(plan).missing == []


def test_wrong_rows_are_not_written(store, plan):
    """A part is never written with the rows of other samples."""
    fill(store, plan, [0])
    with pytest.raises(ValueError, match="samples 10 to 19"):
        store.write_part(plan, 1, store.read_part(plan, 0))
    assert store.survey(plan).missing == [1, 2]


def test_clock_jump_changes_nothing(store, plan):
    """Dates of files, in the far future or past, play no part."""
    fill(store, plan)
    store.record(plan, store.survey(plan).parts.values())
    whole = store.table()
    for date in (0, 2**33):
        for batch in range(3):
            os.utime(store.files.path(part_name(plan, batch)), (date, date))
        assert store.survey(plan, verify=True).missing == store.survey(plan).missing == []
        assert store.table().equals(whole)


def test_parts_are_parquet_for_everybody(store, plan):
    """A part is read by any reader of Parquet, to the same bits, types and units; few strings are written once."""
    fill(store, plan, [1])
    path = store.files.path(part_name(plan, 1))
    read = pq.read_table(path)
    assert read.replace_schema_metadata(plan.schema.metadata).equals(store.read_part(plan, 1), check_metadata=True)
    group = pq.ParquetFile(path).metadata.row_group(0)
    packed = {
        column.path_in_schema
        for column in map(group.column, range(group.num_columns))
        if "RLE_DICTIONARY" in column.encodings
    }
    assert packed == {"status", "message", "earlier_attempts"}


def test_leftovers_of_writers_are_not_parts(store, plan):
    """Temporary files are invisible to readers."""
    fill(store, plan, [0])
    content = store.files.read(part_name(plan, 0))
    store.files.write(f"{part_name(plan, 1)}.4711-ab.tmp", content)
    assert store.survey(plan).missing == [1, 2]


def test_first_plan_wins(store, plan, campaign):
    """The same campaign with other batches finds the plan that is there."""
    assert store.create_plan(make_plan(campaign, 4)).batches == plan.batches


def test_plan_in_the_wrong_folder(store, plan):
    """A renamed campaign folder is noticed."""
    store.files.write("demo-0000000000/plan.json", plan.to_json().encode())
    with pytest.raises(StoreError, match=f"folder demo-0000000000 holds the plan of {plan.campaign_id}"):
        store.plan("demo-0000000000")


def test_spec_is_kept_as_toml(store, plan, tmp_path):
    """The campaign file in the store is the campaign."""
    path = tmp_path / "runs" / plan.campaign_id / "campaign.toml"
    assert make_plan(load_campaign(str(path))).campaign_id == plan.campaign_id
