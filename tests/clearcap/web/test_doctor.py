"""What an operator asks a store and the folder of its server: each fault is found, with its remedy; nothing changes."""

import json
import sqlite3
import time
from contextlib import closing

import pytest
from typer.testing import CliRunner

from campaign.coordinator.state import write_state
from clearcap.cli import app
from clearcap.web import maintenance
from clearcap.web.access.database import DATABASE, Database
from clearcap.web.maintenance import FAULT, KEY_FILE, OK, WARNING, examine
from clearcap.web.settings import Settings
from clearcap.web.web_service import open_service
from tests.clearcap.web.conftest import only_in_a_folder


@pytest.fixture
def used(store, settings):
    """Return a store with a planned campaign, and the folder of its server."""
    open_service(Settings(settings.store, settings.data)).close()
    return store, settings.data


def found(store, data):
    """Return the worst finding of each kind, by what was looked at."""
    worst = {}
    for each in examine(store, data):
        if [OK, WARNING, FAULT].index(each.status) >= [OK, WARNING, FAULT].index(worst.get(each.what, OK)):
            worst[each.what] = each.status
    return worst


def test_all_is_well(used, monkeypatch):
    monkeypatch.setattr(maintenance, "LEAST_FREE", 0)
    monkeypatch.setattr(maintenance, "LEAST_SHARE", 0.0)
    before = {path.name: path.stat().st_size for path in used[1].iterdir() if path.suffix != ".sqlite"}
    assert set(found(*used).values()) == {OK}
    assert {path.name: path.stat().st_size for path in used[1].iterdir() if path.name in before} == before


@only_in_a_folder
def test_each_fault_is_found(used, monkeypatch, plan):
    """Modes, room, clock, a queue that nobody serves, rows of another build, a changed trail, a damaged database."""
    store, data = used
    (data / KEY_FILE).chmod(0o644)
    assert found(store, data)["folder"] == FAULT
    (data / KEY_FILE).chmod(0o600)
    monkeypatch.setattr(maintenance, "LEAST_SHARE", 1.1)
    assert (found(store, data)["store"], found(store, data)["folder"]) == (WARNING, WARNING)
    monkeypatch.setattr(maintenance, "LEAST_SHARE", 0.0)
    for off in (-60.0, 60.0):
        with monkeypatch.context() as patch:
            patch.setattr(maintenance.time, "time", lambda off=off, now=time.time: now() + off)
            assert found(store, data)["clock"] == FAULT
    write_state(store, plan.campaign_id, "queued")
    assert (found(store, data)["queue"], found(store, data)["versions"]) == (WARNING, OK)
    with monkeypatch.context() as patch:
        patch.setattr(maintenance, "row_build", lambda: "another")
        assert found(store, data)["versions"] == WARNING
    with closing(Database(data / DATABASE)) as database:
        from clearcap.web.access.audit import AuditTrail

        for _ in range(2):
            AuditTrail(database).add("ada", "session", "::1", "POST /x", "y", 201)
        with database.write() as connection:
            connection.execute("DELETE FROM audit WHERE number = 1")
    assert found(store, data)["database"] == FAULT
    with closing(sqlite3.connect(data / DATABASE)) as opened:
        opened.execute("PRAGMA user_version = 99")
    assert found(store, data)["database"] == WARNING
    (data / DATABASE).write_bytes(b"no database" * 1000)
    assert found(store, data)["database"] == FAULT


def test_the_verbs(used, tmp_path, monkeypatch):
    """Back up, check, restore beside, look: as an operator types them."""
    store, data = used
    file, target = tmp_path / "b", tmp_path / "restored"
    run = CliRunner().invoke
    options = ["--store", store.files.full_url, "--json"]
    made = run(app, ["backup", str(file), "--data", str(data), *options])
    assert made.exit_code == 0, made.output
    assert json.loads(made.stdout)["users"] == 0
    assert json.loads(run(app, ["restore", str(file), "--check", *options]).stdout)["differing"] == []
    assert run(app, ["restore", str(file), "--data", str(target), *options]).exit_code == 0
    assert (target / KEY_FILE).read_bytes() == (data / KEY_FILE).read_bytes()
    (target / KEY_FILE).chmod(0o640)
    looked = run(app, ["doctor", "--data", str(target), *options])
    assert (looked.exit_code, FAULT in {each["status"] for each in json.loads(looked.stdout)}) == (1, True)
