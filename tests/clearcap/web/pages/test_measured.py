"""Measured parts that are sent to the service: their report is that of the command, and they stay data."""

import io
import json

import numpy as np
import openpyxl
import pytest
from starlette.concurrency import run_in_threadpool

from campaign.store import measured_library
from campaign.store.labels import LabelChange, change_labels
from campaign.store.monitored_library import Monitored, add_monitored, read_monitored
from clearcap.questions import measurement_table
from clearcap.questions.measured import capability_report
from clearcap.web.http.authentication import CSRF_FIELD, CSRF_HEADER
from clearcap.web.index import entry_of
from clearcap.web.operations import measured as operations
from clearcap.web.webhooks import campaign_events
from tests.clearcap.web.pages.forms import Page
from tests.each import each

CALL = "/api/v1/measured"
LIMITS = 'title = "Lever"\n[characteristics.d]\nunit = "mm"\nlsl = 19.98\nusl = 20.02\nsource = "drawing"\n'
TABLE = "\n".join(["d", *(f"{x:.4f}" for x in np.random.default_rng(5).normal(20.0, 0.004, 60))]) + "\n"


@pytest.fixture(autouse=True)
def computes_here(served, monkeypatch):
    """Compute in this process."""

    async def data(_, job, *arguments):
        return await run_in_threadpool(job, *arguments)

    monkeypatch.setattr(served[0].pool, "data", data)


@pytest.fixture
def send(client, as_user):
    """Return what sends a table with its limits over the API, as an engineer."""

    def sent(table=TABLE, limits=LIMITS, name="lever.csv", role="engineer"):
        content = table if isinstance(table, bytes) else table.encode()
        files = {"file": (name, content), "limits": ("limits.toml", limits.encode())}
        return client.post(CALL, files=files, headers=as_user(role))

    return sent


def test_report_is_that_of_the_command(send, client, as_user, tmp_path):
    """Every number; table and limits come back as they were sent, and the same table is kept once."""
    (tmp_path / "lever.csv").write_text(TABLE)
    (tmp_path / "limits.toml").write_text(LIMITS)
    capability_report(tmp_path / "lever.csv", tmp_path / "limits.toml", tmp_path / "report", ["json"])
    expected = json.loads((tmp_path / "report" / "capability.json").read_text())
    made = send()
    assert made.status_code == 201, made.text
    found = made.json()
    assert (found["by"], found["file"], found["parts"], found["title"]) == ("engineer", "lever.csv", 60, "Lever")
    assert (found["headline"], found["verdicts"]) == (expected["headline"], {"d": "capable, not certain"})
    where, viewer = f"{CALL}/{found['id']}/files/", as_user("viewer")
    got = client.get(f"{where}capability.json", headers=viewer).json()
    expected.pop("written")
    got.pop("written")
    assert got == expected
    assert client.get(f"{where}table.csv", headers=viewer).text == TABLE
    assert client.get(f"{where}limits.toml", headers=viewer).text == LIMITS
    page = client.get(f"{where}report.html", headers=viewer)
    assert page.headers["content-security-policy"].startswith("sandbox")
    again = send(role="admin")
    assert (again.status_code, again.json()) == (200, found)


def test_list_comes_in_pages(send, client, as_user):
    """The newest first; one that is deleted between two pages repeats and hides nothing."""
    ids = [send(limits=LIMITS + f"# {number}\n").json()["id"] for number in range(5)]
    viewer = as_user("viewer")
    first = client.get(CALL, params={"limit": 2}, headers=viewer).json()
    assert ([each["id"] for each in first["measured"]], first["total"]) == (ids[:2:-1], 5)
    assert client.delete(f"{CALL}/{ids[3]}", headers=as_user("engineer")).status_code == 204
    second = client.get(CALL, params={"limit": 2, "cursor": first["next"]}, headers=viewer).json()
    third = client.get(CALL, params={"limit": 2, "cursor": second["next"]}, headers=viewer).json()
    assert [each["id"] for each in (*second["measured"], *third["measured"])] == ids[2::-1]
    assert third["next"] is None
    assert client.get(CALL, params={"cursor": "x"}, headers=viewer).status_code == 422


def test_only_who_sent_it_and_admins_delete(send, service, client, as_user):
    names = [send(limits=LIMITS + f"# {number}\n").json()["id"] for number in range(2)]
    statuses = [client.delete(f"{CALL}/{names[0]}", headers=as_user(r)).status_code for r in ("viewer", "approver")]
    assert statuses == [403, 403]
    for name, role in zip(names, ("engineer", "admin"), strict=True):
        assert client.delete(f"{CALL}/{name}", headers=as_user(role)).status_code == 204
        assert client.get(f"{CALL}/{name}", headers=as_user("viewer")).status_code == 404
    assert [name for name in service.store.files.stamps("measured") if "json" in name] == []
    assert client.delete(f"{CALL}/{names[0]}", headers=as_user("engineer")).status_code == 404
    assert send(role="viewer").status_code == 403


REFUSED = {
    "another column": (TABLE.replace("d", "e", 1), LIMITS, "a.csv", "no column d"),
    "no number": (TABLE + "twenty\n", LIMITS, "a.csv", "twenty is no number"),
    "another file": (TABLE, LIMITS, "a.exe", "ends in none of"),
    "damaged": (b"PK\x03\x04", LIMITS, "a.xlsx", "not a table"),
    "no limits": (TABLE, "", "a.csv", "characteristics"),
    "no TOML": (TABLE, "[", "a.csv", "limits"),
    "another key": (TABLE, LIMITS.replace("lsl", "lls"), "a.csv", "lls"),
}


@each("case", REFUSED)
def test_what_does_not_fit_is_not_kept(case, send, service):
    """It is said what is wrong, without a folder of the server."""
    table, limits, name, words = REFUSED[case]
    answer = send(table, limits, name)
    assert answer.status_code == 422, answer.text
    assert words in answer.text
    assert "clearcap-" not in answer.text
    assert "/tmp" not in answer.text
    assert service.store.files.names("measured") == []


def test_sizes_are_bounded(send, monkeypatch):
    """Of the table, of what is packed in an Excel file, of the limits, and the number of tables."""
    book = io.BytesIO()
    openpyxl.Workbook().save(book)
    monkeypatch.setattr(measurement_table, "LARGEST_UNPACKED", 10)
    assert "unpacked" in send(book.getvalue(), name="a.xlsx").json()["detail"]
    assert send(limits=LIMITS + "#" * 10**6).status_code == 413
    monkeypatch.setattr(measured_library, "MOST_TABLES", 1)
    assert [send().status_code, send(limits=LIMITS + "#\n").status_code] == [201, 409]
    monkeypatch.setattr(operations, "LARGEST_PARTS", 10)
    assert send().status_code == 413


FORMULA = '=HYPERLINK("http://evil.example","x")'


def test_a_formula_is_a_text(send, client, as_user):
    """One in a table is not computed; none of the limits file becomes one of the workbook."""
    book = openpyxl.Workbook()
    for row in ["d", *(20.0 + number / 1000 for number in range(12)), "=20+1"]:
        book.active.append([row])
    book.save(content := io.BytesIO())
    limits = LIMITS.replace("Lever", FORMULA.replace('"', "'")) + f"[header]\n'{FORMULA}' = '{FORMULA}'\n"
    made = send(content.getvalue(), limits, name="=cmd|' /C calc'!A0.xlsx")
    assert made.status_code == 201, made.text
    found = made.json()
    assert found["file"].endswith(".xlsx")
    where, viewer = f"{CALL}/{found['id']}/files/", as_user("viewer")
    document = client.get(f"{where}capability.json", headers=viewer).json()
    assert document["responses"][0]["capability"]["n"] == 12
    sheets = openpyxl.load_workbook(io.BytesIO(client.get(f"{where}report.xlsx", headers=viewer).content))
    cells = [cell for sheet in sheets for row in sheet.iter_rows() for cell in row]
    assert FORMULA in [cell.value for cell in cells]
    assert "f" not in {cell.data_type for cell in cells}


@each("name", ["../../../x.csv", "/etc/passwd.csv", "a\\b\\c.csv", ".csv.csv", "\u202egnp.csv", "ü" * 300 + ".csv"])
def test_any_name_of_a_file(name, send, service):
    """It is kept as a name, and leads nowhere."""
    made = send(name=name, limits=f"{LIMITS}# {len(name)}\n")
    assert made.status_code == 201, made.text
    kept = made.json()
    assert kept["file"].isprintable()
    assert not {"/", "\\"} & set(kept["file"])
    assert "table.csv" in service.store.files.names(f"measured/{kept['id']}")


def test_pages(client, browse):
    """The form leads to the report, and shows what is wrong; markup is text."""
    csrf = {CSRF_FIELD: browse("engineer")[CSRF_HEADER]}
    headers = {key: value for key, value in browse("engineer").items() if key != CSRF_HEADER}
    csrf = {CSRF_FIELD: browse("engineer")[CSRF_HEADER]}
    files = {"file": ("lever.csv", TABLE.encode()), "limits": ("l.toml", LIMITS.replace("Lever", "<b>x</b>").encode())}
    made = client.post("/measured", data=csrf, files=files, headers=headers)
    assert made.status_code == 303, made.text
    shown = client.get(made.headers["location"]).text
    assert '<iframe class="report" sandbox="allow-popups"' in shown
    assert "&lt;b&gt;x&lt;/b&gt;" in shown
    assert "&lt;b&gt;x&lt;/b&gt;" in client.get("/measured").text
    wrong = {**files, "limits": ("l.toml", b'title = "x"\n[characteristics.d]\nlls = 3.0\n')}
    refused = client.post("/measured", data=csrf, files=wrong, headers=headers)
    assert refused.status_code == 422
    assert "line 3" in refused.text
    assert client.post(f"{made.headers['location']}/delete", data=csrf, headers=headers).status_code == 303
    assert "0 tables" in client.get("/measured").text


def test_measured_lots_are_posted_against_a_campaign(reported, client, as_user, service):
    """By its owner's token: the answer is kept, the list has it, and a fall is an event of webhooks."""
    change_labels(service.store, reported, LabelChange(owner="engineer"), by="test")
    where = f"/api/v1/campaigns/{reported}/monitor"
    assert client.get(where, headers=as_user("viewer")).status_code == 404
    rows = "\n".join(["bore", *(f"{0.07 + 0.0002 * (7 * row % 61 - 30):.4f}" for row in range(61))])
    files = {
        "file": ("night.csv", rows.encode()),
        "limits": ("limits.toml", b'[characteristics.J1]\ncolumn = "bore"\nunit = "mm"\n'),
    }
    assert client.post(where, files=files, headers=as_user("approver")).status_code == 403
    made = client.post(where, files=files, headers=as_user("engineer"))
    assert made.status_code == 200, made.text
    found = made.json()
    assert (found["number"], found["by"], found["table"]) == (1, "engineer", "night.csv")
    assert found["variables"][0]["variable"] == "J1"
    assert client.get(where, headers=as_user("viewer")).json() == found
    assert client.get(f"/api/v1/campaigns/{reported}", headers=as_user("viewer")).json()["monitored"] == 1
    wrong = client.post(where, files={"file": ("night.csv", b"x\n1\n")}, headers=as_user("engineer"))
    assert wrong.status_code == 422
    assert "no column has the name of a variable" in wrong.json()["detail"]


def test_page_of_measured_lots(reported, client, browse, service):
    """The owner sends lots by a form, with or without limits; all users read what they say of the campaign."""
    change_labels(service.store, reported, LabelChange(owner="engineer"), by="test")
    home = f"/campaigns/{reported}/monitor"
    browse("viewer")
    shown = client.get(home)
    assert Page(shown.text).faults == []
    assert ("No measured lots" in shown.text, 'type="file"' in shown.text) == (True, False)
    for role, status in (("viewer", 403), ("approver", 403), ("engineer", 303)):
        rows = "\n".join(["J1,wrong", *(f"{0.07 + 0.0002 * (7 * row % 61 - 30):.4f},1" for row in range(61))])
        files = {"file": ("<night>.csv", rows.encode()), "limits": ("", b"")}  # as a browser sends an empty field
        answer = client.post(home, files=files, data={"rerun": "false"}, headers=browse(role))
        assert answer.status_code == status, answer.text
    assert answer.headers["location"] == home
    repeated = client.post(home, files=files, data={"rerun": "false"}, headers=browse("engineer"))
    assert repeated.status_code == 303  # its answer may have been lost: the same lots are not a second entry
    shown = client.get(home)
    assert Page(shown.text).faults == []
    assert 'type="file" name="limits"' in shown.text
    assert "&lt;night&gt;.csv" not in shown.text  # what a name may not have was replaced
    assert "Lots number 1, _night_.csv, sent by engineer" in shown.text
    for words in ("<strong>J1</strong>", 'data-label="Parts">61</td>', "<strong>FC-1</strong>", "whatif?set=J1."):
        assert words in shown.text
    wrong = client.post(home, files={"file": ("night.csv", b"x\n1\n")}, headers=browse("engineer"))
    assert (wrong.status_code, "no column has the name of a variable" in wrong.text) == (422, True)
    assert "Lots number 1," in wrong.text
    with_limits = {"file": ("night.csv", rows.replace("J1", "bore").encode())}
    with_limits["limits"] = ("l.toml", b'[characteristics.J1]\ncolumn = "bore"\n')
    assert client.post(home, files=with_limits, headers=browse("engineer")).status_code == 303
    low = {"response": "FC-2", "by": "cpk", "index": 1.1, "interval": (1.0, 1.2), "requirement": 1.33, "below": True}
    silent = {"response": "FC-1", "requirement": 1.33, "refusal": "too <far>"}
    last = read_monitored(service.store, reported)
    new = Monitored(number=1, at=1.7e9, settings=[], variables=[], responses=[low, silent])
    add_monitored(service.store, reported, new, last)
    text = client.get(home).text
    assert "below the requirement" in text.partition("FC-2")[2]
    assert "too &lt;far&gt;" in text
    assert "lots number 3: <strong>FC-2</strong> 1.100, required 1.33" in text


def test_a_fall_is_an_event(service, reported):
    """Of the owner's webhooks, once for each fall, with what was measured; parts without an answer are no rise."""
    change_labels(service.store, reported, LabelChange(owner="engineer"), by="test")
    low = {"response": "FC-1", "by": "cpk", "index": 1.1, "interval": (1.0, 1.2), "requirement": 1.33, "below": True}
    empty = {"number": 1, "at": 1.7e9, "settings": [], "variables": []}
    silent = {"response": "FC-1", "requirement": 1.33, "refusal": "too far from the rows"}
    before = None
    for response in (low, low, {**low, "below": False}, low, silent, silent, low):
        new = Monitored.model_validate({**empty, "responses": [response]})
        before = add_monitored(service.store, reported, new, before)
    events = campaign_events(entry_of(service.store, reported), "https://clearcap.example")
    falls = [event for event in events if event.content["event"] == "index.below"]
    assert [event.content["number"] for event in falls] == [1, 4]
    assert "engineer" in falls[0].people
    assert (falls[0].content["response"], falls[0].content["interval"]) == ("FC-1", [1.0, 1.2])
    assert len({event.key for event in events}) == len(events)
