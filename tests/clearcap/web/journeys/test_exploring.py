"""What a user asks of finished rows: what-if, samples, comparison, export; by keyboard, in a wide window and not."""

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.chromium import needs_axe, needs_chromium

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
CPK = "return document.querySelector('[data-cpk=\"FC-6\"]')?.textContent"
CARD = "return document.querySelector('#answer article[aria-label=\"FC-6\"]').innerText"
IN_SIGHT = """const r = document.getElementById('summary').getBoundingClientRect();
return r.height > 0 && r.top >= 0 && r.bottom <= innerHeight"""
BRUSH = "return Number(document.querySelector('.parallel .brush').getAttribute('height'))"
GREY = "return getComputedStyle(document.querySelector('.card.refused h3')).filter"


def _ask(user, campaign, tab):
    """Open a campaign and go to one of its tabs."""
    user.open(f"/campaigns/{campaign}")
    user.go(tab, "a")
    user.look()


def _slide(user, name, key, times=1):
    """Press a key on a slider."""
    slider = user.tab_to(name, "input")
    for _ in range(times):
        slider.send_keys(key)


def test_an_answer_follows_a_slider(user, finished):
    """The number, the capability and the address move with it; the address alone gives the same answer."""
    home = f"/campaigns/{finished.first}/whatif"
    _ask(user, finished.first, "What if")
    assert user.path == home
    assert user.browser.execute_script(CPK) is None
    _slide(user, "J1: std", Keys.ARROW_LEFT, 10)
    user.until(lambda: user.path == f"{home}?set=J1.std%3D0.0147", "the address of the question")
    assert user.browser.find_element("id", "v.J1.std").get_attribute("value") == "0.0147"
    first = user.until(lambda: user.browser.execute_script(CPK), "a Cpk")
    _slide(user, "J1: std", Keys.ARROW_LEFT, 10)
    user.until(lambda: user.path == f"{home}?set=J1.std%3D0.0119", "the address of the next question")
    user.until(lambda: user.browser.execute_script(CPK) != first, "another Cpk")
    user.look()
    shown = user.browser.execute_script(CARD)
    assert "ppm out of limits" in shown
    summary = user.browser.execute_script(IN_SIGHT)
    assert summary == (user.width < 900), "on a telephone the results are in sight wherever the sliders are"
    user.open(user.path)
    assert user.browser.execute_script(CARD) == shown
    assert user.browser.find_element("css selector", "[data-for='v.J1.std']").get_attribute("value") == "0.0119"
    user.go("Reset", "a")
    assert user.path == home


def test_what_samples_do_not_carry_is_grey(user, finished):
    """With the reason, and a way to the campaign that would tell; advice and cheapest tolerances stand below."""
    _ask(user, finished.first, "What if")
    _slide(user, "J1: mean", Keys.END)
    mean = user.browser.find_element("id", "v.J1.mean").get_attribute("value")
    user.until(lambda: user.browser.find_elements("css selector", ".card.refused"), "a refusal")
    assert "grayscale" in user.browser.execute_script(GREY)
    assert "the samples cannot answer this" in user.text
    user.look()
    user.go("Which tolerances may grow, which must shrink?", "button")
    assert "Spread may grow by" in user.text
    user.look()
    user.write("Cost of tightening (cost file)", "[variables.J1]\ncost = 1.0\n")
    user.go("Allocate", "button")
    user.look()
    assert f"set=J1.mean%3D{mean}" in user.path
    user.go("start a campaign with them", "a")
    user.look()
    text = user.browser.find_element("id", "text").get_attribute("value")
    assert f"mean = {mean}" in text


def test_a_sample_is_replayed(user, finished):
    """From the table to one sample, to its bits, its curves and its motion."""
    _ask(user, finished.first, "Samples")
    user.write("Sort by", "number", "select")
    user.write("Status", "ok", "select")
    user.go("Show", "button")
    assert user.path.endswith("/samples?sort=sample&status=ok")
    assert "400 samples" in user.text
    user.look()
    user.go("3", "a")
    user.look()
    user.go("Replay: compute it again", "button")
    assert "Same bits: yes" in user.text
    user.look(is_answer=True)
    user.go("Curves and motion", "a")
    user.until_drawn()
    assert len(user.browser.find_elements("css selector", "img.picture")) == 1
    slider = "return Number(document.querySelector('.player input').value)"
    user.write("Speed", "0.25 ×", "select")
    first = user.browser.execute_script(slider)
    user.until(lambda: user.browser.execute_script(slider) != first, "it moves")
    user.look()
    user.press("Pause", "button")
    user.tab_to("Time", "input").send_keys("\ue011")  # Home
    assert user.browser.execute_script(slider) == 0


def test_samples_are_brushed(user, finished):
    """A drag along an axis is a range of the form, table and drawings follow; a dot leads to the motion."""
    _ask(user, finished.first, "Samples")
    grip = user.browser.find_element("css selector", ".parallel .grip")
    user.browser.execute_script("arguments[0].scrollIntoView({block: 'center', inline: 'nearest'})", grip)
    drawn = len(user.browser.find_elements("css selector", ".dots circle"))
    half = int(grip.size["height"] / 2)
    drag = ActionChains(user.browser).move_to_element(grip).click_and_hold().move_by_offset(0, 1 - half)
    drag.perform()
    assert user.browser.find_elements("css selector", ".dots .off")
    drag.release().perform()
    user.until(lambda: "range=J1%3A" in user.path, "the range in the address")
    user.until(lambda: len(user.browser.find_elements("css selector", ".dots circle")) < drawn, "fewer dots")
    assert user.browser.execute_script(BRUSH) == pytest.approx(half, abs=4)
    assert not user.browser.find_elements("css selector", ".dots .off")
    user.look()
    user.open(user.path)
    dot = user.browser.find_elements("css selector", ".dots a")[-1]
    name = dot.get_attribute("aria-label")
    user.browser.execute_script("arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))", dot)
    user.until(lambda: "?pictures=true" in user.path, "the sample")
    user.until_drawn()
    assert name in user.text
    assert user.browser.find_elements("css selector", ".player input")


def test_what_can_be_pooled_is_said(user, finished):
    _ask(user, finished.first, "Pool")
    assert "The store has no campaign that can be pooled with this one" in user.text
    user.go("New campaign with another seed", "a")
    assert "Differences to" in user.text
    user.look()


def test_two_campaigns_are_compared(user, finished):
    _ask(user, finished.wider, "Compare")
    user.write("With the campaign", finished.first)
    user.go("Compare", "button")
    assert user.path.endswith(f"/compare?with={finished.first}")
    assert "Difference = this minus the other" in user.text
    user.look()
    user.go("Write the report of this comparison", "button")
    assert "The report of this comparison: " in user.text
    user.look()


def test_rows_are_downloaded(user, finished, tmp_path):
    """The page says what is in the file, and the file has it."""
    _ask(user, finished.first, "Export")
    user.write("Format", "csv", "select")
    user.write("Columns, with spaces between them; all if empty", "sample FC-1")
    user.write("First sample", "3")
    user.write("Last sample", "7")
    user.go("Show", "button")
    user.look()
    user.browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    user.press(f"Download {finished.first}.csv", "a")
    exported = tmp_path / f"{finished.first}.csv"
    user.until(exported.exists, "the download")
    lines = exported.read_text().splitlines()
    assert lines[0].replace('"', "") == "sample,FC-1"
    assert [line.split(",")[0] for line in lines[1:]] == ["3", "4", "5", "6", "7"]
