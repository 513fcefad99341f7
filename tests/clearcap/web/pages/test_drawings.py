"""Pages and calls of STEP files: upload one, answer what its draft asks, save the mechanism, bring it to a revision."""

import json
import re
import shutil
from html import unescape

import pytest

from clearcap.web.http.authentication import COOKIE, CSRF_FIELD, CSRF_HEADER
from clearcap.web.settings import Settings
from engine import load_mechanism_text
from tests.clearcap.web.conftest import URL, serving
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = pytest.mark.processes
CALL = "/api/v1/drawings"


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """Return a service with one computing process, and its client."""
    folder = tmp_path_factory.mktemp("drawings")
    with serving(Settings(str(folder / "runs"), folder / "data", processes=1)) as started:
        yield started


def log_in(service, role="engineer", accept="text/html"):
    """Be a user of a role; return the client, and the field of its forms."""
    opened, client = service
    secret = opened.sessions.begin(role)
    csrf = opened.sessions.principal(secret).csrf
    client.cookies.set(COOKIE, secret)
    client.follow_redirects = accept == "text/html"
    client.headers = {"Origin": URL, "Accept": accept, CSRF_HEADER: csrf}
    return client, {CSRF_FIELD: csrf}


def text_in(page):
    """Return the text in the editor of a page."""
    return unescape(re.search(r"<textarea[^>]*>\n(.*?)</textarea>", page, re.DOTALL)[1])


def test_from_a_step_file_to_a_campaign(service):
    """Everything that docs/cad.md does with files, in the browser: import, answer, check, save, vary the limits."""
    client, csrf = log_in(service)
    step = {"file": ("Latch rev A.stp", LATCH.read_bytes())}
    shown = client.post("/mechanisms/drawings", data={**csrf, "name": "latch"}, files=step)
    assert shown.status_code == 200, shown.text
    assert shown.url.path == "/mechanisms/latch/drawing"
    assert "latch from Latch rev A.stp" in shown.text
    assert "6 open questions" in shown.text
    assert "which way is down?" in shown.text
    found = client.get(f"{CALL}/latch/found.html")
    assert "crank-coupler" in found.text
    assert found.headers["content-security-policy"].startswith("sandbox allow-scripts; default-src 'none'")
    text = text_in(shown.text)
    answered = re.sub(r"#\? gravity.*\n# gravity", "gravity", text).replace("# fixed = true", "fixed = true")
    answered = re.sub(r"#\? bodies.*\n", "", answered)
    form = {**csrf, "text": answered.replace("\n", "\r\n"), "version": 1}
    checked = client.post("/mechanisms/latch/drawing", data={**form, "action": "check"})
    assert "No faults" in checked.text
    assert "4 open questions" in checked.text
    assert "joints.base-rocker: clearance 0.06 mm as drawn" in checked.text
    wrong = client.post("/mechanisms/latch/drawing", data={**form, "text": answered.replace("[parameters]", "[para]")})
    assert wrong.status_code == 422
    assert 'class="wrong"' in wrong.text
    assert client.post("/mechanisms/latch/drawing", data={**form, "action": "keep"}).url.path.endswith("/drawing")
    late = client.post("/mechanisms/latch/drawing", data={**form, "action": "save"})
    assert late.status_code == 409  # somebody has kept another version meanwhile
    saved = client.post("/mechanisms/latch/drawing", data={**form, "version": 2, "action": "save"})
    assert saved.url.path == "/mechanisms/latch"
    mechanism = load_mechanism_text(client.get("/api/v1/mechanisms/latch/text").text, "latch")
    assert mechanism.parameters["base_crank_hole"] == pytest.approx(6.1)
    assert mechanism.bodies["crank"].mass == pytest.approx(19.6056, rel=1e-4)
    campaign = client.get("/campaigns/new?drawing=latch").text
    assert 'target = "parameters.base_crank_hole"' in unescape(campaign)
    assert 'mechanism = "latch"' in unescape(campaign)
    assert "/mechanisms/latch/drawing" in client.get("/mechanisms").text


def test_a_revision_keeps_the_answers(service):
    """The same file again changes nothing; one with another hole says what moved, and keeps what was written."""
    client, _ = log_in(service, accept="application/json")
    content = LATCH.read_bytes()
    first = client.post(CALL, data={"name": "revised"}, files={"file": ("a.step", content)})
    assert (first.status_code, first.json()["draft"]["version"]) == (201, 1)
    draft = client.get(f"{CALL}/revised").json()
    text = draft["text"].replace("friction = 0.0", "friction = 0.2")
    assert client.put(f"{CALL}/revised", json={"text": text, "version": 1}).json()["version"] == 2
    wider = content.replace(b"3.05", b"3.07")
    assert wider != content
    second = client.post(CALL, data={"name": "revised"}, files={"file": ("b.step", wider)})
    assert second.status_code == 201, second.text
    assert any("3.07" in line for line in second.json()["changes"]["diff"])
    assert second.json()["changes"]["diff"][0].strip() == "--- revised.toml"
    now = client.get(f"{CALL}/revised").json()
    assert (now["file"], now["version"]) == ("b.step", 3)
    assert now["sha256"] != draft["sha256"]
    assert "friction = 0.2" in now["text"]
    assert "radius = 3.07" in now["text"]
    checked = client.post(f"{CALL}/revised/check", json={"text": now["text"], "version": 3}).json()
    assert checked["summary"]["joints"] == 4


def test_bodies_follow_the_groups(service):
    """Two parts that are listed as a group become one body, without another upload; what was answered stays."""
    client, csrf = log_in(service)
    step = {"file": ("latch.step", LATCH.read_bytes())}
    text = text_in(client.post("/mechanisms/drawings", data={**csrf, "name": "grouped"}, files=step).text)
    grouped = text.replace("friction = 0.0", "friction = 0.2")
    grouped = grouped.replace("[parameters]", '[groups]\nbar = ["crank", "coupler"]\n\n[parameters]', 1)
    form = {**csrf, "version": 1, "action": "groups"}
    wrong = client.post("/mechanisms/grouped/drawing", data={**form, "text": "[groups"})
    assert wrong.status_code == 422
    shown = client.post("/mechanisms/grouped/drawing", data={**form, "text": grouped, "version": 2})
    assert shown.status_code == 200, shown.text
    assert "What has changed" in shown.text
    now = text_in(shown.text)
    assert 'parts = ["crank", "coupler"]' in now
    assert "[joints.crank-coupler]" not in now
    assert "friction = 0.2" in now
    assert "bar" in client.get(f"{CALL}/grouped/found.html").text
    late = client.post(
        f"{CALL}/grouped/groups", json={"text": now, "version": 2}, headers={"Accept": "application/json"}
    )
    assert late.status_code == 409


def test_what_is_refused(service):
    """No STEP file, a shipped name, a wrong name, too long a file, a user who may only look, a draft that is not."""
    client, _ = log_in(service, accept="application/json")
    step = {"file": ("latch.step", LATCH.read_bytes())}
    no_step = client.post(CALL, data={"name": "none"}, files={"file": ("a.step", b"solid x\n")})
    assert no_step.status_code == 422
    assert "STEP" in no_step.json()["detail"]
    assert client.get(f"{CALL}/none").status_code == 404
    assert client.get(f"{CALL}/none/found.html").status_code == 404
    assert client.post(CALL, data={"name": "c60"}, files=step).status_code == 409
    assert client.post(CALL, data={"name": "../x"}, files=step).status_code == 422
    big = {"file": ("big.step", b" " * (32 * 2**20 + 1))}
    assert client.post(CALL, data={"name": "big"}, files=big).status_code == 413
    viewer, csrf = log_in(service, "viewer")
    assert viewer.post(CALL, data={"name": "seen"}, files=step).status_code == 403
    assert viewer.post("/mechanisms/drawings", data={**csrf, "name": "seen"}, files=step).status_code == 403


def test_a_draft_opens_no_other_file(service, tmp_path):
    """Another path or digest in its text is refused before it is looked at, and no answer names a folder."""
    client, _ = log_in(service, accept="application/json")
    assert client.post(CALL, data={"name": "own"}, files={"file": ("a.step", LATCH.read_bytes())}).status_code == 201
    draft = client.get(f"{CALL}/own").json()
    own = re.search(r'^file = "(.*)"$', draft["text"], re.MULTILINE)[1]
    assert own == f"own-{draft['sha256'][:8]}.step"
    secret = tmp_path / "secret.step"
    shutil.copy(LATCH, secret)
    for key, text in {
        "file": draft["text"].replace(own, str(secret)),
        "sha256": draft["text"].replace(draft["sha256"], "0" * 64),
    }.items():
        refused = client.post(f"{CALL}/own/check", json={"text": text, "version": draft["version"]})
        assert refused.status_code == 422
        assert [each["keys"] for each in refused.json()["faults"]] == [["cad", key]]
        assert refused.json()["faults"][0]["line"] > 1
        assert client.post(f"{CALL}/own/mechanism", json={"text": text, "version": 1}).status_code == 422
    draft = client.put(f"{CALL}/own", json={"text": draft["text"].replace(own, str(secret)), "version": 1}).json()
    wider = LATCH.read_bytes().replace(b"3.05", b"3.07")
    assert client.post(CALL, data={"name": "own"}, files={"file": ("b.step", wider)}).status_code == 422
    assert client.get(f"{CALL}/own").json()["version"] == draft["version"]


def test_odd_texts_are_refused(service):
    """What is no text, no TOML or no mechanism is said; what can be kept is kept."""
    client, _ = log_in(service, accept="application/json")
    assert client.post(CALL, data={"name": "odd"}, files={"file": ("a.step", LATCH.read_bytes())}).status_code == 201
    for text in ("\ud800", "[", "a = 1", "[cad]\nfile = 3", "cad = 1", ""):
        sent = {"content": json.dumps({"text": text, "version": 1}), "headers": {"Content-Type": "application/json"}}
        assert client.post(f"{CALL}/odd/check", **sent).status_code == 422, text
    sent["content"] = json.dumps({"text": "\ud800", "version": 1})
    assert client.put(f"{CALL}/odd", **sent).status_code == 422
    ahead = client.put(f"{CALL}/odd", json={"text": "a", "version": 7})
    assert ahead.status_code == 409  # there is no such version


def test_damage_is_accepted_if_asked(service):
    """A file that lost an entity is refused, and read as far as it can be if its user says so."""
    client, _ = log_in(service, accept="application/json")
    content = LATCH.read_text()
    damaged = re.sub(r"^#698 = CIRCLE.*\n", "", content, count=1, flags=re.MULTILINE)
    assert damaged != content
    step = {"file": ("a.step", damaged.encode())}
    refused = client.post(CALL, data={"name": "damaged"}, files=step)
    assert refused.status_code == 422
    assert "clearcap-" not in refused.json()["detail"]  # the folder in which it was read
    accepted = client.post(CALL, data={"name": "damaged", "accept_damage": "true"}, files=step)
    assert accepted.status_code == 201, accepted.text
    assert "accept_damage = true" in client.get(f"{CALL}/damaged").json()["text"]
