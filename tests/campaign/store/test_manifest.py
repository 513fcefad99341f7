"""The manifest in segments: what changed is written, what is whole is known, and none of them hides what a file is."""

import secrets
from dataclasses import replace

import pytest

from campaign.coordinator.dispatch import WorkQueue
from campaign.errors import StoreError
from campaign.plan import make_plan
from campaign.store import manifest, open_store, part_name, rows
from campaign.store.files.files import Files
from campaign.store.manifest import load_manifest
from tests.campaign.store.test_store import fill

BATCHES = 13  # of two samples: segments of five, five and three
NAMES = ["manifest-000001.json", "manifest-000002.json", "manifest.json"]


@pytest.fixture(autouse=True)
def small_segments(monkeypatch):
    """Have a few batches fill segments."""
    monkeypatch.setattr(manifest, "SEGMENT", 5)


@pytest.fixture(params=["folder", "memory"])
def filled(request, tmp_path, campaign):
    """Return a store with all parts of a plan, the plan, and its parts."""
    store = open_store(str(tmp_path) if request.param == "folder" else f"memory://{secrets.token_hex(4)}")
    plan = store.create_plan(make_plan(campaign, 2))
    fill(store, plan, range(BATCHES))
    return store, plan, store.survey(plan).parts


@pytest.fixture
def traffic(monkeypatch):
    """Return lists of the names of files that are written and read, as they are."""
    seen = {"write": [], "read": []}

    def watched(kind):
        action = getattr(Files, kind)

        def act(self, name, *rest, **options):
            seen[kind].append(name.rpartition("/")[2])
            return action(self, name, *rest, **options)

        monkeypatch.setattr(Files, kind, act)

    for kind in seen:
        watched(kind)
    return seen


def there(store, plan):
    """Return the names of the segments in a store."""
    return [name for name in store.files.names(plan.campaign_id) if name.startswith("manifest")]


def known(store, plan):
    """Return what the manifest lists, by batch."""
    return {part.batch: part for parts in load_manifest(store.files, plan).values() for part in parts}


def test_a_coordinator_writes_what_changed(filled, traffic):
    """All once, then the segments of the parts that came; nothing if none came."""
    store, plan, parts = filled
    queue = WorkQueue(plan, {batch: parts[batch] for batch in (0, 1)}, 25)
    for came, written in (
        ([], ["manifest.json"]),
        ([2, 12], ["manifest.json", "manifest-000002.json"]),
        ([], []),
        ([6, 7], ["manifest-000001.json"]),
    ):
        for batch in came:
            queue.complete(parts[batch])
        traffic["write"].clear()
        queue.record(store)
        assert traffic["write"] == written
        assert known(store, plan) == queue.parts
    assert there(store, plan) == NAMES


def test_what_a_store_refused_is_written_later(filled, monkeypatch):
    """A segment that could not be written is lacking until it is; those before it are whole."""
    store, plan, parts = filled
    queue = WorkQueue(plan, {0: parts[0]}, 25)
    queue.record(store)
    for part in parts.values():
        queue.complete(part)
    write = Files.write

    def refuse(self, name, content):
        if name.endswith(NAMES[0]):
            raise StoreError("full")
        write(self, name, content)

    with monkeypatch.context() as broken:
        broken.setattr(Files, "write", refuse)
        with pytest.raises(StoreError, match="full"):
            queue.record(store)
    assert sorted(known(store, plan)) == [0, 1, 2, 3, 4]
    assert store.survey(plan).parts == parts
    queue.record(store)
    assert known(store, plan) == parts


def test_nothing_that_is_listed_is_read(filled, traffic):
    """By a survey with all segments; with one that is damaged, its own parts are."""
    store, plan, parts = filled
    store.record(plan, parts.values())
    traffic["read"].clear()
    assert store.survey(plan).parts == parts
    assert [name for name in traffic["read"] if name.startswith("part")] == []
    store.files.write(f"{plan.campaign_id}/{NAMES[0]}", b"[" * 100_000)
    assert store.survey(plan).parts == parts
    read = sorted(name for name in traffic["read"] if name.startswith("part"))
    assert read == [f"part-{batch:06d}.parquet" for batch in range(5, 10)]


def test_one_file_of_an_earlier_version(filled, monkeypatch):
    """It is read for all batches, and each segment that is written decides on its own from then on."""
    store, plan, parts = filled
    with monkeypatch.context() as earlier:
        earlier.setattr(manifest, "SEGMENT", 10**6)
        store.record(plan, parts.values())
    assert there(store, plan) == ["manifest.json"]
    assert known(store, plan) == parts
    store.record(plan, [parts[5]], {1})
    assert sorted(known(store, plan)) == [0, 1, 2, 3, 4, 5, 10, 11, 12]
    store.record(plan, parts.values())
    assert known(store, plan) == parts


def test_merged_files_in_two_segments(filled, monkeypatch):
    """They are known too, and segments that list nothing any more are removed."""
    store, plan, _ = filled
    store.record(plan, store.survey(plan).parts.values())
    with monkeypatch.context() as smaller:
        smaller.setattr(rows, "MERGED_ROWS", 14)
        store.compact(plan)
    assert there(store, plan) == NAMES
    parts = store.survey(plan).parts
    assert {part.merged for part in parts.values()} == {(0, 6), (7, 12)}
    assert known(store, plan) == parts
    store.record(plan, [part for batch, part in parts.items() if batch < 5])
    assert there(store, plan) == ["manifest.json"]
    assert known(store, plan) == {}  # half a file is none


def test_pieces_of_two_files_of_one_name(filled):
    """A merged file that was written anew between two segments counts as not listed."""
    store, plan, _ = filled
    store.compact(plan)
    parts = store.survey(plan).parts
    before = [replace(part, sha256="0" * 64) for part in parts.values()]
    store.record(plan, before)
    store.record(plan, [part for batch, part in parts.items() if batch < 5], {0})
    assert known(store, plan) == {}
    assert store.survey(plan).parts == parts


def test_a_part_that_comes_back(filled):
    """Merged, and later computed again with the same size: no entry of its first life vouches for it."""
    store, plan, parts = filled
    store.record(plan, parts.values())
    content = store.files.read(part_name(plan, 7))
    store.compact(plan)
    store.files.write(part_name(plan, 7), content[:-1] + b"?")
    assert list(store.survey(plan).bad) == [7]
