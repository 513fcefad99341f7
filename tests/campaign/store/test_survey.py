"""What there is of a campaign: the manifest saves time and decides nothing; where the table ends."""

import os
import secrets
import threading
from pathlib import Path

import pytest

from campaign.errors import StoreError
from campaign.plan import make_plan
from campaign.store import open_store, part_name, rows
from campaign.store import parts as surveys
from campaign.store.files.files import Files
from tests.campaign.store.test_store import fill


@pytest.fixture
def checked(monkeypatch):
    """Return a list of the files of rows that are read, as they are."""
    seen = []
    read = surveys._read_content
    monkeypatch.setattr(
        surveys, "_read_content", lambda files, plan, name: seen.append(name) or read(files, plan, name)
    )
    return seen


def recorded(store, plan):
    """Compute everything and record it."""
    fill(store, plan)
    store.record(plan, store.survey(plan).parts.values())


def test_what_is_known_is_not_read(store, plan, checked):
    """With a manifest only what it does not know is read; verifying reads all."""
    recorded(store, plan)
    before = store.survey(plan)
    checked.clear()
    assert store.survey(plan) == before
    assert checked == []
    assert store.survey(plan, verify=True) == before
    assert sorted(checked) == [f"part-{batch:06d}.parquet" for batch in range(3)]
    assert before.rows == 25
    assert before.statuses == {"ok": 25}
    assert [part.rows for part in before.parts.values()] == [10, 10, 5]


def test_writer_and_survey_agree(store, plan):
    """What writing a part returns is what a survey finds, so that a manifest needs no reading at all."""
    fill(store, plan)
    parts = [store.write_part(plan, batch, store.read_part(plan, batch)) for batch in range(3)]
    assert list(store.survey(plan, verify=True).parts.values()) == parts
    assert parts[0].size == os.stat(store.files.path(part_name(plan, 0))).st_size


def lose(text):
    return None


def cut(text):
    return text[: len(text) // 2]


def other_campaign(text):
    return text.replace('"campaign":"demo', '"campaign":"other')


def other_count(text):
    return text.replace('{"ok":5}', '{"ok":4,"crashed":1}')


def other_path(text):
    return text.replace("part-000001.parquet", "../../etc/passwd")


def deep(text):
    return "[" * 100_000


def number(text):
    return "17"


@pytest.mark.parametrize("spoil", [lose, cut, other_campaign, other_count, other_path, deep, number])
def test_manifest_that_is_lost_or_damaged(store, plan, checked, caplog, spoil):
    """Whatever happens to the manifest, what there is is found by reading, and said."""
    recorded(store, plan)
    before = store.survey(plan)
    path = Path(store.files.path(f"{plan.campaign_id}/manifest.json"))
    text = spoil(path.read_text())
    if text is None:
        path.unlink()
    else:
        path.write_text(text)
    checked.clear()
    assert store.survey(plan) == before
    assert len(checked) == 3
    assert ("manifest.json is not valid" in caplog.text) == (text is not None)


def test_manifest_of_ten_gigabytes(store, plan, caplog):
    """A manifest that cannot be one is not loaded."""
    recorded(store, plan)
    with open(store.files.path(f"{plan.campaign_id}/manifest.json"), "wb") as file:
        file.truncate(10 * 2**30)
    assert store.survey(plan).missing == []
    assert "manifest.json has 10737418240 bytes" in caplog.text


def test_stale_manifest(store, plan):
    """Parts that came, went or were spoilt since the manifest was written are seen as they are."""
    fill(store, plan, [0, 1])
    store.record(plan, store.survey(plan).parts.values())
    fill(store, plan, [2])
    store.files.remove(part_name(plan, 0))
    name = part_name(plan, 1)
    store.files.write(name, store.files.read(name)[:-1])
    survey = store.survey(plan)
    assert (survey.missing, list(survey.bad), survey.rows) == ([0, 1], [1], 5)


def test_damage_that_keeps_the_size(store, plan):
    """A part damaged to the same size is found by verifying, and never gets into a table."""
    recorded(store, plan)
    path = Path(store.files.path(part_name(plan, 1)))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert store.survey(plan).missing == []
    assert list(store.survey(plan, verify=True).bad) == [1]
    assert store.table()["sample"].to_pylist() == [*range(10), *range(20, 25)]


def test_listing_that_lags(store, plan, monkeypatch):
    """A part that is recorded and not yet listed, as on a shared folder, is found by its name."""
    recorded(store, plan)
    sizes = Files.sizes
    monkeypatch.setattr(
        Files, "sizes", lambda self, folder: {k: v for k, v in sizes(self, folder).items() if "000001" not in k}
    )
    assert store.survey(plan).missing == []


def test_part_that_vanishes_while_surveyed(store, plan, monkeypatch):
    """A part merged between listing and reading is found where it is now."""
    fill(store, plan)
    sizes, listings = Files.sizes, []

    def listed(self, folder):
        found = sizes(self, folder)
        listings.append(found)
        if len(listings) == 1:
            store.compact(plan)
        return found

    monkeypatch.setattr(Files, "sizes", listed)
    survey = store.survey(plan)
    assert (survey.missing, survey.rows) == ([], 25)


def test_where_the_table_ends(store, plan):
    """A campaign that stopped when sure has a table up to there; the rows beyond stay in the parts."""
    recorded(store, plan)
    whole = store.table()
    assert store.end(plan) == 25
    for end in (1, 10, 13, 25):
        store.write_json(plan.campaign_id, "stopped.json", {"samples": end})
        assert store.end(plan) == end
        assert store.table().equals(whole.slice(0, end))
        survey = store.survey(plan)
        assert (survey.rows, survey.statuses, survey.missing) == (end, {"ok": end}, [])
        assert len(survey.parts) == 3
    store.files.remove(part_name(plan, 1))
    store.write_json(plan.campaign_id, "stopped.json", {"samples": 8})
    assert store.survey(plan).missing == []


@pytest.mark.parametrize("samples", [0, 26, -1, "ten", None, 2.5, True])
def test_impossible_end(store, plan, samples):
    """A damaged end is refused by name."""
    store.write_json(plan.campaign_id, "stopped.json", {"samples": samples})
    with pytest.raises(StoreError, match=r"stopped\.json.*samples"):
        store.end(plan)


def test_stream_is_the_table_in_pieces(store, plan, monkeypatch):
    """Rows come in order, small files together, only the columns asked for; missing batches are left out."""
    fill(store, plan, [0, 2])
    (together,) = store.stream(plan, ["sample", "FC-1"])
    assert together["sample"].to_pylist() == [*range(10), *range(20, 25)]
    (turned,) = store.stream(plan, ["FC-1", "sample"])
    assert turned.equals(together.select(["FC-1", "sample"]))
    monkeypatch.setattr(rows, "ROW_GROUP", 10)
    pieces = list(store.stream(plan, ["sample", "FC-1"]))
    assert [piece["sample"].to_pylist() for piece in pieces] == [[*range(10)], [*range(20, 25)]]
    assert pieces[0].column_names == ["sample", "FC-1"]


@pytest.fixture
def behind_url(campaign):
    """Return a store behind a URL with all parts of a plan in batches of 2, and the plan."""
    opened, plan = open_store(f"memory://{secrets.token_hex(4)}"), make_plan(campaign, 2)
    opened.create_plan(plan)
    fill(opened, plan, range(13))
    return opened, plan


def test_parts_behind_a_url_are_read_several_at_a_time(behind_url, monkeypatch):
    """The next one is asked for before the last one has come; their order stays."""
    store, plan = behind_url
    backend = type(store.files._backend)
    both, read = threading.Barrier(2, timeout=60.0), backend.read

    def read_together(files, path, *others):
        if path.endswith(("part-000001.parquet", "part-000002.parquet")):
            both.wait()  # broken, if one is read after the other
        return read(files, path, *others)

    monkeypatch.setattr(backend, "read", read_together)
    assert store.table(plan.campaign_id)["sample"].to_pylist() == [*range(25)]


def test_bad_and_missing_parts_behind_a_url_are_left_out(behind_url, monkeypatch, caplog):
    """With the same warning as in a folder; one may go while others are read."""
    store, plan = behind_url
    store.files.write(part_name(plan, 3), b"damaged")
    monkeypatch.setattr(rows, "ROW_GROUP", 2)
    pieces = store.stream(plan, ["sample"])
    found = next(pieces)["sample"].to_pylist()
    store.files.remove(part_name(plan, 12))
    for piece in pieces:
        found += piece["sample"].to_pylist()
    assert found == [*range(6), *range(8, 24)]
    assert "left out" in caplog.text


def test_documents(store, plan):
    """Small documents are read, replaced, created once, removed; a damaged one is named."""
    name = plan.campaign_id
    assert store.read_json(name, "state.json") is None
    store.write_json(name, "state.json", {"state": "running", "é": 0.1})
    store.write_json(name, "state.json", {"state": "done"})
    assert store.read_json(name, "state.json") == {"state": "done"}
    assert store.create_json(name, "lease.json", {"owner": "a"})
    assert not store.create_json(name, "lease.json", {"owner": "b"})
    assert store.read_json(name, "lease.json") == {"owner": "a"}
    store.remove(name, "lease.json")
    store.remove(name, "lease.json")
    assert store.create_json(name, "lease.json", {"owner": "b"})
    for content in (b"{", b"[]", b"\xff"):
        store.files.write(f"{name}/state.json", content)
        with pytest.raises(StoreError, match=r"state\.json"):
            store.read_json(name, "state.json")
