"""Campaigns are made over the API: checked, submitted once, extended and computed again."""

import base64
from contextlib import ExitStack, contextmanager

import pytest

from campaign.coordinator.requests import rerun_request
from campaign.coordinator.state import state_of, write_state
from clearcap.web import web_service
from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_FIELD
from clearcap.web.operations.mechanisms import shipped_text
from clearcap.web.operations.submissions import RequestKeys
from clearcap.web.settings import Limits, Settings
from tests.campaign.conftest import SPEC
from tests.clearcap.web.conftest import URL, serving
from tests.each import each

LATCH = shipped_text("c60")


@contextmanager
def computing_with(address, data, **limits):
    """Serve with one process, which needs no engine here; yield the service, the client, and headers by role."""
    settings = Settings(address, data, processes=1, limits=Limits(**limits))
    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(web_service, "warm_up_try_out", None)
        service, client = stack.enter_context(serving(settings))
        secrets = {role: service.tokens.add(role.word, "test", role, 3600.0)[1] for role in Role}
        yield service, client, {role.word: {"Authorization": f"Bearer {secrets[role]}"} for role in Role}


@pytest.fixture(scope="module")
def computing(storage, tmp_path_factory):
    """Return a service with one computing process, a client, and headers by role."""
    folder = tmp_path_factory.mktemp("submissions")
    with computing_with(storage(folder), folder / "data", samples=1000) as served:
        yield served


def named(name, text=SPEC):
    """Return a campaign's text with another name."""
    return text.replace('name = "demo"', f'name = "{name}"')


def submit(computing, text, headers="engineer", **more):
    """Submit a campaign as JSON."""
    _, client, by_role = computing
    return client.post("/api/v1/campaigns", json={"text": text, **more}, headers=by_role[headers])


@pytest.mark.processes
def test_check_tells_size_and_cost(computing):
    _, client, headers = computing
    answer = client.post("/api/v1/checks/campaign", json={"text": SPEC}, headers=headers["engineer"])
    document = answer.json()
    assert answer.status_code == 200, document
    assert (document["samples"], document["exists"], document["variables"]) == (25, False, ["J1", "preload"])
    assert document["cost"]["runs"] == 26
    assert document["cost"]["seconds"] is None
    assert document["campaign"].startswith("demo-")


@pytest.mark.processes
def test_faults_have_keys_and_lines(computing):
    _, client, headers = computing
    text = SPEC.replace("std = 0.0175", "std = -1").replace("samples = 25", "sample = 25")
    answer = client.post("/api/v1/checks/campaign", json={"text": text}, headers=headers["engineer"])
    assert answer.status_code == 422
    faults = {".".join(fault["keys"]): fault["line"] for fault in answer.json()["faults"]}
    lines = text.splitlines()
    assert faults["variables.J1.std"] == lines.index("std = -1") + 1
    assert faults["sample"] == lines.index("sample = 25") + 1


@pytest.mark.processes
def test_faults_of_a_file_that_the_text_names(computing):
    """The problem says which file, and the line in it."""
    text = SPEC.replace('"c60"', '"latch.toml"')
    wrong = LATCH.replace(b"[bodies", b"[bodys", 1)
    files = {"latch.toml": base64.b64encode(wrong).decode()}
    faults = submit(computing, text, files=files).json()["faults"]
    assert faults[0]["keys"] == ["mechanism"]
    inner = [fault for fault in faults if fault["file"] == "latch.toml"]
    assert any(fault["line"] for fault in inner)


@pytest.mark.processes
def test_submitted_once(computing):
    """A campaign is planned, queued, and its submitter's; the same again changes nothing."""
    service, client, headers = computing
    answer = submit(computing, named("once"), tags=["night"])
    assert answer.status_code == 201, answer.text
    made = answer.json()
    assert answer.headers["location"] == f"/api/v1/campaigns/{made['campaign']}"
    shown = client.get(answer.headers["location"], headers=headers["viewer"]).json()
    wanted = ("queued", "engineer", "engineer", ["night"])
    assert (shown["state"], shown["owner"], shown["submitted_by"], shown["tags"]) == wanted
    again = submit(computing, named("once"), headers="admin")
    assert (again.status_code, again.json()["owner"], again.json()["is_new"]) == (200, "engineer", False)
    assert "engineer" in again.json()["note"]
    assert service.store.table(made["campaign"]).num_rows == 0  # nothing was simulated


@pytest.mark.processes
def test_planned_and_not_queued_is_queued_by_the_same_again(computing):
    """Whoever planned it was killed before he queued it."""
    service, _, _ = computing
    made = submit(computing, named("killed")).json()
    service.store.remove(made["campaign"], "state.json")
    assert submit(computing, named("killed")).status_code == 200
    assert state_of(service.store, made["campaign"])["state"] == "queued"


@pytest.mark.processes
def test_form_with_files(computing):
    """As curl -F sends it; a name with a folder too."""
    _, client, headers = computing
    text = named("form", SPEC.replace('"c60"', '"parts/latch.toml"'))
    files = [("campaign", ("mine.toml", text.encode())), ("files", ("parts/latch.toml", LATCH))]
    data = {"samples": "30", "tags": ["a", "b"]}
    answer = client.post("/api/v1/campaigns", files=files, data=data, headers=headers["engineer"])
    assert answer.status_code == 201, answer.text
    assert answer.json()["samples"] == 30
    entry = client.get(answer.headers["location"], headers=headers["viewer"]).json()
    assert entry["tags"] == ["a", "b"]


@pytest.mark.processes
def test_saved_mechanism_is_named(computing):
    _, client, headers = computing
    saved = client.put("/api/v1/mechanisms/latch", json={"text": LATCH.decode()}, headers=headers["engineer"])
    assert saved.status_code == 200, saved.text
    assert submit(computing, named("saved", SPEC.replace('"c60"', '"latch"'))).status_code == 201


@pytest.mark.processes
@pytest.mark.parametrize("field", ["samples", "seed"])
def test_true_is_no_number(computing, field):
    _, client, headers = computing
    body = {"text": named("true"), field: True}
    answer = client.post("/api/v1/campaigns", json=body, headers=headers["engineer"])
    assert (answer.status_code, "not true or false" in answer.text) == (422, True)


@pytest.mark.processes
def test_same_key_same_answer(computing):
    """Sent twice, also after the campaign exists; another content is refused; a refused one may be corrected."""
    _, client, headers = computing
    once = {**headers["engineer"], "Idempotency-Key": "night-1"}
    wrong = client.post("/api/v1/campaigns", json={"text": "x = 1"}, headers=once)
    assert wrong.status_code == 422
    first = client.post("/api/v1/campaigns", json={"text": named("key")}, headers=once)
    again = client.post("/api/v1/campaigns", json={"text": named("key")}, headers=once)
    assert first.status_code == again.status_code == 201
    assert first.json() == again.json()
    assert first.headers["location"] == again.headers["location"]
    other = client.post("/api/v1/campaigns", json={"text": named("key2")}, headers=once)
    assert (other.status_code, "other content" in other.json()["detail"]) == (422, True)
    of_another = {**headers["admin"], "Idempotency-Key": "night-1"}
    assert client.post("/api/v1/campaigns", json={"text": named("key3")}, headers=of_another).status_code == 201


def test_keys_are_kept_for_a_day(served):
    service, _ = served
    keys = RequestKeys(service.database)
    assert keys.claim("engineer", "k", "a", now=0.0) is None
    assert keys.keep("engineer", "k", 201, "{}") == (201, "{}")
    assert keys.keep("engineer", "k", 200, "later") == (201, "{}")
    assert keys.claim("engineer", "k", "a", now=86000.0) == (201, "{}")
    assert keys.claim("engineer", "k", "b", now=87000.0) is None


@pytest.mark.processes
def test_more_samples(computing):
    """A new campaign of the same spec, with the tags of the first."""
    _, client, headers = computing
    first = submit(computing, named("more"), tags=["night"]).json()["campaign"]
    where = f"/api/v1/campaigns/{first}/extend"
    answer = client.post(where, json={"samples": 60}, headers=headers["admin"])
    assert answer.status_code == 201, answer.text
    entry = client.get(answer.headers["location"], headers=headers["viewer"]).json()
    assert (entry["samples"], entry["owner"], entry["tags"]) == (60, "admin", ["night"])
    assert answer.json()["campaign"] != first
    assert client.post(where, json={"samples": 60}, headers=headers["engineer"]).status_code == 200
    for samples in (25, 2000):
        refused = client.post(where, json={"samples": samples}, headers=headers["engineer"])
        assert (refused.status_code, f"samples = {samples}" in refused.json()["detail"]) == (422, True)


@pytest.mark.processes
def test_failed_rows_again(computing):
    """A request in the store, which the coordinator that serves it fulfils; refused while it is computed."""
    service, client, headers = computing
    made = submit(computing, named("rerun")).json()["campaign"]
    where = f"/api/v1/campaigns/{made}/rerun"
    assert client.post(where, json={}, headers=headers["engineer"]).status_code == 409
    write_state(service.store, made, "completed")
    nothing = client.post(where, json={}, headers=headers["engineer"])
    assert "nothing" in nothing.json()["note"]
    assert rerun_request(service.store, made) is None
    assert client.post(where, json={"statuses": ["none"]}, headers=headers["engineer"]).status_code == 422


@pytest.mark.processes
def test_quotas_have_words(storage, tmp_path):
    with computing_with(storage(tmp_path), tmp_path / "data", samples=1000, running=1) as computing:
        deciding = submit(computing, f"{SPEC}\n[decide]\nruns = 1001\n")
        assert (deciding.status_code, deciding.json()["faults"][0]["keys"]) == (422, ["decide", "runs"])
        too_many = submit(computing, SPEC, samples=1001)
        assert too_many.status_code == 422
        assert "1000" in too_many.json()["detail"]
        assert too_many.json()["faults"][0]["keys"] == ["samples"]
        assert submit(computing, named("first")).status_code == 201
        second = submit(computing, named("second"))
        assert (second.status_code, second.headers["retry-after"]) == (429, "60")
        assert "1 queued" in second.json()["detail"]
        assert submit(computing, named("second"), headers="admin").status_code == 201


HOSTILE = [
    {"text": SPEC.replace('"c60"', '"/etc/passwd"')},
    {"text": SPEC.replace('"c60"', '"../../etc/passwd.toml"')},
    {"text": SPEC.replace('"c60"', '"latch.toml"')},
    {"text": SPEC, "files": {"../x.toml": ""}},
    {"text": SPEC, "files": {"/etc/passwd": "eA=="}},
    {"text": SPEC, "files": {"x.toml": "not base64"}},
    {"text": SPEC, "files": {f"{i}.csv": "" for i in range(101)}},
    {"text": "a = " + "[" * 100_000},
    {"text": "[" + ".".join("a" * 50_000) + "]"},
    {"text": "x" * (2**20 + 1)},
    {"text": "\ud800"},
    {"text": SPEC, "tags": ["a\nb"]},
    {"text": SPEC, "owner": "\u202e"},
    {"text": SPEC, "samples": 0},
    {"text": SPEC, "surplus": 1},
    {"text": SPEC, "store": "/elsewhere"},
    {},
]


@pytest.mark.processes
@each("content", HOSTILE)
def test_hostile_content_is_refused(computing, content):
    _, client, headers = computing
    import json

    body = json.dumps(content)  # a surrogate as an escape
    sent = {**headers["engineer"], "Content-Type": "application/json"}
    answer = client.post("/api/v1/campaigns", content=body, headers=sent)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert "root:" not in answer.text


@pytest.mark.processes
def test_other_bodies_are_refused(computing):
    _, client, headers = computing
    for kind, body, status in (
        ("text/plain", b"x", 415),
        ("application/json", b"{", 422),
        ("application/json", b"[" * 9_000, 422),
        ("application/json", b"[" * 100_000, 413),
        ("multipart/form-data", b"x", 400),
    ):
        answer = client.post("/api/v1/campaigns", content=body, headers={**headers["engineer"], "Content-Type": kind})
        assert answer.status_code == status, (kind, body[:20], answer.text)
        assert status != 422 or answer.json()["detail"].startswith("body: "), answer.text


WRITES = [
    ("/api/v1/checks/campaign", {"text": SPEC}),
    ("/api/v1/campaigns", {"text": SPEC}),
    ("/api/v1/campaigns/demo-1/extend", {"samples": 60}),
    ("/api/v1/campaigns/demo-1/rerun", {}),
]


@pytest.mark.parametrize(("path", "content"), WRITES)
def test_writes_need_a_role_and_an_own_page(reported, served, as_user, path, content):
    """401 for nobody, 403 for a viewer and for another site; each is an entry of the audit trail."""
    service, client = served
    path = path.replace("demo-1", reported)
    assert client.post(path, json=content).status_code == 401
    assert client.post(path, json=content, headers=as_user("viewer")).status_code == 403
    secret = service.sessions.begin("engineer")
    client.cookies.set(COOKIE, secret)
    foreign = {"Origin": "https://evil.example", "Sec-Fetch-Site": "cross-site"}
    assert client.post(path, json=content, headers=foreign).status_code == 403
    assert client.post(path, json=content, headers={"Origin": URL}).status_code == 403  # without the session's word
    form = client.post(path, data={CSRF_FIELD: "wrong"}, files={"campaign": b"x"}, headers={"Origin": URL})
    assert form.status_code == 403
    assert [entry.status for entry in service.audit.newest(count=4)] == [403, 403, 403, 403]
