"""A scheduler that is lost: for how long it is tried again, and what the heartbeat says in the meantime."""

from concurrent.futures import Future
from contextlib import contextmanager
from itertools import pairwise
from types import SimpleNamespace

import pytest

from campaign.cluster.workers import SchedulerLost
from campaign.coordinator import coordinate as coordinating
from campaign.coordinator import dispatch
from campaign.coordinator.coordinate import RECONNECTS_FOR, STEADY_AFTER, Coordinator
from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import STALE_AFTER, hold_lease
from campaign.coordinator.submit import submit
from campaign.errors import StoreError, UnreachableError
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.files.files import Files
from campaign.store.layout import CANCEL, HEARTBEAT
from campaign.worker.messages import Cancelled
from tests.campaign import fake_engine
from tests.until import until


class Flapping:
    """Workers of a scheduler that is lost after some calls; each needs ``seconds`` of the clock."""

    name = "a test"

    def __init__(self, clock, calls, seconds=0.0):
        self._clock, self._left, self._seconds, self._waiting = clock, calls, seconds, []

    def count(self):
        """Return one, until it is lost."""
        if self._left == 0:
            self._clock.sleep(self._seconds)
            raise SchedulerLost("client closed")
        return 1

    def submit(self, key, function, *arguments):
        """Compute at once."""
        future = Future()
        future.set_result(function(*arguments))
        self._waiting.append(future)
        return future

    def next_finished(self, timeout):
        """Return a call; later the scheduler is lost."""
        if self._left == 0:
            raise SchedulerLost("connection closed")
        self._left -= 1
        self._clock.sleep(self._seconds)
        return self._waiting.pop(0)

    def waits(self):
        """Miss nobody."""
        return []

    def expect(self, calls):
        """Do nothing."""

    def cancel(self):
        """Forget all."""
        self._waiting = []


@pytest.fixture
def clock(monkeypatch):
    """Return the clock of the coordinator, which moves when it sleeps."""
    clock = SimpleNamespace(now=5000.0, monotonic=lambda: clock.now, time=lambda: 1e9 + clock.now)
    clock.sleep = lambda seconds: setattr(clock, "now", clock.now + seconds)
    for module in (coordinating, dispatch):
        monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture
def campaign(tmp_path, campaign_file, clock):
    """Return a coordinator of 25 samples in batches of 5, and its heartbeats with the times of the clock."""
    store, beats = open_store(str(tmp_path / "runs")), []
    plan = submit(store, load_campaign(str(campaign_file)), 5)
    with hold_lease(store, plan.campaign_id) as token:
        yield Coordinator(store, plan, token, lambda beat: beats.append((clock.now, beat)), fake_engine.simulate), beats


def connecting(clock, *calls, seconds=0.0):
    """Return what connects to a scheduler that is lost after so many calls each time; the last number stays."""
    numbers = list(calls)

    @contextmanager
    def connect():
        yield Flapping(clock, numbers.pop(0) if len(numbers) > 1 else numbers[0], seconds)

    return connect


def test_one_that_accepts_and_is_lost_at_once_is_given_up(campaign, clock):
    """It has not come back: after ten minutes the campaign ends, and nobody takes its lease before."""
    coordinator, beats = campaign
    began = clock.now
    with pytest.raises(UnreachableError, match="gave up after 600 s"):
        coordinator.run(connecting(clock, 0))
    assert RECONNECTS_FOR < clock.now - began < RECONNECTS_FOR + 60.0
    times = [at for at, _ in beats]
    assert max(b - a for a, b in pairwise(times)) < STALE_AFTER / 2
    last = Heartbeat.from_json(coordinator.store.read_json(coordinator.plan.campaign_id, HEARTBEAT))
    assert (last.eta_s, last.workers) == (None, 0)
    assert last.waits_for.startswith("no scheduler for ")
    assert last.waits_for.endswith("(client closed)")


def test_losses_are_forgotten_when_something_was_computed(campaign, clock):
    """A call in between, however long ago the first loss was."""
    coordinator, _ = campaign
    coordinator.run(connecting(clock, 0, 0, 1, seconds=200.0))
    assert coordinator.queue.completed(25)


def test_losses_are_forgotten_when_the_connection_held(campaign, clock):
    """A batch may take longer than the scheduler lives; then nothing is finished, but it was there."""
    coordinator, _ = campaign
    coordinator.run(connecting(clock, *[0] * 12, 99, seconds=STEADY_AFTER + 10.0))
    assert coordinator.queue.completed(25)


def test_a_campaign_can_be_cancelled_without_its_scheduler(campaign, clock):
    """The pauses look at the store."""
    coordinator, _ = campaign
    coordinator.store.write_json(coordinator.plan.campaign_id, CANCEL, {})
    with pytest.raises(Cancelled):
        coordinator.run(connecting(clock, 0))


def test_connecting_takes_its_time_and_the_heartbeat_says_so(campaign, clock, monkeypatch):
    """Jobs and images take minutes: whoever asks sees that the campaign is being started."""
    monkeypatch.setattr(coordinating, "HEARTBEAT_INTERVAL", 0.01)
    coordinator, beats = campaign

    @contextmanager
    def connect():
        until(lambda: len(beats) > 2, "no heartbeat")
        yield Flapping(clock, 99)

    coordinator.run(connect)
    assert all(beat.waits_for.startswith("starting workers for ") for _, beat in beats[:3])
    coordinator.publish_heartbeat("running")
    assert not any(wait["what"] == "start" for wait in beats[-1][1].waiting)


@pytest.mark.parametrize("name", [HEARTBEAT, coordinating.PROBE])
def test_a_store_that_refuses_is_named_at_once(campaign, monkeypatch, name):
    """Also one that still takes a heartbeat but no part: then a file as large as a part is tried."""
    coordinator, beats = campaign
    write = Files.write

    def full(files, path, content):
        if path.endswith(name):
            raise StoreError(f"store runs: {path} cannot be written (No space left on device)")
        write(files, path, content)

    window = SimpleNamespace(look=lambda left: [], worker_count=1)
    monkeypatch.setattr("campaign.coordinator.heartbeat.STALLED", (0.0, -1.0))
    with monkeypatch.context() as patch:
        patch.setattr(Files, "write", full)
        for _ in range(3):
            coordinator._check(window)
        assert "the store has refused for" in beats[-1][1].waits_for
        assert "No space left" in beats[-1][1].waits_for
        assert beats[-1][1].eta_s is None
    coordinator._check(window)
    coordinator._check(window)
    coordinator._check(window)
    assert "store" not in {wait["what"] for wait in beats[-1][1].waiting}
    assert coordinating.PROBE not in coordinator.store.files.names(coordinator.plan.campaign_id)
