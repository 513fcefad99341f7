"""Verbs that ask a server: the words and documents are those of a store."""

import json

import pytest

from campaign.store.labels import LabelChange, change_labels
from campaign.store.measured_library import measured_parts
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
        place = {"server": ("--server", address), "store": ("--store", service.settings.store)}.get(at, ())
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


def test_measured_parts(ask, finished, live_server, tmp_path):
    """Report and summary are those that this machine makes; the server keeps them, and what it says of a campaign."""
    service, _ = live_server
    (tmp_path / "parts.csv").write_text("\n".join(["d", *(f"{20 + row % 7 / 1000}" for row in range(30))]))
    (tmp_path / "limits.toml").write_text('[characteristics.d]\nunit = "mm"\nlsl = 19.9\nusl = 20.1\n')
    words = ("capability", tmp_path / "parts.csv", "--limits", tmp_path / "limits.toml", "--no-excel", "--folder")
    said = {}
    for at, folder in (("server", "sent"), ("here", "kept")):
        code, said[at], fault = ask(*words, tmp_path / folder, at=at)
        assert code == 0, fault
    assert said["server"].replace("/sent/", "/kept/") == said["here"]
    names = ["capability.json", "capability.parquet", "report.html"]
    assert sorted(each.name for each in (tmp_path / "sent").iterdir()) == names
    assert len(measured_parts(service.store)) == 1
    rows = [f"{0.07 + 0.0002 * (7 * row % 61 - 30):.4f}" for row in range(61)]
    (tmp_path / "night.csv").write_text("\n".join(["J1", *rows]))
    change_labels(service.store, finished, LabelChange(owner="engineer"), by="test")
    answers = [ask("monitor", finished[:-2], tmp_path / "night.csv", "--json", at=at) for at in ("server", "store")]
    documents = [json.loads(output) for _, output, _ in answers]
    assert answers[0][0] == answers[1][0]
    # the server of this test is in this process: where another test has set up its log, that is among what is said
    assert set(answers[1][2].splitlines()) <= set(answers[0][2].splitlines())
    assert [each["number"] for each in documents] == [1, 1]  # the same lots, sent twice
    for key in ("settings", "variables", "responses", "sha256", "table"):
        assert documents[0][key] == documents[1][key]
    assert documents[0]["by"] == "engineer"


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("capability", __file__, "--limits", __file__, "--pdf"), "leave out --pdf"),
        (("status", "--store", "runs"), "--server, --store: both are given"),
        (("submit", "c60", "--workers", "2"), "the server decides where and in which batches"),
        (("submit", "c60", "--batch-size", "2"), "the server decides where and in which batches"),
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
