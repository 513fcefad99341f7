"""Who has joined, restarted or is lost: said once, with how many are left, and remembered for a while."""

import logging
from types import SimpleNamespace

import pytest

from campaign.cluster import workers as module
from campaign.cluster.workers import REMEMBERED, Roster


@pytest.fixture
def said(caplog):
    """Return what looks at workers, given as name and host by address, and returns the messages."""
    caplog.set_level(logging.INFO)
    roster = Roster()

    def look(present, refused=()):
        caplog.clear()
        roster.look(present, refused)
        return [record.getMessage() for record in caplog.records]

    look.roster = roster
    return look


A, B, C = {"tls://1:1": ("a", "n1")}, {"tls://2:1": ("b", "n2")}, {"tls://3:1": ("c", "n2")}


def test_the_first_look_only_takes_note(said):
    """The progress line has their number."""
    assert said(A | B) == []
    assert said(A | B) == []


def test_one_by_name_many_by_hosts(said):
    """Three hundred workers that join are one line."""
    assert said({}) == []
    assert said(A) == ["worker a on n1 joined, 1 now"]
    assert said(A | B | C) == ["2 workers (2 on n2) joined, 3 now"]
    assert said(A) == ["2 workers (2 on n2) are lost, 1 left"]
    assert said({}) == ["worker a on n1 is lost, 0 left"]
    many = {f"tls://{i}": (f"w{i}", f"n{i % 50}") for i in range(300)}
    [line] = said(many)
    assert line.startswith("300 workers (6 on n0, 6 on n1, ")
    assert line.endswith("the others on 46 hosts) joined, 300 now")


def test_who_comes_back_at_once_restarted(said):
    """A nanny starts the same worker at another address."""
    said(A | B)
    assert said({"tls://1:9": ("a", "n1")} | B) == ["worker a on n1 restarted"]
    assert said.roster.waits() == []


def test_refused_workers_are_not_counted(said):
    """They are of no use, whether they stay or not."""
    said(A | B)
    assert said(A, refused=B) == ["worker b on n2 is lost, 1 left"]
    assert said(A | C, refused=A) == ["worker c on n2 joined, 1 now"]


def test_workers_that_were_let_go_are_not_lost(said):
    """Who ends them has said so."""
    said(A | B)
    said.roster.release({"b"})
    assert said(A) == []
    assert said.roster.waits() == []


def test_a_lost_worker_is_a_fact_until_it_is_back(said, monkeypatch):
    """At another address too; and not for ever."""
    clock = SimpleNamespace(now=1e9, time=lambda: clock.now)
    monkeypatch.setattr(module, "time", clock)
    said(A | B)
    said(A)
    assert [(wait.what, wait.since, wait.detail) for wait in said.roster.waits()] == [("lost", 1e9, "worker b on n2")]
    said(A | {"tls://2:7": ("b", "n2")})
    assert said.roster.waits() == []
    said(A)
    clock.now += REMEMBERED + 1
    assert said.roster.waits() == []
