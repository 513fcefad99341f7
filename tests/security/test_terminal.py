"""Texts that others wrote reach the terminal without what it obeys; odd documents break nothing but themselves."""

import json
import unicodedata

import pytest
from rich.console import Console
from typer.testing import CliRunner

from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import this_process
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from clearcap.cli import app
from clearcap.cli.output import INVISIBLE, line, print_json, print_table, say, view, visible
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill
from tests.counts import some

HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\x7f\r\x00\u202egnp.exe\u2066\u200b\ufeff\u2028 [bold]x[/nothing] :smile:"


def is_harmless(text):
    """Return whether a text holds nothing that a terminal obeys or hides, but the ends of its lines."""
    return not [char for char in text if unicodedata.category(char) in INVISIBLE and char != "\n"]


def hostile_plan(campaign_file, title):
    """Return the plan of a campaign with a hostile title."""
    escaped = json.dumps(title).replace("\x7f", "\\u007F")
    text = campaign_file.read_text().replace('name = "demo"', f'name = "demo"\ntitle = {escaped}')
    campaign_file.write_text(text)
    return make_plan(load_campaign(str(campaign_file)), 10)


def test_each_character(capsys):
    """All of Unicode: what is visible stays, the rest is an escape; JSON reads back what was written."""
    for code in range(0x110000):
        char = chr(code)
        shown = visible(char)
        assert is_harmless(shown)
        assert shown.isascii() == (char.isascii() or shown != char)
    texts = [chr(code) for code in (*range(0x20, 0xA1), 0x202E, 0x2028, 0x200B, 0xFEFF, 0xE0041, 0x1F600)]
    print_json({"text": texts, "nested": [{"\x9b": HOSTILE}]})
    output = capsys.readouterr().out
    assert is_harmless(output)
    assert json.loads(output) == {"text": texts, "nested": [{"\x9b": HOSTILE}]}


def test_messages_and_tables(capsys, monkeypatch):
    """A message cannot begin another one; a table reads no markup, in titles, heads and cells."""
    monkeypatch.setenv("COLUMNS", "300")
    say(f"no {HOSTILE}\nclearcap: all is well")
    print_table(HOSTILE, (HOSTILE, "n"), [(HOSTILE, "1")], texts=1)
    output, messages = capsys.readouterr()
    assert is_harmless(output + messages)
    assert "\nclearcap:" not in messages
    assert "[bold]x[/nothing] :smile:" in messages
    assert output.count("[bold]") == 3


def test_title_in_list_and_status(store, campaign_file, capsys, monkeypatch):
    """A title is stored as it is, and listed with escapes in place of its control characters."""
    title = HOSTILE + "\nsecond line"
    plan = hostile_plan(campaign_file, title)
    store.create_plan(plan)
    store.write_json(plan.campaign_id, "state.json", {"state": "failed", "message": HOSTILE})
    assert store.plan(plan.campaign_id).spec.title == title
    for verb in ("list", "status", "watch"):
        words = [verb, *([] if verb == "list" else [plan.campaign_id]), "--store", store.url]
        code, output, messages = clearcap_here(capsys, monkeypatch, *words)
        assert code == 0, messages
        assert is_harmless(output + messages)
    code, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url, "--json")
    assert is_harmless(output)
    assert title in [entry["title"] for entry in json.loads(output)]


@pytest.mark.processes
def test_title_where_a_campaign_is_computed(faked, campaign_file):
    """Progress, results and the title of their table."""
    hostile_plan(campaign_file, HOSTILE)
    done = CliRunner().invoke(app, ["run", str(campaign_file), "--workers", "1", "--no-report"])
    assert done.exit_code == 0, done.output
    assert is_harmless(done.output)
    assert "[bold]x[/nothing]" in done.output.replace("\n", "")


def test_options(capsys, monkeypatch, tmp_path):
    """What a user was made to paste is refused before a message repeats it."""
    for words in (["run", f"c60{HOSTILE[:12]}"], [f"--{HOSTILE[:12]}"], ["status", "--store", "a\u202eb"]):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", ["clearcap"])
        code, output, messages = clearcap_here(capsys, monkeypatch, *[word.replace("\x00", "") for word in words])
        assert (code, output) == (2, "")
        assert is_harmless(messages)


def test_heartbeat_on_a_terminal():
    """State and names of responses, in the live view and in lines."""
    response = {"n": 3, "mean": 1.0, "std": 1.0, "cpk": 1.0}
    counts = dict.fromkeys(("samples", "done", "ok", "failed", "left", "workers"), 1)
    told = Heartbeat("a", HOSTILE, **counts, statuses={}, rate=1.0, eta_s=1e308, responses={HOSTILE: response})
    assert is_harmless(line(told))
    console = Console(width=300, force_terminal=False)
    with console.capture() as captured:
        console.print(view(told))
    assert is_harmless(captured.get())
    assert "[bold]x[/nothing]" in captured.get()


ODD = {
    "since as text": {"state": "completed", "since": "yesterday"},
    "since too late": {"state": "completed", "since": 1e308},
    "since negative": {"state": "completed", "since": -1e18},
    "since no number": {"state": "completed", "since": float("nan")},
    "since a list": {"state": "completed", "since": [1, 2]},
    "since a truth": {"state": "completed", "since": True},
    "state a list": {"state": ["running"], "since": 1.0},
    "state of another kind": {"state": "sleeping"},
    "message a table": {"state": "failed", "message": {"a": [HOSTILE]}},
}


@pytest.mark.parametrize("odd", some(ODD.values()), ids=some(ODD))
def test_odd_state(store, plan, campaign_file, capsys, monkeypatch, odd):
    """All campaigns are listed, and of the odd one what is odd; so says its status, and whoever watches it."""
    other = make_plan(load_campaign(str(campaign_file), seed=1), 10)
    store.create_plan(other)
    fill(store, other)
    store.files.write(f"{other.campaign_id}/state.json", json.dumps(odd).encode())
    code, output, messages = clearcap_here(capsys, monkeypatch, "list", "--store", store.url, "--json")
    entries = {entry["campaign"]: entry for entry in json.loads(output)}
    assert (code, set(entries)) == (0, {plan.campaign_id, other.campaign_id})
    assert "state.json says " in entries[other.campaign_id]["fault"]
    assert entries[plan.campaign_id]["fault"] is None
    for verb in ("list", "status", "watch"):
        words = [verb, *([] if verb == "list" else [other.campaign_id]), "--store", store.url]
        code, output, messages = clearcap_here(capsys, monkeypatch, *words)
        assert code == 0
        assert "state.json says " in messages
        assert is_harmless(output + messages)


BEAT = {
    **dict.fromkeys(("samples", "done", "ok", "failed", "left", "workers"), 1),
    **{"campaign": "a", "state": "running", "statuses": {}, "rate": 1.0, "eta_s": 1.0},
}
ODD_BEATS = {
    "eta too long": {"eta_s": 1e400},
    "eta a text": {"eta_s": "soon"},
    "rate none": {"rate": None},
    "rate a text": {"rate": HOSTILE},
    "workers a table": {"workers": {}},
    "statuses a list": {"statuses": [1]},
    "responses of numbers": {"responses": {"FC-1": 3}},
    "response without a number": {"responses": {"FC-1": {"cpk": 1.0}}},
    "key unknown": {"weather": "fine"},
    "done negative": {"done": -1},
}


@pytest.mark.parametrize("odd", some(ODD_BEATS.values()), ids=some(ODD_BEATS))
def test_odd_heartbeat(store, plan, capsys, monkeypatch, odd):
    """The status of a running campaign, without the heartbeat that cannot be one."""
    store.write_json(plan.campaign_id, "state.json", {"state": "running", "since": 1.0})
    store.write_json(plan.campaign_id, "lease.json", {"token": "a", **this_process()})
    store.files.write(f"{plan.campaign_id}/heartbeat.json", json.dumps(BEAT).encode())
    code, output, messages = clearcap_here(capsys, monkeypatch, "status", "--store", store.url)
    assert (code, "1.0 runs/s on 1 worker, ETA 0:00:01" in output) == (0, True)
    store.files.write(f"{plan.campaign_id}/heartbeat.json", json.dumps(BEAT | odd).encode())
    code, output, messages = clearcap_here(capsys, monkeypatch, "status", "--store", store.url)
    assert code == 0
    assert "heartbeat.json was not written by clearcap" in messages
    assert "0 of 25 done" in output


def test_odd_lease(store, plan, capsys, monkeypatch):
    """A lease whose process number is none, or infinite."""
    for pid in (1e400, float("nan"), "x", [], None, -1, 10**30):
        lease = {"token": "a", **this_process(), "pid": pid}
        store.files.write(f"{plan.campaign_id}/lease.json", json.dumps(lease).encode())
        store.write_json(plan.campaign_id, "state.json", {"state": "running", "since": 1.0})
        code, output, _ = clearcap_here(capsys, monkeypatch, "list", "--store", store.url, "--json")
        assert (code, json.loads(output)[0]["state"]) == (0, "interrupted")
