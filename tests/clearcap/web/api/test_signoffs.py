"""Sign-offs over the API: only an approver signs, only what he has looked at; one changed byte shows."""

import dataclasses
import os
import time
from pathlib import Path

import pytest

from campaign.coordinator.state import write_state
from campaign.errors import SpecError
from clearcap.questions.signing import open_archive, verify_export
from clearcap.web.access.database import Database
from clearcap.web.signing_service import KEY_FILE
from clearcap.web.web_service import open_service
from tests.clearcap.web.conftest import only_in_a_folder


@pytest.fixture
def campaign(reported, service):
    """Return a completed campaign with a report, which is served."""
    return reported


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


def test_what_changed_since_he_looked_is_not_signed(client, service, campaign, as_user, url):
    approver = as_user("approver")
    content = client.get(f"{url}/content", headers=approver).json()["content"]
    service.store.files.write(f"{campaign}/report/report.html", b"<p>Cpk 2.00</p>")
    answer = client.post(url, json={"content": content}, headers=approver)
    assert (answer.status_code, "has changed since" in answer.json()["detail"]) == (409, True)


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
