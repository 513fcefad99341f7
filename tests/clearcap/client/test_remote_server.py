"""What a program asks a server, and what it is told."""

import pytest

from campaign.errors import SpecError, UnreachableError
from clearcap.client.remote_server import RemoteServer, connect


@pytest.mark.processes
def test_a_campaign_with_its_files_is_sent_once(remote, tmp_path):
    (tmp_path / "gaps.csv").write_text("gap\n0.05\n0.06\n0.08\n")
    file = tmp_path / "own.toml"
    text = '\n[variables.J1]\ndistribution = "empirical"\nfile = "./gaps.csv"\ncolumn = "gap"\n'
    file.write_text(f'format = 1\nname = "own"\nmechanism = "c60"\nsamples = 12\n{text}')
    made = remote.submit(file, samples=7, tags=["night"], key="one")
    assert (made["is_new"], made["samples"], made["owner"]) == (True, 7, "engineer")
    assert remote.submit(file, samples=7, tags=["night"], key="one") == made
    entry = remote.campaign(made["campaign"])
    assert (entry["state"], entry["tags"]) == ("queued", ["night"])
    assert remote.find("own") == made["campaign"]
    assert remote.label(made["campaign"], note="of Monday")["note"] == "of Monday"
    assert remote.cancel(made["campaign"])["before"] == "queued"
    assert remote.status(made["campaign"])["state"] == "cancelled"
    assert remote.resume(made["campaign"])["note"] == "queued"


@pytest.mark.processes
def test_a_file_elsewhere_is_not_sent(remote, tmp_path):
    folder = tmp_path / "theirs"
    folder.mkdir()
    (tmp_path / "secret.csv").write_text("gap\n1\n")
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    for name in ("../secret.csv", str(tmp_path / "secret.csv"), "link.csv"):
        (folder / "theirs.toml").write_text(
            f'format = 1\nname = "x"\nmechanism = "c60"\n[variables.J1]\nfile = "{name}"\ncolumn = "gap"\n'
        )
        with pytest.raises(SpecError, match=r"variables\.J1\.file"):
            remote.submit(folder / "theirs.toml")


@pytest.mark.processes
def test_faults_come_back_as_faults(remote):
    with pytest.raises(SpecError, match="samples") as refused:
        remote.submit({"format": 1, "name": "x", "mechanism": "c60", "samples": 0})
    assert ("samples",) in [fault.keys for fault in refused.value.faults]


@pytest.mark.processes
def test_list_report_and_events(remote, finished, tmp_path):
    assert finished in [entry["campaign"] for entry in remote.campaigns(state="completed")]
    events = list(remote.events(finished))
    assert [(event["state"], event["over"]) for event in events] == [("completed", True)]
    files = remote.download_report(finished, tmp_path / "report")
    assert sorted(files) == ["capability.json", "report.html"]
    assert files["report.html"].read_text() == "<p>Cpk 1.33</p>"
    assert not list((tmp_path / "report").glob("*.partial"))
    with pytest.raises(SpecError, match="no campaign nothing"):
        remote.campaign("nothing-0")


@pytest.mark.processes
def test_pages_of_the_list_are_asked_one_by_one(remote, finished, monkeypatch):
    made = remote.submit("c60", samples=5)
    monkeypatch.setattr("clearcap.client.remote_server.ON_A_PAGE", 1)
    known = [entry["campaign"] for entry in remote.campaigns(sort="title")]
    assert {finished, made["campaign"]} <= set(known)
    assert len(known) == len(set(known))
    with pytest.raises(SpecError, match="name the campaign"):
        remote.find()


def test_what_decides_another_campaign_is_meant_by_its_own_id_only(monkeypatch):
    listed = {"c60-1": ["c60-rare-1", "c60-rare-2"], "c60-rare-1": [], "c60-rare-2": [], "lever-1": []}
    entries = [{"campaign": campaign, "decided_by": aimed} for campaign, aimed in listed.items()]
    monkeypatch.setattr(RemoteServer, "campaigns", lambda self, search, archived: iter(entries))
    with connect("http://127.0.0.1:9", token="unused") as remote:
        assert remote.find("c60") == "c60-1"
        assert remote.find("c60-rare-2") == "c60-rare-2"
        for unclear in ("c60-rare", None):
            with pytest.raises(SpecError):
                remote.find(unclear)


@pytest.mark.processes
def test_mechanisms(remote):
    assert "clearance_pendulum" in remote.mechanisms()["shipped"]
    with pytest.raises(SpecError, match="no mechanism nothing"):
        remote.simulate("nothing")


def test_a_server_that_is_away(monkeypatch):
    monkeypatch.setattr("clearcap.client.server_connection.time.sleep", lambda _: None)
    with connect("http://127.0.0.1:9", "clearcap_token_x") as nobody, pytest.raises(UnreachableError, match="later"):
        nobody.mechanisms()


@pytest.mark.processes
def test_a_wrong_token_is_not_quoted(live_server):
    with connect(live_server[1], "clearcap_token_wrong") as stranger:
        with pytest.raises(SpecError, match="another on the server's page Account") as refused:
            stranger.mechanisms()
        assert "wrong" not in f"{refused.value}{stranger.connection!r}"
