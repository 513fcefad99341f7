"""Sign-offs over the API: only an approver signs, only the report of these rows that he has looked at."""

import dataclasses
import json
import os
import time
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from campaign.coordinator.lease import LeaseHeld
from campaign.coordinator.requests import SignedCampaign, being_signed, delete_campaign, request_rerun, unsigned
from campaign.coordinator.state import write_state
from campaign.errors import SpecError
from campaign.store.layout import SIGNED
from clearcap.cli import app
from clearcap.questions.report import report
from clearcap.questions.signing import open_archive
from clearcap.questions.verification import verify_export
from clearcap.web.access.database import Database
from clearcap.web.maintenance import back_up
from clearcap.web.signing_service import KEY_FILE
from clearcap.web.web_service import open_service
from tests.clearcap.web.conftest import only_in_a_folder, write_real_report


@pytest.fixture
def campaign(signable):
    """Return a completed campaign with its report, which is served."""
    return signable


@pytest.fixture
def url(campaign):
    return f"/api/v1/campaigns/{campaign}/signoffs"


@pytest.fixture
def sign(client, as_user, url):
    """Return what signs as an approver what he sees."""

    def signed(comment=""):
        approver = as_user("approver")
        content = client.get(f"{url}/content", headers=approver).json()["content"]
        return client.post(url, json={"content": content, "comment": comment}, headers=approver)

    return signed


def file_at(service, campaign, name):
    """Return where a file of a campaign is, in a store that is a folder."""
    return Path(service.store.url) / campaign / name


def test_only_approvers_sign(client, as_user, url):
    body = {"content": "0" * 64}
    for method, path in (("GET", f"{url}/content"), ("POST", url)):
        assert client.request(method, path, json=body).status_code == 401
        for role in ("viewer", "engineer"):
            assert client.request(method, path, json=body, headers=as_user(role)).status_code == 403


def test_signed(client, service, campaign, as_user, url, sign):
    """The document names signer, comment and submitter; it is listed, audited, and exported for verification."""
    viewer = as_user("viewer")
    assert client.get(url, headers=viewer).json()["status"] == "not signed"
    assert client.get(f"{url}/export.zip", headers=viewer).status_code == 409
    answer = sign("as drawn")
    assert answer.status_code == 201
    document = answer.json()
    assert (document["signer"], document["comment"], document["is_submitter"]) == ("approver", "as drawn", False)
    assert service.audit.newest(count=1)[0].detail.startswith(f"plan {document['plan'][:12]}")
    assert sign().json()["previous"] is not None
    listed = client.get(url, headers=viewer).json()
    assert (listed["status"], [each["status"] for each in listed["signoffs"]]) == ("signed", ["signed", "signed"])
    export = client.get(f"{url}/export.zip", headers=viewer)
    path = service.settings.data / "export.zip"
    path.write_bytes(export.content)
    key = client.get("/api/v1/signing-key", headers=viewer).json()["fingerprint"]
    proof = verify_export(open_archive(path), key)
    assert (proof.faults, [each.signoff.signer for each in proof.signoffs]) == ([], ["approver", "approver"])
    assert listed["key"] == key


@pytest.mark.slow
def test_the_same_again_is_the_same_sign_off(client, as_user, url, sign):
    """Whose answer was lost sends it again; another comment, or another's signature between, is a new sign-off."""
    first = sign("as drawn").json()
    assert sign("as drawn").json() == first
    assert sign("and measured").json()["previous"] is not None
    assert sign("as drawn").json() != first
    assert len(client.get(url, headers=as_user("viewer")).json()["signoffs"]) == 3


def test_four_eyes(client, service, campaign, as_user, url):
    """Who submitted a campaign and signs it himself is named as such."""
    service.store.write_json(campaign, "submission.json", {"user": "approver", "time": 0.0})
    write_real_report(service, campaign)  # it names him as the author
    approver = as_user("approver")
    content = client.get(f"{url}/content", headers=approver).json()
    assert content["is_submitter"]
    signed = client.post(url, json={"content": content["content"]}, headers=approver).json()
    assert (signed["submitted_by"], signed["is_submitter"]) == ("approver", True)


def change_a_byte(service, path):
    """Change a byte of a file of the store, which keeps its size."""
    content = service.store.files.read(path)
    service.store.files.write(path, content[:9] + bytes([content[9] ^ 1]) + content[10:])


@pytest.mark.parametrize("name", ["plan.json", "campaign.toml", "report/report.html"])
def test_changed_byte_shows(client, service, campaign, as_user, url, sign, name):
    assert sign().status_code == 201
    change_a_byte(service, f"{campaign}/{name}")
    answer = client.get(url, headers=as_user("viewer"))
    if name == "plan.json":  # nothing of the campaign can be read then
        assert answer.status_code == 503
        return
    assert answer.json()["status"] == "signed version differs"
    assert any(name in words for words in answer.json()["signoffs"][0]["differences"])


def test_changed_byte_of_the_rows_shows(client, service, campaign, as_user, url, sign):
    assert sign().status_code == 201
    change_a_byte(service, f"{campaign}/parts/part-000001.parquet")
    found = client.get(url, headers=as_user("viewer")).json()
    assert found["status"] == "signed version differs"
    assert any("part-000001.parquet" in words for words in found["signoffs"][0]["differences"])


@pytest.mark.slow
@only_in_a_folder
def test_check_reads_again(client, service, campaign, as_user, url, sign):
    """Files that seem to be as they were are not read, unless that is asked for."""
    path = file_at(service, campaign, "report/report.html")
    long_ago = time.time() - 1000.0
    assert sign().status_code == 201
    read = []
    original = service.signing_service._store.files.read

    def counted(name, *args, **kwargs):
        read.append(name)
        return original(name, *args, **kwargs)

    service.signing_service._store.files.read = counted
    os.utime(path, (long_ago, long_ago))
    viewer = as_user("viewer")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("clearcap.web.signing_service._SETTLED", 0.0)
        client.get(url, headers=viewer)
        read.clear()
        client.get(url, headers=viewer)
        assert not [name for name in read if "report.html" in name]
        client.get(url, params={"check": True}, headers=viewer)
        assert [name for name in read if "report.html" in name]


def test_only_the_report_of_these_rows_is_signed(client, service, campaign, as_user, url, sign):
    """Not one that was edited, even where its JSON was not; nor that of other rows; nor a file that no report has."""
    files = service.store.files
    home = f"{campaign}/report"
    page, document = files.read(f"{home}/report.html"), files.read(f"{home}/capability.json")
    assert b"</h1>" in page
    assert b'"cpk": ' in document
    for name, content in (
        ("report.html", page.replace(b"</h1>", b": capable</h1>")),
        ("capability.json", document.replace(b'"cpk": ', b'"cpk": 1')),
        ("notes.txt", b"capable"),
    ):
        before = files.read(f"{home}/{name}") if files.exists(f"{home}/{name}") else None
        files.write(f"{home}/{name}", content)
        answer = sign()
        assert (answer.status_code, name in answer.json()["detail"]) == (409, True)
        files.remove(f"{home}/{name}") if before is None else files.write(f"{home}/{name}", before)
    header = service.store.plan_header(campaign)
    part = files.read(f"{campaign}/parts/part-000002.parquet")
    files.remove(f"{campaign}/parts/part-000002.parquet")
    write_real_report(service, campaign)  # as over the rows of a campaign that runs
    files.write(f"{campaign}/parts/part-000002.parquet", part)
    service.store.survey(header)
    answer = sign()
    assert (answer.status_code, "other rows" in answer.json()["detail"]) == (409, True)
    write_real_report(service, campaign)
    assert sign().status_code == 201
    assert client.get(url, headers=as_user("viewer")).json()["status"] == "signed"


def test_nothing_changes_what_is_signed(client, service, campaign, as_user, url, sign):
    """Not over the API, nor with the store itself; until an approver withdraws the sign-off, which stays on record."""
    assert sign("as drawn").status_code == 201
    home, admin = f"/api/v1/campaigns/{campaign}", as_user("admin")
    plan = service.store.plan(campaign)
    confirmed = {**admin, "X-Confirm": campaign}
    changes = {
        "delete": lambda: client.delete(home, headers=confirmed),
        "report": lambda: client.post(f"{home}/report", headers=admin),
    }
    write_state(service.store, campaign, "completed")
    for name, change in changes.items():
        answer = change()
        assert (name, answer.status_code, "signed" in answer.json()["detail"]) == (name, 409, True)
    for change in (
        lambda: delete_campaign(service.store, campaign),
        lambda: request_rerun(service.store, campaign, (), "eva"),
        lambda: report(service.store, plan),
    ):
        with pytest.raises(SignedCampaign):
            change()
    assert client.get(url, headers=as_user("viewer")).json()["status"] == "signed"
    reason = {"comment": "wrong drawing"}
    assert client.post(f"{url}/withdrawal", json=reason, headers=as_user("engineer")).status_code == 403
    assert client.post(f"{url}/withdrawal", json={"comment": ""}, headers=as_user("approver")).status_code == 422
    assert client.post(f"{url}/withdrawal", json=reason, headers=as_user("approver")).status_code == 201
    listed = client.get(url, headers=as_user("viewer")).json()
    assert (listed["status"], [each["status"] for each in listed["signoffs"]]) == ("withdrawn", ["signed", "withdrawn"])
    assert client.post(f"{url}/withdrawal", json=reason, headers=as_user("approver")).status_code == 409
    report(service.store, plan)
    assert sign("as drawn").status_code == 201
    assert client.get(url, headers=as_user("viewer")).json()["status"] == "signed"


def test_what_has_lost_its_marker_is_protected_again(client, service, campaign, as_user, url, sign):
    """As of a store restored from an earlier backup, of version 0.1, or of a server that was killed as it signed."""
    sign("as drawn")
    service.store.remove(campaign, SIGNED)
    left = {"token": "of a signer who was killed"}
    service.store.write_json(campaign, SIGNED, left)
    rerun = client.post(f"/api/v1/campaigns/{campaign}/rerun", json={}, headers=as_user("admin"))
    assert rerun.status_code == 409
    service.signing_service.protect_signed()
    marker = service.store.read_json(campaign, SIGNED)
    with pytest.raises(SignedCampaign):
        delete_campaign(service.store, campaign)
    service.store.write_json(campaign, SIGNED, {**marker, **left})  # killed as he signed once more
    with pytest.raises(SignedCampaign):
        delete_campaign(service.store, campaign)
    service.store.remove(campaign, SIGNED)
    with being_signed(service.store, campaign):  # somebody has the lease: the next start does it
        service.signing_service.protect_signed()
    assert service.store.read_json(campaign, SIGNED) is None
    service.signing_service.protect_signed()
    with pytest.raises(SignedCampaign):
        delete_campaign(service.store, campaign)
    client.post(f"{url}/withdrawal", json={"comment": "wrong drawing"}, headers=as_user("approver"))
    service.signing_service.protect_signed()
    assert service.store.read_json(campaign, SIGNED) is None


@only_in_a_folder
def test_a_restore_names_what_the_store_has_not_as_it_was_signed(service, campaign, sign, tmp_path):
    """The sign-offs of a backup are compared with the store beside it."""
    sign("as drawn")
    file = tmp_path / "backup"
    back_up(service.settings.data, file, 1.0)

    def restored(to):
        words = ["restore", str(file), "--data", str(tmp_path / to), "--store", service.store.url, "--json"]
        answer = CliRunner().invoke(app, words)
        return answer.exit_code, json.loads(answer.stdout)["differing"]

    assert restored("same") == (0, [])
    page = file_at(service, campaign, "report/report.html")
    page.write_bytes(page.read_bytes() + b" ")
    assert restored("changed") == (1, [campaign])
    file_at(service, campaign, "plan.json").unlink()
    assert restored("missing") == (1, [campaign])


def test_sign_offs_of_a_server_are_one_chain(client, service, campaign, as_user, url, sign):
    """Each document follows the server's last one; an export without its campaign's last document is found out."""
    first = sign("as drawn").json()
    assert (first["number"], first["before"], first["previous"]) == (1, None, None)
    client.post(f"{url}/withdrawal", json={"comment": "wrong drawing"}, headers=as_user("approver"))
    path = service.settings.data / "export.zip"
    path.write_bytes(client.get(f"{url}/export.zip", headers=as_user("viewer")).content)
    proof = verify_export(open_archive(path))
    assert [each.signoff.number for each in proof.signoffs] == [1, 2]
    assert proof.signoffs[1].signoff.withdraws == proof.signoffs[1].signoff.before == proof.signoffs[1].signoff.previous
    assert (proof.head.documents, proof.head.of_campaign) == (2, 2)
    assert len(proof.faults) == 1
    assert "withdrawn by approver" in proof.faults[0]
    cut = service.settings.data / "cut.zip"
    for left_out in ((), ("head.json", "head.sig")):
        with zipfile.ZipFile(path) as whole, zipfile.ZipFile(cut, "w") as rest:
            for name in whole.namelist():
                if Path(name).name not in ("0002.json", "0002.sig", *left_out):
                    rest.writestr(name, whole.read(name))
        assert any("removed" in fault for fault in verify_export(open_archive(cut)).faults)


def test_signing_and_deleting_at_once(service, campaign):
    """Who signs keeps others from deleting, reporting and computing again, and the other way round."""
    with being_signed(service.store, campaign):
        for change in (
            lambda: delete_campaign(service.store, campaign),
            lambda: request_rerun(service.store, campaign, (), ""),
        ):
            with pytest.raises((SignedCampaign, LeaseHeld)):
                change()
        with pytest.raises(SignedCampaign):
            report(service.store, service.store.plan(campaign))
    with unsigned(service.store, campaign), pytest.raises(LeaseHeld), being_signed(service.store, campaign):
        pass
    # who crashed while signing protects nothing
    service.store.write_json(campaign, "signed.json", {"token": "of nobody"})
    delete_campaign(service.store, campaign)


def test_what_changed_since_he_looked_is_not_signed(client, service, campaign, as_user, url):
    approver = as_user("approver")
    content = client.get(f"{url}/content", headers=approver).json()["content"]
    service.store.files.write(f"{campaign}/report/report.html", b"<p>Cpk 2.00</p>")
    answer = client.post(url, json={"content": content}, headers=approver)
    assert (answer.status_code, "has changed since" in answer.json()["detail"]) == (409, True)


def test_without_a_report_there_is_nothing_to_sign(client, service, campaign, as_user, browse, url):
    """The call that shows what would be signed says so, and the page; an approver signs what he has read."""
    files = service.store.files
    for name in files.names(f"{campaign}/report"):
        files.remove(f"{campaign}/report/{name}")
    answer = client.get(f"{url}/content", headers=as_user("approver"))
    assert (answer.status_code, "has no report" in answer.json()["detail"]) == (409, True)
    browse("approver")
    page = client.get(f"/campaigns/{campaign}/signoff")
    assert (page.status_code, "has no report" in page.text, 'name="content"' in page.text) == (200, True, False)


def test_only_completed_campaigns_are_signed(client, service, campaign, sign):
    write_state(service.store, campaign, "cancelled")
    answer = sign()
    assert (answer.status_code, "is cancelled" in answer.json()["detail"]) == (409, True)
    write_state(service.store, campaign, "completed")
    service.store.files.remove(f"{campaign}/parts/part-000001.parquet")
    answer = sign()
    assert (answer.status_code, "have no rows" in answer.json()["detail"]) == (409, True)


def test_shared_link_sees_the_sign_offs(client, service, campaign, url, sign):
    """Of its campaign; it can neither sign nor see others."""
    sign()
    _, secret = service.tokens.share(campaign, "engineer", "", 60.0)
    shared = {"Authorization": f"Bearer {secret}"}
    assert client.get(url, headers=shared).json()["status"] == "signed"
    assert client.get(f"{url}/export.zip", headers=shared).status_code == 200
    assert client.post(url, json={"content": "0" * 64}, headers=shared).status_code == 403
    _, secret = service.tokens.share("other", "engineer", "", 60.0)
    assert client.get(url, headers={"Authorization": f"Bearer {secret}"}).status_code == 404


def test_key_is_private_and_stays(campaign, service, settings, monkeypatch):
    """The next server of the same folder has the same key; one that others can read is refused, its database closed."""
    path = settings.data / KEY_FILE
    assert path.stat().st_mode & 0o777 == 0o600
    other = dataclasses.replace(settings, store=settings.store)
    again = open_service(other)
    assert again.signing_service.key.private_bytes_raw() == service.signing_service.key.private_bytes_raw()
    again.close()
    path.chmod(0o644)
    closed, close = [], Database.close
    monkeypatch.setattr(Database, "close", lambda database: (closed.append(database.path), close(database)))
    with pytest.raises(SpecError, match="others can read the key"):
        open_service(other)
    assert closed == [service.database.path]
