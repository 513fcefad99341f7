"""From an empty store to a signed report, by keyboard alone, in a wide window and on a telephone."""

import re

import httpx2 as httpx
import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from tests.campaign.store.files.test_s3 import bucket, s3_server
from tests.chromium import needs_axe, needs_chromium
from tests.clearcap.web.journeys.conftest import TEXT
from tests.clearcap.web.journeys.live_server import live_server
from tests.clearcap.web.running import PATIENCE

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
OWN = "Bolt with play"
INSERTED = "<script>top.document.title = document.title = 'run'</script>"
COMPLETED = """
const [state, done] = ["state", "done"].map((name) => document.querySelector(`[data-field=${name}]`).textContent);
return window.isSame && state === "completed" ? done : null;
"""
FRAMED = "return document.querySelector('iframe.report').getBoundingClientRect().height"


@pytest.fixture(params=["folder", "s3"])
def place(request, tmp_path, monkeypatch):
    """Return the address of a store that is empty, in a folder and on S3."""
    if request.param == "folder":
        yield str(tmp_path / "runs")
        return
    with s3_server() as (_, port):
        yield bucket(monkeypatch, port)


@pytest.mark.parametrize(
    ("width", "place"), [(1400, "folder"), pytest.param(400, "s3", marks=pytest.mark.gate)], indirect=["place"]
)
def test_from_an_empty_store_to_a_signed_report(keyboard, tmp_path, width, place):
    """Each page on the way is looked at; nothing is clicked."""
    with live_server(tmp_path, store=place) as server:
        user = keyboard(server.url, width)
        _log_in(user, server.login, "admin")
        campaign = _submit(user, server)
        _follow(user, campaign)
        _share(user, keyboard, campaign)
        link = _add_approver(user)
        user.go("Log out")
        _log_in(user, link, "ada")
        _sign(user, campaign)
        _verify(user, campaign, tmp_path)
        _change(user, server.store, campaign)
        user.go("Log out")
        assert user.path == "/login"
        user.look()
        user.open("/campaigns")
        assert user.path.startswith("/login")


def _log_in(user, link, name):
    """Follow a one-time link; it works once."""
    user.open(link)
    user.until(lambda: user.path == "/campaigns", "the list after the login")
    user.look()
    assert name in user.text


def _submit(user, server):
    """Submit a campaign by the token that the page of the account makes."""
    assert "The store holds no campaign yet" in user.text
    user.go("admin")
    user.look()
    user.write("Name of the token", "journey")
    user.go("Make a token")
    user.look(is_answer=True)
    secret = re.search(r"clearcap_token_[\w-]+\S+", user.text)[0]
    answer = httpx.post(
        f"{server.url}/api/v1/campaigns",
        json={"text": TEXT},
        headers={"Authorization": f"Bearer {secret}"},
        timeout=PATIENCE,
    )
    assert answer.status_code == 201, answer.text
    return answer.json()["campaign"]


def _follow(user, campaign):
    """See the rows arrive on a page that is not loaded again before its end; then read the report."""
    user.go("Campaigns")
    user.go(OWN, "a")
    assert user.path == f"/campaigns/{campaign}"
    user.look()
    user.browser.execute_script("window.isSame = true")
    done = user.until(lambda: user.browser.execute_script(COMPLETED), "completed, on the same page")
    assert "30" in done
    user.until(lambda: not user.browser.execute_script("return window.isSame"), "the page at its end")
    user.look()
    user.until(lambda: user.go("Report", "a") or "report.html" in user.text, "the report")
    user.look()
    user.until(lambda: user.browser.execute_script(FRAMED) > 300, "the height of the report")
    user.browser.switch_to.frame(user.browser.find_element("css selector", "iframe.report"))
    user.until(lambda: OWN in user.text, "the text of the report")
    user.browser.switch_to.default_content()


def _share(user, keyboard, campaign):
    """Who has a link reads one campaign and changes nothing, until it is revoked."""
    user.go("Share", "a")
    user.look()
    user.write("For whom", "the review")
    user.go("Make a link")
    user.look(is_answer=True)
    link = re.search(r"http://\S+/shared/\S+", user.text)[0]
    guest = keyboard(user.url, user.width)
    guest.open(link)
    guest.until(lambda: guest.path == f"/campaigns/{campaign}", "the shared campaign")
    guest.look()
    assert "read only" in guest.text
    assert "Share" not in guest.text
    assert not guest.browser.find_elements("css selector", "main form")
    guest.go("Report", "a")
    guest.look()
    guest.open("/campaigns")
    assert "this link shows the campaign" in guest.text
    user.go("Revoke the link for the review")
    user.look()
    guest.open(f"/campaigns/{campaign}")
    assert guest.path.startswith("/login")


def _add_approver(user):
    """Add a user; return the link by which she logs in."""
    user.go("Administration", "a")
    user.look()
    user.write("Name", "ada")
    user.write("Role", "approver", "select")
    user.go("Add")
    user.look(is_answer=True)
    for tab in ("Tokens", "Audit trail", "System"):
        user.go(tab, "a")
        user.look()
    user.go("Users", "a")
    user.go("Make a one-time link for ada")
    link = re.search(r"http://\S+/login/link\S+", user.text)[0]
    user.go("Mechanisms", "a")
    user.look()
    user.go("Help and API", "a")
    user.look()
    return link


def _sign(user, campaign):
    """Read the campaign as an approver, and sign it."""
    user.go(OWN, "a")
    user.look()
    user.go("Sign-off", "a")
    assert "Nobody has signed" in user.text
    user.look()
    user.write("Comment", "as drawn")
    user.go("Sign plan, rows and report as ada")
    user.look()
    assert "Status: signed" in user.text
    assert "as drawn" in user.text


def _verify(user, campaign, folder):
    """Export what was signed; the command verifies it without the server."""
    user.browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})
    user.press("Export plan, rows, report and sign-offs", "a")
    exported = folder / f"{campaign}.zip"
    user.until(exported.exists, "the export")
    key = re.search(r"--key ([0-9a-f]{64})", user.text)[1]
    done = CliRunner().invoke(app, ["verify", str(exported), "--key", key])
    assert done.exit_code == 0, done.output


def _change(user, store, campaign):
    """Insert a script into the report: the sign-off shows that it differs, and the page runs nothing of it."""
    report = f"{campaign}/report/report.html"
    store.files.write(report, store.files.read(report).replace(b"</h1>", b"</h1>" + INSERTED.encode(), 1))
    user.go("Sign-off", "a")
    assert "signed version differs" in user.text
    assert "report/report.html differs" in user.text
    user.look()
    user.go("Report", "a")
    user.look()
    user.browser.switch_to.frame(user.browser.find_element("css selector", "iframe.report"))
    user.until(lambda: INSERTED in user.browser.page_source, "the changed report")
    user.until(lambda: user.browser.execute_script("return document.readyState === 'complete'"), "all of it")
    assert user.browser.execute_script("return document.title") != "run"
    user.browser.switch_to.default_content()
    assert OWN in user.browser.title
