"""The page on which a campaign is made: form and file make each other, faults are marked, and what is sound is sent."""

import re
import tomllib
from html import unescape

import pytest

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_FIELD
from clearcap.web.operations.mechanisms import shipped_text
from clearcap.web.pages.campaign_draft import shipped_campaign, with_variable
from clearcap.web.settings import Settings
from tests.campaign.conftest import SPEC
from tests.clearcap.web.conftest import URL, serving
from tests.clearcap.web.pages.forms import Page

NEW = "/campaigns/new"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Return the service, a client, and what logs the client in as a user of a role."""
    folder = tmp_path_factory.mktemp("new")
    with serving(Settings(str(folder / "runs"), folder / "data", processes=1)) as (service, client):

        def log_in(role="engineer"):
            assert Role.of(role)
            client.cookies.set(COOKIE, service.sessions.begin(role))
            client.headers = {"Origin": URL, "Accept": "text/html"}

        yield service, client, log_in


def fields_of(answer):
    """Return what a browser without scripts would send of a page, but for the choices and the texts."""
    text = answer.text
    fields = dict(
        next(form for form in Page(text).forms if form["method"] == "post" and form["action"] == NEW)["fields"]
    )
    for name, inner in re.findall(r'<select id="[^"]*" name="([^"]+)"[^>]*>(.*?)</select>', text, re.DOTALL):
        chosen = re.search(r'<option value="([^"]*)" selected', inner)
        fields[name] = unescape(chosen[1]) if chosen else unescape(re.search(r'<option value="([^"]*)"', inner)[1])
    fields["text"] = text_of(answer)
    fields.pop("upload", None)
    fields.pop("action", None)
    return fields


def text_of(answer):
    """Return the file that a page shows."""
    return unescape(re.search(r'<textarea id="text"[^>]*>\n(.*?)</textarea>', answer.text, re.DOTALL)[1])


def send(client, fields, action, **changed):
    """Press a button; browsers send the line ends of forms."""
    fields = {**fields, **changed, "action": action}
    fields["text"] = fields["text"].replace("\n", "\r\n")
    return client.post(NEW, files=[(key, (None, str(value))) for key, value in fields.items()])


@pytest.fixture
def begun(browser):
    """Return the client, and the fields of a page that has read a campaign's file."""
    _, client, log_in = browser
    log_in()
    fields = fields_of(client.get(NEW))
    answer = send(client, fields, "read", text=SPEC)
    assert answer.status_code == 200, answer.text
    return client, fields_of(answer), answer


@pytest.mark.processes
def test_empty_page(browser):
    _, client, log_in = browser
    log_in()
    answer = client.get(f"{NEW}?mechanism=clearance_pendulum")
    assert answer.status_code == 200
    assert Page(answer.text).faults == []
    assert 'role="alert"' not in answer.text
    assert tomllib.loads(text_of(answer))["mechanism"] == "clearance_pendulum"


@pytest.mark.processes
def test_file_becomes_form(begun):
    _, fields, answer = begun
    assert (fields["name"], fields["samples"], fields["seed"]) == ("demo", "25", "7")
    assert (fields["v0.name"], fields["v0.std"], fields["v0.distribution"]) == ("J1", "0.0175", "truncated_normal")
    assert (fields["v1.name"], fields["v1.target"]) == ("preload", "springs.A3.preload")
    assert [fields[f"r0.{key}"] for key in ("name", "lsl", "usl")] == ["FC-1", "9.0", "16.0"]
    assert "<polyline" in answer.text
    assert "26 runs" in answer.text
    assert Page(answer.text).faults == []


@pytest.mark.processes
def test_form_becomes_file(begun):
    """What the form does not have stays; numbers stay as they were written."""
    client, fields, _ = begun
    more = {"v0.std": "0.02", "v2.name": "J2", "v2.distribution": "uniform", "v2.lower": "0.01", "v2.upper": "0.1"}
    more |= {"samples": "300", "stop.response": "FC-1", "stop.statistic": "mean", "stop.half_width": "0.1"}
    text = fields["text"].replace("[responses.FC-1]", "[failures]\nmin_ok = 0.5\n\n[responses.FC-1]")
    answer = send(client, {**fields, **more}, "write", text=text)
    before, after = tomllib.loads(text), tomllib.loads(text_of(answer))
    before["samples"], before["variables"]["J1"]["std"] = 300, 0.02
    before["variables"]["J2"] = {"distribution": "uniform", "lower": 0.01, "upper": 0.1}
    before["stop"] = {"response": "FC-1", "statistic": "mean", "half_width": 0.1}
    assert after == before
    assert "No faults" in answer.text
    again = send(client, fields_of(answer), "check")
    assert text_of(again) == text_of(answer)


@pytest.mark.processes
def test_another_distribution_has_its_own_parameters(begun):
    client, fields, _ = begun
    answer = send(client, fields, "write", **{"v0.distribution": "uniform"})
    assert tomllib.loads(text_of(answer))["variables"]["J1"] == {
        "distribution": "uniform", "lower": 0.01, "upper": 0.13
    }  # fmt: skip
    assert "v0.mean" not in fields_of(answer)


@pytest.mark.processes
def test_a_distribution_is_given_in_one_way(begun):
    """Only its parameters are shown; another way takes over the middle, and leaves the parameters of the first out."""
    client, fields, _ = begun
    assert {"v0.mean", "v0.std", "v0.lower", "v0.upper"} <= fields.keys()
    assert not {"v0.nominal", "v0.tolerance", "v0.cpk", "v0.inertia", "v0.shift"} & fields.keys()
    assert fields["v0.given"] == "mean std"
    assert "v1.given" not in fields  # a uniform distribution has bounds only
    answer = send(client, fields, "write", **{"v0.given": "nominal tolerance cpk"})
    shown = fields_of(answer)
    assert {"v0.nominal", "v0.tolerance", "v0.cpk", "v0.shift"} <= shown.keys()
    assert not {"v0.mean", "v0.std", "v0.inertia"} & shown.keys()
    assert (shown["v0.nominal"], shown["v0.given"]) == ("0.07", "nominal tolerance cpk")
    answer = send(client, shown, "write", **{"v0.tolerance": "0.05", "v0.cpk": "1.1", "v0.shift": "0.01"})
    assert tomllib.loads(text_of(answer))["variables"]["J1"] == {
        **{"distribution": "truncated_normal", "lower": 0.01, "upper": 0.13},
        **{"nominal": 0.07, "tolerance": 0.05, "cpk": 1.1, "shift": 0.01},
    }
    assert "No faults" in answer.text
    inertia = fields_of(send(client, fields_of(answer), "write", **{"v0.given": "nominal inertia"}))
    assert (inertia["v0.inertia"], inertia["v0.shift"]) == ("", "0.01")
    assert "v0.cpk" not in inertia
    back = fields_of(send(client, inertia, "write", **{"v0.given": "mean std"}))
    assert (back["v0.mean"], back["v0.std"]) == ("0.07", "")
    assert "v0.shift" not in back


@pytest.mark.processes
def test_parameters_of_two_ways_are_a_fault_that_is_seen(begun):
    """What a file gives beside the others has a field, so that one can empty it."""
    client, fields, _ = begun
    answer = send(client, fields, "read", text=fields["text"].replace("std = 0.0175", "std = 0.0175\ncpk = 1.33"))
    assert fields_of(answer)["v0.cpk"] == "1.33"
    assert "No faults" not in answer.text
    assert "cpk" in fields["text"] or "cpk" in text_of(answer)


@pytest.mark.processes
def test_keys_are_picked(begun):
    """By search in names and descriptions; a picked one is a variable around the value of the mechanism."""
    client, fields, answer = begun
    assert 'value="springs.A3.preload">' in answer.text  # the fields propose it, with its value
    found = send(client, fields, "search", search="A3 PRELOAD")
    picked = re.findall(r'name="add" value="([^"]+)"', found.text)
    assert "springs.A3.preload" in picked
    assert len(picked) < 5
    assert re.search(r"springs\.A3\.preload</code>.*?<td class=\"number\">([\d.]+)</td>", found.text, re.DOTALL)
    assert text_of(found) == fields["text"]
    assert 'name="add"' not in send(client, fields, "search", search="no such number").text
    added = send(client, {**fields, "add": "springs.A3.stiffness"}, "check", samples="77")
    tables = tomllib.loads(text_of(added))
    new = tables["variables"]["A3_stiffness"]
    assert (tables["samples"], new["target"], new["distribution"]) == (77, "springs.A3.stiffness", "truncated_normal")
    assert fields_of(added)["v2.mean"] == str(new["mean"])
    for page in (answer, added):
        for key in re.findall(r'name="add" value="([^"]+)"', page.text):
            assert f'id="add-{key}"' in page.text  # by which the focus stays when the form is rendered anew
    again = send(client, {**fields_of(added), "add": "J2"}, "check")
    assert tomllib.loads(text_of(again))["variables"]["J2"].keys() == {"distribution", "mean"}
    same = send(client, {**fields_of(again), "add": "J2"}, "check")
    assert text_of(same) == text_of(again)


def test_a_picked_parameter_keeps_its_name():
    """`bite`, not `parameters_bite`; a name that a response or another variable has stays with its table."""
    keys = [{"key": key, "value": 2.0} for key in ("parameters.bite", "parameters.flush", "materials.steel.friction")]
    mechanism = {"keys": keys, "responses": {"flush": {}}}
    for key, name in (
        ("parameters.bite", "bite"),
        ("parameters.flush", "parameters_flush"),
        ("materials.steel.friction", "steel_friction"),
    ):
        (new,) = with_variable({}, mechanism, key)["variables"].items()
        assert new == (name, {"distribution": "truncated_normal", "target": key, "mean": 2.0})
    taken = with_variable({"variables": {"bite": {}}}, mechanism, "parameters.bite")
    assert list(taken["variables"]) == ["bite", "parameters_bite"]


@pytest.mark.processes
def test_the_numbers_that_an_author_names_come_first(begun):
    """Clearances, then parameters, then the other numbers of the file."""
    page = begun[0].get("/campaigns/new?mechanism=lever").text
    offered = re.findall(r'name="add" value="([^"]+)"', page)
    kinds = [key.startswith("parameters.") for key in offered]
    assert "." not in offered[0]
    assert kinds.index(True) == sum("." not in key for key in offered)
    assert all(kinds[kinds.index(True) :][: sum(kinds)])


@pytest.mark.processes
def test_begun_with_a_shipped_campaign(begun):
    """The file is the shipped one; what differs from it is shown, and whether rows change."""
    client, _, _ = begun
    start = client.get(f"{NEW}?shipped=c60_spring")
    assert tomllib.loads(text_of(start)) == tomllib.loads(shipped_campaign("c60_spring"))
    assert "No difference to c60_spring" in start.text
    changed = send(client, fields_of(start), "check", samples="77", seed="123456")
    assert "Differences to c60_spring: 2" in changed.text
    rows = re.findall(r"<code>(samples|seed)</code></th><td>[^<]*</td><td>(\d+)</td><td>([^<]*)</td>", changed.text)
    assert sorted(rows) == [("samples", "77", "the report only"), ("seed", "123456", "rows")]
    assert client.get(f"{NEW}?shipped=none").status_code == 404
    forged = send(client, {**fields_of(start), "origin": "campaign:../x"}, "check")
    assert "ifference" not in forged.text


def rows_of(answer):
    """Return for each row of variables and responses whether it is unfolded, by its text."""
    found = re.findall(r'<details class="row"[^>]*?( open)?><summary>(.*?)</summary>', answer.text)
    return {re.sub("<.*?>", "", text).strip(): bool(is_open) for is_open, text in found}


@pytest.mark.processes
def test_many_rows_are_folded(begun):
    """Each says what it is in a line; what lacks something or has a fault is unfolded, and so are few."""
    client, fields, _ = begun
    assert set(rows_of(send(client, fields, "check")).values()) >= {True}
    start = client.get(f"{NEW}?shipped=c60")
    rows = rows_of(start)
    assert not any(rows.values())
    assert [text for text in rows if text.startswith("J1 truncated normal, mean 0.07")]
    assert [text for text in rows if text.startswith("FC-1 [N]") and "LSL 9" in text and "USL 16" in text]
    wrong = {**fields_of(start), "v2.mean": "x", "r0.usl": "1"}
    rows = rows_of(send(client, wrong, "check"))
    assert sorted(text.split()[0] for text, is_open in rows.items() if is_open) == ["FC-1", "J3"]


@pytest.mark.processes
def test_change_of_one_side_reaches_the_other(begun):
    """Check and submit take the side that changed; where both did, nobody's work is lost."""
    client, fields, _ = begun
    assert tomllib.loads(text_of(send(client, fields, "check", samples="77")))["samples"] == 77
    text = fields["text"].replace("samples = 25", "samples = 88")
    assert fields_of(send(client, fields, "check", text=text))["samples"] == "88"
    both = send(client, fields, "submit", samples="77", text=text)
    assert both.status_code == 409
    kept = fields_of(both)
    assert (kept["samples"], "samples = 88" in kept["text"]) == ("77", True)
    assert tomllib.loads(text_of(send(client, kept, "write")))["samples"] == 77
    assert fields_of(send(client, kept, "read"))["samples"] == "88"


@pytest.mark.processes
def test_faults_are_marked_at_field_and_line(begun):
    client, fields, _ = begun
    answer = send(client, fields, "check", **{"v0.std": "-1", "samples": "many", "r0.usl": "8"})
    for name in ("v0.std", "samples"):
        tag = re.search(rf'<input id="{re.escape(name)}"[^>]*>', answer.text)[0]
        assert f'aria-invalid="true" aria-describedby="{name}-fault"' in tag
        assert f'id="{name}-fault"' in answer.text
    line = text_of(answer).splitlines().index("std = -1.0") + 1
    assert f'<li value="{line}" class="wrong">' in answer.text
    assert Page(answer.text).faults == []


@pytest.mark.processes
def test_a_file_that_is_no_toml(begun):
    """The form stays as it was; the line is shown."""
    client, fields, _ = begun
    answer = send(client, fields, "read", text=fields["text"] + "x = = 1\n")
    assert fields_of(answer)["v0.std"] == "0.0175"
    line = fields["text"].count("\n") + 1
    assert f'<li value="{line}" class="wrong">' in answer.text
    assert "No faults" not in answer.text


@pytest.mark.processes
def test_submitted_and_begun_from(browser, begun):
    """It is queued; another may begin with its file, and its page offers what follows."""
    service, client, _ = browser
    _, fields, _ = begun
    wrong = send(client, fields, "submit", samples="0")
    assert wrong.status_code == 422
    assert service.store.campaigns() == []
    answer = send(client, fields, "submit", owner="engineer", tags="night, c60")
    assert answer.status_code == 303, answer.text
    campaign = answer.headers["location"].removeprefix("/campaigns/")
    entry = service.watcher.index.entry(campaign)
    assert (entry.state, entry.owner, entry.tags) == ("queued", "engineer", ["c60", "night"])
    shown = client.get(answer.headers["location"]).text
    assert f"{NEW}?from={campaign}" in shown
    start = client.get(f"{NEW}?from={campaign}")
    assert fields_of(start)["v1.target"] == "springs.A3.preload"
    assert "The store has this campaign already" in start.text
    assert f"No difference to {campaign}" in start.text
    other = client.get(f"{NEW}?from={campaign}&seed=9&set=J1.std%3D0.02")
    assert f"Differences to {campaign}: 2" in other.text
    csrf = {CSRF_FIELD: fields["csrf"]}
    more = client.post(f"/campaigns/{campaign}/extend", data={**csrf, "samples": "60"})
    assert more.status_code == 303
    assert service.watcher.index.entry(more.headers["location"].removeprefix("/campaigns/")).samples == 60
    assert client.post(f"/campaigns/{campaign}/rerun", data=csrf).status_code == 409
    assert client.get(f"{NEW}?from=nothing").status_code == 404


@pytest.mark.processes
def test_a_file_of_its_own(begun):
    """It is kept in the page, and the campaign begun from it has its mechanism again."""
    client, fields, _ = begun
    fields |= {"text": SPEC.replace('"c60"', '"latch.toml"').replace('"demo"', '"own"'), "action": "read"}
    parts = [(key, (None, value)) for key, value in fields.items()]
    parts.append(("upload", ("latch.toml", shipped_text("c60"))))
    answer = client.post(NEW, files=parts)
    assert "No faults" in answer.text
    kept = {**fields_of(answer), "file-name": "latch.toml", "file-text": shipped_text("c60").decode()}
    made = send(client, kept, "submit")
    assert made.status_code == 303
    start = client.get(f"{NEW}?from={made.headers['location'].removeprefix('/campaigns/')}")
    assert "mechanism.toml" in start.text
    assert "No faults" in start.text


@pytest.mark.processes
@pytest.mark.parametrize("text", ["'<script>alert(1)</script>' = 1", "mechanism = '/etc/passwd'", "a = " + "[" * 9999])
def test_hostile_text_is_shown_as_text(begun, text):
    client, fields, _ = begun
    answer = send(client, fields, "read", text=text)
    assert answer.status_code == 200
    assert "<script>" not in answer.text
    assert "root:" not in answer.text
    assert "No faults" not in answer.text


@pytest.mark.processes
def test_needs_a_role_and_an_own_page(browser, begun):
    _, client, log_in = browser
    _, fields, _ = begun
    assert send(client, {**fields, "csrf": "wrong"}, "submit").status_code == 403
    client.headers = {"Origin": "https://evil.example"}
    assert send(client, fields, "submit").status_code == 403
    log_in("viewer")
    assert client.get(NEW).status_code == 403
    client.cookies.clear()
    assert client.post(NEW, files={"action": (None, "submit")}).status_code == 401
