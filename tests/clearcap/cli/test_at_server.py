"""Verbs that ask a server: the words and documents are those of a store."""

import json

import pytest

from clearcap.web.access import Role
from tests.campaign.commands import clearcap_here
from tests.clearcap.client.conftest import finished as finished  # a fixture
from tests.clearcap.client.conftest import live_server as live_server  # a fixture


@pytest.fixture
def ask(live_server, capsys, monkeypatch):
    """Return what runs a verb at a server, and one that runs it on the same server's store."""
    service, address = live_server
    _, secret = service.tokens.add("engineer", "test", Role.ENGINEER, 3600.0)
    monkeypatch.setenv("CLEARCAP_TOKEN", secret)
    monkeypatch.delenv("CLEARCAP_STORE", raising=False)

    def run(*words, at="server"):
        place = ("--server", address) if at == "server" else ("--store", service.settings.store)
        return clearcap_here(capsys, monkeypatch, *words, *place)

    return run


@pytest.mark.parametrize("verb", ["status", "list", "watch"])
def test_same_document_as_of_the_store(ask, finished, verb):
    words = [verb, *([] if verb == "list" else [finished]), "--json"]
    (code, output, _), (_, of_store, _) = ask(*words), ask(*words, at="store")
    assert code == 0
    document, same = json.loads(output), json.loads(of_store)
    assert document == same or verb == "watch"
    assert (document[0] if verb == "list" else document).keys() == (same[0] if verb == "list" else same).keys()


def test_same_words_as_of_the_store(ask, finished):
    assert ask("status", finished)[1] == ask("status", finished, at="store")[1]
    assert ask("list")[1] == ask("list", at="store")[1]


def test_submit_cancel_resume_report(ask, finished, tmp_path):
    code, output, said = ask("submit", "c60", "--samples", "6", "--tag", "night")
    assert code == 0, said
    campaign_id = output.strip()
    assert f"campaign {campaign_id}: 6 samples, server http://127.0.0.1" in said
    document = json.loads(ask("submit", "c60", "--samples", "6", "--json")[1])
    assert (document["campaign"], document["samples"], document["driver"]) == (campaign_id, 6, "service")
    assert json.loads(ask("cancel", campaign_id, "--json")[1])["before"] == "queued"
    assert "continue it with: clearcap resume" in ask("status", campaign_id)[1]
    assert "--server http://127.0.0.1" in ask("status", campaign_id)[1]
    assert json.loads(ask("resume", campaign_id, "--json")[1])["campaign"] == campaign_id
    code, output, _ = ask("report", finished, "--folder", tmp_path / "here", "--json")
    assert json.loads(output)["report"]["html"] == str(tmp_path / "here" / "report.html")
    assert (tmp_path / "here" / "report.html").read_text() == "<p>Cpk 1.33</p>"


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("status", "--store", "runs"), "--server, --store: both are given"),
        (("submit", "c60", "--workers", "2"), "decides where and in which batches"),
        (("submit", "c60", "--batch-size", "2"), "decides where and in which batches"),
        (("report", "--pdf"), "leave out --against"),
        (("report", "--pool", "c60"), "leave out --against"),
    ],
)
def test_what_a_server_is_not_asked(ask, words, fault):
    code, _, said = ask(*words)
    assert (code, fault in said) == (2, True)


def test_an_option_goes_before_the_environment(ask, finished, live_server, monkeypatch):
    _, address = live_server
    monkeypatch.setenv("CLEARCAP_SERVER", "https://nowhere.invalid")
    assert ask("status", finished, at="store")[0] == 0
    monkeypatch.setenv("CLEARCAP_SERVER", address)
    monkeypatch.setenv("CLEARCAP_STORE", "/nowhere")
    code, _, said = ask("status", finished)
    assert code == 0, said
