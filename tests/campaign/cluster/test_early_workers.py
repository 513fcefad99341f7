"""Workers that start before their campaign is planned: for the first who connects, and ended in any case."""

from contextlib import contextmanager

import pytest

from campaign.cluster import early_workers
from campaign.cluster.cluster import Cluster
from campaign.cluster.early_workers import EarlyWorkers
from campaign.coordinator.plan_campaign import plan_campaign
from campaign.errors import SpecError, UnreachableError


@pytest.fixture
def events(monkeypatch):
    """Have workers start and end in a list."""
    events = []

    @contextmanager
    def connect_workers(cluster):
        number = len(events)
        events.append(f"start {number}")
        try:
            yield number
        finally:
            events.append(f"end {number}")

    monkeypatch.setattr(early_workers, "connect_workers", connect_workers)
    return events


def test_first_to_connect_gets_them_and_ends_them(events):
    """Who connects again after a loss gets others; nothing is left at the end."""
    with EarlyWorkers(Cluster()) as early:
        early.begin()
        early.begin()
        with early.connect(Cluster()) as workers:
            assert workers == 0
        assert events == ["start 0", "end 0"]
        with early.connect(Cluster()) as workers:
            assert workers == 2
    assert events == ["start 0", "end 0", "start 2", "end 2"]


def test_nobody_connects(events):
    """Workers of a campaign whose planning fails are ended."""

    def plan(early):
        early.begin()
        raise SpecError("samples: none")

    with pytest.raises(SpecError), EarlyWorkers(Cluster()) as early:
        plan(early)
    assert events == ["start 0", "end 0"]


@pytest.mark.parametrize("cluster", [Cluster(scheduler="tcp://127.0.0.1:1"), Cluster(kind="slurm", workers=2)])
def test_only_processes_of_this_machine_start_early(events, cluster):
    """Jobs are submitted, and a scheduler is reached, when the plan is there."""
    with EarlyWorkers(cluster) as early:
        early.begin()
        assert events == []
        with early.connect(cluster) as workers:
            assert workers == 0


def test_whoever_connects_hears_why_they_did_not_start(monkeypatch):
    """An error of the start is raised where workers are needed, once; a campaign that needs none never hears of it."""
    failing = []

    @contextmanager
    def connect_workers(_):
        failing.append(True)
        raise UnreachableError("2 workers cannot be started on this machine")
        yield

    monkeypatch.setattr(early_workers, "connect_workers", connect_workers)
    with EarlyWorkers(Cluster()) as early:
        early.begin()
        with pytest.raises(UnreachableError, match="2 workers"), early.connect(Cluster()):
            pass
    assert failing == [True]


def test_faulty_campaign_starts_no_worker(tmp_path, campaign_file):
    """Only a campaign that is sound and new has workers start."""
    begun = []
    plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("new"))
    plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("again"))
    text = campaign_file.read_text(encoding="utf-8")
    campaign_file.write_text(text.replace("samples", "smaples", 1), encoding="utf-8")
    with pytest.raises(SpecError, match="smaples"):
        plan_campaign(str(campaign_file), str(tmp_path / "store"), when_new=lambda: begun.append("faulty"))
    assert begun == ["new"]
