"""Every method of the client, asked of a server on a port: it returns what store, engine or command say."""

import inspect
import json
from pathlib import Path

import pytest

import clearcap
from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.labels import LabelChange, change_labels
from clearcap.client.remote_server import RemoteServer
from clearcap.questions.mechanisms import mechanism_summary
from clearcap.web.access import Role
from engine import load_mechanism, simulate
from engine.mechanism import library_names
from tests.campaign.commands import clearcap_here
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.clearcap.web.conftest import write_real_report
from tests.until import until

SETTING = "J1.std=0.015"
VALUES = {"J1": 0.05}


def spec_file(folder):
    """Return the path of the finished campaign's file."""
    (folder / "demo.toml").write_text(SPEC)
    return str(folder / "demo.toml")


@pytest.fixture
def server(live_server):
    """Return a client with the token of an engineer, as `clearcap` makes it."""
    service, address = live_server
    _, secret = service.tokens.add("engineer", "test", Role.ENGINEER, 3600.0)
    with clearcap.connect(address, secret) as connected:
        assert connected.address == address
        yield connected


@pytest.fixture
def store(live_server):
    """Return the server's store."""
    return open_store(live_server[0].settings.store)


def check_rows(server, finished, store, tmp_path):
    table = store.table(finished)
    assert server.rows(finished).equals(table)
    chosen = ["sample", "FC-1"]
    assert server.rows(finished, chosen).equals(table.select(chosen))
    assert server.rows(finished, iter(chosen)).to_pandas().shape == (25, 2)


def check_download_report(server, finished, store, tmp_path):
    files = server.download_report(finished, tmp_path / "report")
    for name, file in files.items():
        assert file.read_bytes() == Path(store.url, finished, "report", name).read_bytes()


def check_what_if(server, finished, store, tmp_path):
    refused = server.what_if(finished, SETTING)["refused"]
    assert "100 are needed" in refused[0]["reason"]
    with pytest.raises(clearcap.SpecError, match="J99"):
        server.what_if(finished, "J99.std=1")


def check_simulate(server, finished, store, tmp_path):
    run = simulate(load_mechanism("c60"), VALUES, indeterminacy=True)
    answer = server.simulate("c60", VALUES)
    assert (answer["status"], answer["responses"], answer["units"]) == ("ok", run.measured, run.units)
    assert answer["certificate"]["steps"] == run.certificate.steps
    assert server.simulate("c60", preset="prototype")["responses"] != answer["responses"]
    with pytest.raises(clearcap.SpecError, match="J99"):
        server.simulate("c60", {"J99": 1.0})


def check_mechanism(server, finished, store, tmp_path):
    shown = server.mechanism("c60")
    summary = json.loads(json.dumps(mechanism_summary(load_mechanism("c60"))))
    assert {key: shown[key] for key in summary} == summary
    assert {"short": "J1", "value": 0.07}.items() <= next(e for e in shown["keys"] if e["short"] == "J1").items()


def check_mechanisms(server, finished, store, tmp_path):
    assert server.mechanisms() == {"shipped": library_names(), "saved": {}}


def check_status(server, finished, store, tmp_path):
    status = server.status(finished)
    assert (status["state"], status["done"], status["left"]) == ("completed", 25, 0)


def check_campaign(server, finished, store, tmp_path):
    assert server.campaign(finished)["title"] == "demo"


def check_campaigns(server, finished, store, tmp_path):
    # the server lists what others have added to its store a few seconds later
    until(lambda: sorted(entry["campaign"] for entry in server.campaigns(archived=True)) == store.campaigns())
    assert [entry["campaign"] for entry in server.campaigns(search="no such words")] == []


def check_find(server, finished, store, tmp_path):
    assert server.find(finished[:-2]) == server.find(finished) == finished


def check_events(server, finished, store, tmp_path):
    (event,) = server.events(finished)
    assert (event["campaign"], event["state"], event["over"]) == (finished, "completed", True)


def check_submit(server, finished, store, tmp_path):
    made = server.submit("c60", samples=6, tags=["night"])
    assert store.plan(made["campaign"]).spec.samples == 6
    assert server.submit("c60", samples=6)["is_new"] is False


def check_cancel(server, finished, store, tmp_path):
    made = server.submit("c60", samples=7)["campaign"]
    assert server.cancel(made)["before"] == "queued"
    assert server.status(made)["state"] == "cancelled"


def check_resume(server, finished, store, tmp_path):
    made = server.submit("c60", samples=8)["campaign"]
    server.cancel(made)
    assert server.resume(made)["campaign"] == made
    assert server.status(made)["state"] == "queued"


def check_label(server, finished, store, tmp_path):
    made = server.submit("c60", samples=9, tags=["old"])["campaign"]
    entry = server.label(made, add_tags=["new"], note="seen")
    assert (sorted(entry["tags"]), entry["note"], entry["owner"]) == (["new", "old"], "seen", "engineer")


def approver(server, live_server):
    """Return a client of another user, who may sign."""
    _, secret = live_server[0].tokens.add("approver", "test", Role.APPROVER, 3600.0)
    return clearcap.connect(server.address, secret)


def check_signable(server, finished, store, tmp_path):
    with pytest.raises(clearcap.SpecError, match="role"):
        server.signable(finished)


def check_sign(server, finished, store, tmp_path):
    with pytest.raises(clearcap.SpecError, match="role"):
        server.sign(finished, "0f" * 32)


def check_pool(server, finished, store, tmp_path):
    there = computed(store.url, load_campaign(spec_file(tmp_path), seed=8), 10)[1].campaign_id
    files = server.pool(finished, [there], tmp_path / "pooled")
    for name, file in files.items():
        assert file.read_bytes() == Path(store.url, finished, "pooled", there, name).read_bytes()
    assert "report.html" in files
    with pytest.raises(clearcap.SpecError, match="seed = 7"):
        server.pool(finished, [finished], tmp_path)


def check_capability(server, finished, store, tmp_path):
    (tmp_path / "lever.csv").write_text("\n".join(["d", *(f"{20 + row % 7 / 1000}" for row in range(30))]))
    (tmp_path / "limits.toml").write_text('[characteristics.d]\nunit = "mm"\nlsl = 19.9\nusl = 20.1\n')
    made = server.capability(tmp_path / "lever.csv", tmp_path / "limits.toml", tmp_path / "report")
    assert (made["file"], made["parts"], made["by"]) == ("lever.csv", 30, "engineer")
    for name, file in made["report"].items():
        assert file.read_bytes() == Path(store.url, "measured", made["id"], name).read_bytes()
    assert "report.html" in made["report"]
    few = server.capability(str(tmp_path / "lever.csv"), tmp_path / "limits.toml", tmp_path / "few", ["report.html"])
    assert (few["id"], [*few["report"]]) == (made["id"], ["report.html"])
    with pytest.raises(clearcap.SpecError, match=r"nothing\.csv: cannot be read"):
        server.capability(tmp_path / "nothing.csv", tmp_path / "limits.toml", tmp_path)


def check_monitor(server, finished, store, tmp_path):
    rows = [f"{0.04 + row / 1000},{0.05 + row / 1000}" for row in range(61)]
    (tmp_path / "night.csv").write_text("\n".join(["J1,bore", *rows]))
    with pytest.raises(clearcap.SpecError, match="owner"):
        server.monitor(finished, tmp_path / "night.csv")
    change_labels(store, finished, LabelChange(owner="engineer"), by="test")
    found = server.monitor(finished, tmp_path / "night.csv")
    assert (found["table"], found["variables"][0]["variable"]) == ("night.csv", "J1")
    limits = tmp_path / "limits.toml"
    limits.write_text('[characteristics.J1]\ncolumn = "bore"\n')
    again = server.monitor(finished, str(tmp_path / "night.csv"), limits)
    assert (again["number"], again["variables"][0]["variable"]) == (found["number"] + 1, "J1")
    assert again["settings"] != found["settings"]


def check_close(server, finished, store, tmp_path):
    server.close()
    with pytest.raises(RuntimeError, match="closed"):
        server.mechanisms()


CHECKS = {name.removeprefix("check_"): check for name, check in globals().items() if name.startswith("check_")}


def test_every_method_is_checked():
    """A new method needs a check above; one that is gone, none."""
    methods = {name for name, _ in inspect.getmembers(RemoteServer, inspect.isfunction) if not name.startswith("_")}
    assert set(CHECKS) == methods


@pytest.mark.processes
@pytest.mark.parametrize("name", CHECKS)
def test_method(name, server, finished, store, tmp_path):
    CHECKS[name](server, finished, store, tmp_path)


@pytest.mark.processes
def test_an_approver_signs_what_he_has_read(server, live_server, store, tmp_path):
    """What is signed is the content that was shown; with another report nothing is signed."""
    service, _ = live_server
    _, plan = computed(store.url, load_campaign(spec_file(tmp_path), seed=9), 10)
    write_state(store, plan.campaign_id, "completed")
    with approver(server, live_server) as signer:
        with pytest.raises(clearcap.CampaignError, match="no report"):
            signer.sign(plan.campaign_id, signer.signable(plan.campaign_id)["content"])
        write_real_report(service, plan.campaign_id)
        seen = signer.signable(plan.campaign_id)
        with pytest.raises(clearcap.CampaignError):
            signer.sign(plan.campaign_id, "0f" * 32)
        signed = signer.sign(plan.campaign_id, seen["content"], "as drawn")
    assert (signed["signer"], signed["comment"]) == ("approver", "as drawn")
    assert {key: signed[key] for key in ("plan", "rows", "report")} == {
        key: seen[key] for key in ("plan", "rows", "report")
    }
    assert service.signing_service.is_signed(plan.campaign_id)


@pytest.mark.processes
def test_what_if_is_that_of_the_command(server, store, tmp_path, capsys, monkeypatch):
    """The same document, number by number, of as many samples as an answer needs."""
    (tmp_path / "many.toml").write_text(SPEC.replace('"demo"', '"many"'))
    _, plan = computed(store.url, load_campaign(str(tmp_path / "many.toml"), samples=400), 200)
    words = ("whatif", plan.campaign_id, "--set", SETTING, "--json", "--store", store.url)
    code, output, said = clearcap_here(capsys, monkeypatch, *words)
    assert code == 0, said
    document = json.loads(output)
    assert document["responses"]
    assert server.what_if(plan.campaign_id, SETTING) == document
