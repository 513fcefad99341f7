"""A browser that runs no scripts: every page shows what it has, and every form is sent; by keyboard alone."""

import re
from urllib.parse import urlsplit

import pytest

from clearcap.web.operations.mechanisms import shipped_text
from tests.chromium import needs_chromium
from tests.clearcap.web.conftest import PASSWORD
from tests.clearcap.web.journeys.conftest import FEWER, browsers

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium]
FORBIDDEN = {"profile.managed_default_content_settings.javascript": 2}
OWN = """\
format = 1
name = "patient"
title = "A campaign that takes its time"
mechanism = "clearance_pendulum"
samples = 5000
seed = 3
decide = { runs = 0 }

[variables.J1]
distribution = "uniform"
lower = 4e-4
upper = 6e-4

[responses.drop]
lsl = -7e-4
usl = -3e-4
source = "a test"
"""


@pytest.fixture(scope="module")
def someone(tmp_path_factory, finished):
    """Return somebody at a browser that runs no scripts."""
    with browsers(tmp_path_factory) as open_browser:
        yield open_browser(finished.server.url, 1400, preferences=FORBIDDEN, with_axe=False)


@pytest.fixture
def unscripted(someone, finished):
    """Return an approver there, who has just logged in."""
    someone.begin_anew()
    someone.browser.delete_all_cookies()
    someone.log_in(finished.user, PASSWORD)
    return someone


def test_no_script_runs(unscripted, finished):
    """The pages know it: sliders are hidden, and a campaign that is computed is loaded again and again."""
    unscripted.open(f"/campaigns/{finished.first}/whatif?set=J1.std%3D0.015")
    ranges = unscripted.browser.find_elements("css selector", "input[type=range]")
    assert len(ranges) == 28
    assert not any(each.is_displayed() for each in ranges)


def test_pages_show_their_content(unscripted, finished):
    """Each has what it is there for, and writes nothing to the console."""
    home = f"/campaigns/{finished.first}"
    for path, words in (
        ("/campaigns", "C-60 circuit breaker, ON position: seven joint clearances"),
        (home, "400 of 400"),
        (f"{home}/histograms", "Preliminary: these intervals assume"),
        (f"{home}/report", "report.html"),
        (f"{home}/samples", "400 samples"),
        (f"{home}/samples/3?pictures=true", "max_residual"),
        (f"{home}/whatif?set=J1.std%3D0.015", "ppm out of limits"),
        (f"/campaigns/{finished.wider}/compare?with={finished.first}", "Difference = this minus the other"),
        (f"{home}/pool", "New campaign with another seed"),
        (f"{home}/export", "curl -H"),
        (f"{home}/signoff", "Sign plan, rows and report as ada"),
        (f"{home}/share", "Make a link"),
        ("/campaigns/new", "Write the file"),
        ("/campaigns/new?shipped=c60_spring", "No difference to c60_spring"),
        ("/work", "Workers that compute"),
        ("/mechanisms", "Pendulum on a bolt with play"),
        ("/mechanisms/c60", "needle to pin, X"),
        ("/mechanisms/c60/edit", "Save as a version"),
        ("/mechanisms/lever/try", "Simulate"),
        ("/account", "Make a token"),
        ("/help", "The API"),
    ):
        unscripted.open(path)
        assert words in unscripted.text, path
        unscripted.look()


def test_a_campaign_is_made_and_ended(unscripted):
    """The buttons between form and file; then cancel, resume, labels, and the end."""
    user = unscripted
    user.open("/campaigns/new?mechanism=clearance_pendulum")
    user.write("Name (start of the id)", "patient")
    user.go("Write the file", "button")
    assert 'name = "patient"' in user.browser.find_element("id", "text").get_attribute("value")
    user.write("Campaign file, TOML", OWN, "textarea")
    user.go("Read the file", "button")
    assert user.browser.find_element("id", "v0.upper").get_attribute("value") == "0.0006"
    user.press("Choose from the numbers of the mechanism", "summary")
    user.write("Search", "friction")
    user.go("Search", "button")
    assert " numbers" in user.text
    user.go("Check", "button")
    assert "No faults" in user.text
    user.go("Submit", "button")
    home = urlsplit(user.path).path
    assert home.startswith("/campaigns/patient-")
    refresh = '<meta http-equiv="refresh" content="10">'
    assert refresh in user.browser.page_source
    user.go("Stop (finished rows are kept)", "button")
    # the state is there a moment before the request is taken back
    user.until(lambda: _state(user, home) == "cancelled" and refresh not in user.browser.page_source, "the end")
    user.go("Resume", "button")
    user.until(lambda: _state(user, home) in ("queued", "running"), "another beginning")
    user.go("Stop (finished rows are kept)", "button")
    user.until(lambda: _state(user, home) == "cancelled", "the end")
    user.press("Owner, tags, note", "summary")
    user.write("Tags, with spaces between them", "slow")
    user.go("Save", "button")
    user.open("/campaigns")
    user.write("Search", "patient")
    user.go("Show", "button")
    assert "search=patient&state=&owner=&tag=&sort=newest" in user.path
    user.until(lambda: _found(user) == ["slow"], "the campaign in the list, with its tag")
    assert "1 campaign\n" in user.text
    user.open(home)
    user.press("Delete", "summary")
    own_id = home.removeprefix("/campaigns/")
    user.write(f"All rows will be lost. Type the id {own_id} to delete it", own_id)
    user.go("Delete", "button")
    assert user.path == "/campaigns"
    user.open(home)
    assert f"no campaign {own_id}" in user.text


def _found(user):
    """Load the page again; return the tags of the campaigns that it lists."""
    user.browser.refresh()
    return [each.text for each in user.browser.find_elements("css selector", "a.tag")]


def _state(user, home):
    """Load the page of a campaign; return its state."""
    user.open(home)
    return user.browser.find_element("css selector", "[data-field=state]").text


def test_rows_are_asked(unscripted, finished):
    """What-if, advice, samples, replay, comparison: each form leads to an address."""
    user, home = unscripted, f"/campaigns/{finished.first}"
    user.open(f"{home}/whatif")
    user.write("Other settings, VARIABLE.KEY=VALUE, one on each line", "J1.std=0.015")
    user.go("Update", "button")
    assert user.path == f"{home}/whatif?set=J1.std%3D0.015"
    assert user.browser.find_element("css selector", "[data-cpk='FC-6']").text
    user.go("Which tolerances may grow, which must shrink?", "button")
    assert "Spread may grow by" in user.text
    assert "set=J1.std%3D0.015" in user.path
    user.open(f"{home}/samples")
    user.write("Sort by", "number", "select")
    user.go("Show", "button")
    user.go("3", "a")
    user.go("Replay: compute it again", "button")
    assert "Same bits: yes" in user.text
    user.open(f"{home}/compare")
    user.write("With the campaign", finished.wider)
    user.go("Compare", "button")
    assert "Difference = this minus the other" in user.text


def test_a_mechanism_is_tried(unscripted):
    """Numbers without sliders; the editor marks a fault beside its line and saves what has none."""
    user = unscripted
    user.open("/mechanisms/lever/try")
    user.write("pin [mm]", "0.1")
    user.go("Simulate", "button")
    assert "set=pin%3D0.1" in user.path
    assert "Outcome: ok" in user.text
    user.until_drawn()
    text = shipped_text("lever").decode()
    user.open("/mechanisms/lever/edit")
    _replace(user, text.replace("[joints.pin]", "[joint.pin]"))
    user.go("Check", "button")
    marked = user.browser.find_element("css selector", "ol.lines li.wrong")
    assert "[joint.pin]" in marked.text
    _replace(user, text)
    user.write("Save as", "unscripted")
    user.go("Save as a version", "button")
    assert user.path == "/mechanisms/unscripted"


def _replace(user, text):
    """Replace what the editor holds, at once: typing the file would take half a minute."""
    area = user.tab_to("Text of the file, TOML", "textarea")
    user.browser.execute_script("arguments[0].value = arguments[1]", area, text)


def test_a_campaign_is_shared_and_signed(unscripted, keyboard, finished):
    """Who has the link reads the campaign; who signed it is shown; then nobody is logged in."""
    user, home = unscripted, f"/campaigns/{finished.wider}"
    user.open(f"{home}/share")
    user.write("For whom", "the other browser")
    user.go("Make a link", "button")
    link = re.search(r"http://\S+/shared/\S+", user.text)[0]
    guest = keyboard(user.url, 1400, preferences=FORBIDDEN, with_axe=False)
    guest.open(link)
    guest.until(lambda: guest.path == home, "the shared campaign")
    assert f"{FEWER} of {FEWER}" in guest.text
    user.go("Revoke the link for the other browser", "button")
    guest.open(home)
    assert guest.path.startswith("/login")
    user.open(f"{home}/signoff")
    user.write("Comment", "without scripts")
    user.go("Sign plan, rows and report as ada", "button")
    assert "Status: signed" in user.text
    user.go("Log out", "button")
    assert user.path == "/login"
