"""The index follows the store, and followers hear of what has changed, each thing once."""

import asyncio
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby

import pytest

from campaign.coordinator.heartbeat import observe
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.state import close_campaign, write_state
from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.files import local
from campaign.store.labels import LabelChange, change_labels
from campaign.store.layout import DELETED, PLAN
from campaign.store.store import change_tokens
from clearcap.web import watcher as watching
from clearcap.web.index import CampaignIndex, entry_of
from clearcap.web.watcher import Watcher
from tests.clearcap.web.conftest import read_all
from tests.clearcap.web.running import PATIENCE, until_true
from tests.until import until


@pytest.fixture
def index(tmp_path):
    made = CampaignIndex(tmp_path / "index.sqlite")
    yield made
    made.close()


@pytest.fixture
def finished(finished_store):
    return open_store(str(finished_store[0])), finished_store[1]


def test_entry_of_a_finished_campaign(finished):
    entry = entry_of(*finished)
    assert (entry.samples, entry.done, entry.ok, entry.failed, entry.left) == (25, 25, 25, 0, 0)
    assert entry.title == "demo"


def test_entry_of_a_broken_campaign(storage, tmp_path):
    store = open_store(storage(tmp_path))
    store.files.write("x-1/plan.json", b"{")
    entry = entry_of(store, "x-1")
    assert entry.state == "broken"
    assert "plan.json" in entry.message


@pytest.fixture
def exact(monkeypatch):
    """Have no file count as one that changed just now, so that its own stamp must tell."""
    monkeypatch.setattr(local, "RECENT", -1e9)


def test_index_reads_only_what_changed(store, plan, index, exact, monkeypatch):
    read = []
    monkeypatch.setattr("clearcap.web.index.entry_of", lambda s, c: (read.append(c), entry_of(s, c))[1])
    for _ in range(2):
        read_all(index, store)
        assert read == [plan.campaign_id]
    change_labels(store, plan.campaign_id, LabelChange(owner="eva"))
    read_all(index, store)
    assert index.entry(plan.campaign_id).owner == "eva"
    write_state(store, plan.campaign_id, "cancelled")
    read_all(index, store)
    assert index.entry(plan.campaign_id).state == "cancelled"
    assert len(read) == 3
    write_state(store, plan.campaign_id, "queued")
    for _ in range(2):  # what moves is read each time
        read_all(index, store)
    assert len(read) == 5


def test_index_is_kept_and_can_be_deleted(store, plan, index, exact, tmp_path):
    read_all(index, store)
    again = CampaignIndex(tmp_path / "index.sqlite")
    assert again.entry(plan.campaign_id) == index.entry(plan.campaign_id)
    again.look(change_tokens(store))
    assert not again.is_behind
    again.close()
    (tmp_path / "index.sqlite").write_bytes(b"damaged" * 1000)
    new = CampaignIndex(tmp_path / "index.sqlite")
    assert list(new.entries()) == []
    read_all(new, store)
    assert list(new.entries()) == list(index.entries())
    new.close()


def test_folder_in_place_of_the_index_is_named(tmp_path):
    (tmp_path / "index.sqlite").mkdir()
    with pytest.raises(SpecError, match=r"index\.sqlite"):
        CampaignIndex(tmp_path / "index.sqlite")


def test_full_disk_does_not_stop_the_index(store, plan, index, exact, tmp_path):
    """It knows all the same; the next one reads from the store what was not kept."""
    index._connection.execute("INSERT INTO entries VALUES ('of another time', '', ?)", ("x" * 3000,))
    index._connection.commit()
    pages = index._connection.execute("PRAGMA page_count").fetchone()[0]
    index._connection.execute(f"PRAGMA max_page_count = {pages}")
    change_labels(store, plan.campaign_id, LabelChange(note="x" * 2000))
    read_all(index, store)
    assert index.entry(plan.campaign_id).note.startswith("xxx")
    again = CampaignIndex(tmp_path / "index.sqlite")
    assert again.entry(plan.campaign_id) is None
    read_all(again, store)
    assert again.entry(plan.campaign_id) == index.entry(plan.campaign_id)
    again.close()


def test_index_is_closed_when_no_thread_writes(store, plan, index):
    """SQLite reads freed memory, and ends the process, where its file is closed while another thread writes."""
    writing, order = threading.Event(), []

    def slow(statement):
        writing.set()
        if closing.running():
            order.append(statement)

    with ThreadPoolExecutor(2) as threads:
        closing = threads.submit(lambda: (writing.wait(PATIENCE), index.close(), order.append("closed")))
        until(closing.running, "who closes is there")
        index._connection.set_trace_callback(slow)
        threads.submit(read_all, index, store).result(PATIENCE)
        closing.result(PATIENCE)
    assert order[-1] == "closed"
    assert any("COMMIT" in statement for statement in order)


def test_reader_that_ends_after_the_index_was_closed(store, plan, index, monkeypatch):
    reading, go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(
        "clearcap.web.index.entry_of", lambda s, c: (reading.set(), go_on.wait(PATIENCE), entry_of(s, c))[2]
    )
    with ThreadPoolExecutor(1) as thread:
        late = thread.submit(read_all, index, store)
        assert reading.wait(PATIENCE)
        index.close()
        go_on.set()
        late.result(PATIENCE)
    assert index.entry(plan.campaign_id) is not None


def test_no_thread_reads_the_store_after_the_end(store, index, monkeypatch):
    """Who ends the watcher waits for the look that is under way; a change that comes later is no error."""
    reading, go_on = threading.Event(), threading.Event()
    monkeypatch.setattr(
        "clearcap.web.index.entry_of", lambda s, c: (reading.set(), go_on.wait(PATIENCE), entry_of(s, c))[2]
    )

    others = set(threading.enumerate())  # of watchers of other tests, idle

    async def begin_and_end():
        watcher = Watcher(store, index)
        looking = asyncio.create_task(watcher.run())
        assert await asyncio.to_thread(reading.wait, PATIENCE)
        looking.cancel()
        for _ in range(100):
            await asyncio.sleep(0)
        has_waited = not looking.done()
        go_on.set()
        with pytest.raises(asyncio.CancelledError):
            await looking
        assert has_waited
        new = set(threading.enumerate()) - others
        return watcher, [each.name for each in new if each.name.startswith("store-reader")]

    watcher, threads = asyncio.run(begin_and_end())
    assert threads == []
    watcher.hurry()


def test_index_forgets_what_is_gone(store, plan, index):
    read_all(index, store)
    store.files.remove_tree(plan.campaign_id)
    read_all(index, store)
    assert list(index.entries()) == []


def test_a_deletion_at_work_does_not_disturb_others(store, plan, index):
    """The store is listed, without the campaign; a deletion that nobody is at is finished."""
    other = make_plan(load_campaign("c60", samples=5))
    store.create_plan(other)
    watcher = Watcher(store, index)
    with hold_lease(store, plan.campaign_id):
        store.files.move(f"{plan.campaign_id}/{PLAN}", f"{plan.campaign_id}/{DELETED}")
        asyncio.run(watcher.list_campaigns())
        assert [entry.campaign for entry, _ in index.entries()] == [other.campaign_id]
    asyncio.run(watcher.list_campaigns())
    assert store.folders() == [other.campaign_id]


async def _seen(watcher, campaign, state):
    """Wait until a campaign that is followed was seen in a state."""
    await until_true(lambda: getattr(watcher._feeds[campaign].latest, "state", "") == state, state)


def test_followers_of_a_served_store_hear_how_it_goes_on(store, plan, index, quick):
    """A coordinator that died is started again, and the report is written after the last row: neither is the end."""

    async def act(watcher, _):
        await _seen(watcher, plan.campaign_id, "interrupted")
        write_state(store, plan.campaign_id, "completed", is_open=True)
        await _seen(watcher, plan.campaign_id, "completed")
        close_campaign(store, plan.campaign_id)

    write_state(store, plan.campaign_id, "running")  # and nobody has the lease
    events = _followed(store, index, plan.campaign_id, act, is_served=True)
    told = [(_data(event)["state"], _data(event)["over"]) for event in events[:-1]]
    assert [each for each, _ in groupby(told)] == [("interrupted", False), ("completed", False), ("completed", True)]
    assert events[-1] == b"event: end\ndata: {}\n\n"


def test_followers_of_other_stores_hear_of_the_interruption(store, plan, index, quick):
    """Nobody is known who would go on."""

    async def act(*_):
        pass

    write_state(store, plan.campaign_id, "running")
    events = _followed(store, index, plan.campaign_id, act)
    assert [_data(event).get("state") for event in events] == ["interrupted", None]


def _followed(store, index, campaign, act, last="", most=10, is_served=False):
    """Return the events of a campaign that is followed while `act` changes it."""

    async def follow():
        watcher = Watcher(store, index, is_served=is_served)
        looking = asyncio.create_task(watcher.run())
        events = []
        acting = asyncio.create_task(act(watcher, events))
        async for event in watcher.follow(campaign, last):
            events.append(event)
            if len(events) == most:
                break
        await acting
        assert watcher.followers == 0
        looking.cancel()
        return [event for event in events if event.startswith((b"id", b"event"))]

    return asyncio.run(follow())


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(watching, "LOOK_EVERY", 0.02)


def _data(event):
    return json.loads(event.decode().split("data: ")[1])


def test_follower_hears_each_change_once(store, plan, index, quick, monkeypatch):
    """However often the store is looked at."""
    looks = []
    monkeypatch.setattr(watching, "observe", lambda *what: (looks.append(what), observe(*what))[1])

    async def act(watcher, _):
        await _seen(watcher, plan.campaign_id, "queued")
        await until_true(lambda: len(looks) > 4, "looks at what has not changed")
        write_state(store, plan.campaign_id, "cancelled", "by a test")

    write_state(store, plan.campaign_id, "queued")
    events = _followed(store, index, plan.campaign_id, act)
    assert [_data(event).get("state") for event in events] == ["queued", "cancelled", None]
    assert _data(events[-2])["message"] == "by a test"
    assert events[-1] == b"event: end\ndata: {}\n\n"


def test_follower_that_comes_back_hears_what_is_new(finished, index, quick):
    async def act(*_):
        pass

    events = _followed(*finished[:1], index, finished[1], act)
    assert [_data(event).get("state") for event in events] == ["completed", None]
    last = events[0].decode().split("\n")[0].removeprefix("id: ")
    assert _followed(finished[0], index, finished[1], act, last) == [b"event: end\ndata: {}\n\n"]


def test_change_during_a_listing_is_listed_too(store, plan, index, quick):
    """What somebody changes while the store is looked at may have been looked at before."""

    async def list_and_change():
        watcher = Watcher(store, index)
        read_some = index.read_some

        def read_and_change(*arguments):
            read_some(*arguments)
            index.read_some = read_some
            write_state(store, plan.campaign_id, "cancelled")
            watcher.hurry()

        write_state(store, plan.campaign_id, "completed")
        index.read_some = read_and_change
        looking = asyncio.create_task(watcher.run())
        await until_true(lambda: watcher.listed_at is not None, "a whole look")
        looking.cancel()
        return index.entry(plan.campaign_id).state

    assert asyncio.run(list_and_change()) == "cancelled"


def test_change_made_here_is_looked_at_alone(store, plan, index, monkeypatch):
    """Others are looked at in their turn; one that is gone is forgotten."""
    listed = []
    monkeypatch.setattr(watching, "change_tokens", lambda store: (listed.append("all"), change_tokens(store))[1])
    states = []

    async def change():
        watcher = Watcher(store, index)
        looking = asyncio.create_task(watcher.run())
        await until_true(lambda: watcher.listed_at is not None, "a whole look")
        for state in ("cancelled", "failed"):
            write_state(store, plan.campaign_id, state)
            watcher.hurry(plan.campaign_id)
            await watcher.list_campaigns()
            states.append(index.entry(plan.campaign_id).state)
        store.files.remove_tree(plan.campaign_id)
        await watcher.list_campaigns(plan.campaign_id)
        looking.cancel()

    write_state(store, plan.campaign_id, "completed")
    monkeypatch.setattr(watching, "LIST_EVERY", 1e9)
    asyncio.run(change())
    assert states == ["cancelled", "failed"]
    assert index.entry(plan.campaign_id) is None
    assert listed == ["all"]


def test_streams_end_with_the_server(store, plan, index, quick):
    async def act(watcher, events):
        await until_true(lambda: any(each.startswith(b"id") for each in events), "the first event")
        watcher.end_streams()

    write_state(store, plan.campaign_id, "queued")
    assert len(_followed(store, index, plan.campaign_id, act)) == 1
