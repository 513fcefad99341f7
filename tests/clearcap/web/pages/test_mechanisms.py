"""The pages of mechanisms: list, page, editor with faults beside their lines, and a trial with its address."""

import json
import re

import pytest

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_FIELD
from clearcap.web.operations.mechanisms import shipped_text
from clearcap.web.settings import Settings
from engine import load_mechanism, simulate
from engine.mechanism import mechanism_schema
from tests.clearcap.web.conftest import URL, serving
from tests.clearcap.web.pages.forms import Page

PENDULUM = "clearance_pendulum"
TEXT = shipped_text(PENDULUM).decode()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Return a client of a service with one computing process, and what logs it in as a user of a role."""
    folder = tmp_path_factory.mktemp("pages")
    with serving(Settings(str(folder / "runs"), folder / "data", processes=1)) as (service, client):

        def log_in(role="engineer"):
            assert Role.of(role)
            secret = service.sessions.begin(role)
            client.cookies.set(COOKIE, secret)
            client.headers = {"Origin": URL, "Accept": "text/html"}
            return {CSRF_FIELD: service.sessions.principal(secret).csrf}

        yield client, log_in


@pytest.mark.processes
def test_list_and_page(browser):
    client, log_in = browser
    log_in("viewer")
    listed = client.get("/mechanisms").text
    assert f'href="/mechanisms/{PENDULUM}"' in listed
    assert "C-60 circuit breaker, ON" in listed
    assert "Upload" not in listed
    shown = client.get("/mechanisms/c60").text
    assert "J1" in shown
    assert "/mechanisms/c60/try?bench=trip" in shown
    assert "contact force" in shown
    assert "gravity.y" not in shown
    assert "gravity.y" in client.get("/mechanisms/c60?keys=GRAVITY").text
    assert client.get("/mechanisms/nothing").status_code == 404


@pytest.mark.processes
def test_pictures_of_the_style_are_there(browser):
    """What is shown where a picture is still being drawn, among them."""
    client, log_in = browser
    log_in("viewer")
    named = re.findall(r'url\("([^"]*)"\)', client.get("/static/pages.css").text)
    assert "being_drawn.svg" in named
    assert {client.get(f"/static/{name}").status_code for name in named} == {200}


@pytest.mark.processes
def test_editor_shows_faults_beside_their_lines(browser):
    client, log_in = browser
    csrf = log_in()
    shown = client.get(f"/mechanisms/{PENDULUM}/edit").text
    assert "[bodies" in shown
    wrong = TEXT.replace("[bodies", "[bodys", 1)
    answer = client.post(f"/mechanisms/{PENDULUM}/edit", data={**csrf, "text": wrong.replace("\n", "\r\n")})
    assert answer.status_code == 422
    line = next(n for n, text in enumerate(wrong.splitlines(), 1) if text.startswith("[bodys"))
    assert f'<li value="{line}" class="wrong">' in answer.text
    assert 'aria-invalid="true"' in answer.text
    assert "<script>" not in client.post(
        f"/mechanisms/{PENDULUM}/edit", data={**csrf, "text": "'<script>' = 1"}
    ).text.replace("<script src", "")


@pytest.mark.processes
def test_editor_knows_the_schema(browser):
    """The field names the document from which its proposals come; a browser keeps it."""
    client, log_in = browser
    log_in()
    address = re.search(r'data-schema="([^"]+)"', client.get(f"/mechanisms/{PENDULUM}/edit").text)[1]
    answer = client.get(address)
    assert answer.json() == mechanism_schema()
    assert client.get(address, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304


@pytest.mark.processes
def test_saved_as_versions(browser):
    """A stale version is refused; a shipped name too; the upload of a file saves it."""
    client, log_in = browser
    csrf = log_in()
    form = {**csrf, "text": TEXT, "action": "save", "save_as": "mine"}
    saved = client.post(f"/mechanisms/{PENDULUM}/edit", data=form)
    assert (saved.status_code, saved.headers["location"]) == (303, "/mechanisms/mine")
    assert client.post("/mechanisms/mine/edit", data={**form, "version": "1"}).status_code == 303
    stale = client.post("/mechanisms/mine/edit", data={**form, "version": "1"})
    assert stale.status_code == 409
    assert "version 2" in stale.text
    for name in ("c60", "../x", ""):
        refused = client.post("/mechanisms/mine/edit", data={**form, "save_as": name})
        assert refused.status_code in (409, 422)
    upload = {"file": ("latch.toml", TEXT.encode())}
    assert client.post("/mechanisms", data={**csrf, "name": "latch"}, files=upload).status_code == 303
    assert client.get("/mechanisms/latch").status_code == 200
    assert "latch" in client.get("/mechanisms").text
    binary = client.post("/mechanisms", data={**csrf, "name": "x"}, files={"file": ("x", b"\xff\xfe")})
    assert binary.status_code == 422


@pytest.mark.processes
@pytest.mark.parametrize("path", ["", f"/{PENDULUM}", f"/{PENDULUM}/edit", f"/{PENDULUM}/try?run=true"])
def test_pages_have_no_fault(browser, path):
    """Fields have labels, writes the session's word, and nothing is inline."""
    client, log_in = browser
    log_in()
    answer = client.get(f"/mechanisms{path}")
    assert answer.status_code == 200
    assert Page(answer.text).faults == []


@pytest.mark.processes
def test_form_leads_to_the_runs_address(browser):
    """What is as it was shown is left out of the address."""
    client, log_in = browser
    log_in()
    shown = client.get("/mechanisms/c60/try").text
    assert 'name="value:J1" value="0.07"' in shown
    form = {"was": "", "value:J1": "0.05", "value:J2": "0.07", "free-key": "gravity.y", "free-value": "1e-5"}
    answer = client.get("/mechanisms/c60/try", params={**form, "bench": "", "preset": "prototype"})
    wanted = "/mechanisms/c60/try?set=J1%3D0.05&set=gravity.y%3D1e-5&preset=prototype&run=true"
    assert (answer.status_code, answer.headers["location"]) == (303, wanted)


@pytest.mark.processes
def test_run_shows_numbers_and_motion(browser):
    client, log_in = browser
    log_in()
    shown = client.get("/mechanisms/c60/try?set=J1=0.05&run=true").text
    assert "FC-1" in shown
    assert f"{simulate(load_mechanism('c60'), {'J1': 0.05}).responses['FC-1']:.6g}" in shown
    assert "/api/v1/simulations/c60/motion.gif?set=J1%3D0.05" in shown
    frames = json.loads(re.search(r"data-motion='([^']*)'", shown)[1])
    assert len(frames["time"]) > 20
    assert shown.count("data-body") == len(frames["bodies"]) == 8
    assert re.search(r'class="outline" fill="#[0-9A-F]{6}" d="M[\d.]+ ', shown)  # a still picture without scripts
    assert "J1: play 0.0500 mm" in shown
    assert 'name="value:J1" value="0.05"' in shown
    facts = dict(re.findall(r"<div><dt>([^<]*)</dt><dd>([^<]*)</dd></div>", shown))
    of_unit = {name.partition(" [")[0]: name.partition(" [")[2].rstrip("]") for name in facts if "[" in name}
    assert of_unit == {
        **{"simulated time": "ms", "real time": "s", "max penetration": "mm", "max violation": "mm"},
        **dict.fromkeys(("max created energy", "created energy", "max lost energy", "lost energy"), "mJ"),
        **{"max kinetic energy": "mJ", "max turn": "rad", "start travel": "mm"},
    }
    run = simulate(load_mechanism("c60"), {"J1": 0.05})
    assert facts["simulated time [ms]"] == f"{run.certificate.time:.4g}"
    preset = client.get("/mechanisms/c60/try?preset=prototype").text
    assert 'name="value:J1" value="0.085"' in preset
    wrong = client.get("/mechanisms/c60/try?set=J99=1")
    assert wrong.status_code == 422
    assert "J99" in wrong.text
    log_in("viewer")
    assert "needs the role engineer" in client.get("/mechanisms/c60/try?set=J1=0.05").text


@pytest.mark.processes
@pytest.mark.parametrize("path", ["/mechanisms", f"/mechanisms/{PENDULUM}/edit"])
def test_writes_need_a_role_and_an_own_page(browser, path):
    client, log_in = browser
    form = {"text": TEXT, "name": "x", "save_as": "x", "action": "save"}
    files = {"file": ("x.toml", TEXT.encode())}
    csrf = log_in("viewer")
    assert client.post(path, data={**csrf, **form}, files=files).status_code == 403
    csrf = log_in("engineer")
    assert client.post(path, data=form, files=files).status_code == 403
    foreign = {"Origin": "https://evil.example"}
    assert client.post(path, data={**csrf, **form}, files=files, headers=foreign).status_code == 403
    client.cookies.clear()
    assert client.post(path, data={**csrf, **form}, files=files).status_code == 401
