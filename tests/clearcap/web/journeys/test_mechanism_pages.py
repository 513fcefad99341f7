"""From a shipped mechanism to one's own: edited, with a fault marked beside its line, saved, and tried."""

import pytest
from selenium.webdriver.common.keys import Keys

from tests.chromium import needs_axe, needs_chromium
from tests.engine.mechanism.geometry.latch_file import LATCH

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
TEXT = "Text of the file, TOML"
VALUES = "return [...document.querySelectorAll('section[aria-labelledby=outcome] td.number')].map(e => e.textContent)"
NUMBERED = "return [...document.querySelectorAll('.gutter .wrong')].map(e => e.textContent.trim())"


def test_a_mechanism_is_edited(user, finished):
    """Its file gets a fault and loses it again; without one it is saved, and tried with another clearance."""
    own = f"latch-{user.width}"
    user.go("Mechanisms", "a")
    user.look()
    user.go("lever", "a")
    user.until_drawn()
    user.look()
    user.go("Edit a copy", "a")
    user.look()
    assert user.browser.find_element("id", "text").size["height"] < 900  # px: it scrolls, the page does not grow
    user.tab_to(TEXT, "textarea").send_keys(Keys.CONTROL + Keys.HOME, Keys.NULL + "gravitation = 1\n")
    user.go("Check", "button")
    user.look(is_answer=True)
    marked = user.browser.find_element("css selector", "ol.lines li.wrong")
    assert marked.get_attribute("value") == "1"
    assert "gravitation" in marked.text
    assert user.browser.execute_script(NUMBERED) == ["1"]
    text = user.tab_to(TEXT, "textarea")
    text.send_keys(Keys.CONTROL + Keys.HOME, Keys.NULL, Keys.SHIFT + Keys.ARROW_DOWN, Keys.NULL, Keys.DELETE)
    user.go("Check", "button")
    user.look(is_answer=True)
    assert "No faults" in user.text
    user.write("Save as", own)
    user.go("Save as a version", "button")
    assert user.path == f"/mechanisms/{own}"
    user.look()
    _try(user, own)


def test_a_step_file_becomes_a_mechanism(user, finished):
    """Its joints are shown in 3D, what it does not say is answered there or in the text, and the mechanism is saved."""
    own = f"drawn-{user.width}"
    user.go("Mechanisms", "a")
    form = user.browser.find_element("css selector", "section[aria-labelledby=drawing]")
    form.find_element("name", "name").send_keys(own)
    form.find_element("name", "file").send_keys(str(LATCH))
    user.go("Find joints", "button")
    assert user.path == f"/mechanisms/{own}/drawing"
    user.look()
    assert "6 open questions" in user.text
    user.browser.switch_to.frame(user.browser.find_element("css selector", "iframe"))
    assert "crank-coupler" in user.browser.find_element("tag name", "body").text
    user.browser.find_element("id", "fix").click()
    user.browser.switch_to.default_content()
    text = user.browser.find_element("id", "text")
    user.until(lambda: "\nfixed = true" in text.get_property("value"), "the answer in the text")
    assert "which part is fixed?" not in text.get_property("value")
    answer = "const t = arguments[0]; t.value += '\\n# seen'; t.dispatchEvent(new Event('input'))"
    user.browser.execute_script(answer, text)
    user.browser.switch_to.frame(user.browser.find_element("css selector", "iframe"))
    user.browser.find_element("id", "fix").click()  # again free, and fixed
    user.browser.find_element("id", "fix").click()
    user.browser.switch_to.default_content()
    user.until(lambda: text.get_property("value").count("\nfixed = true") == 1, "the answer in the text")
    assert text.get_property("value").endswith("# seen")
    user.go("Check", "button")
    user.look(is_answer=True)
    assert "No faults" in user.text
    user.go("Save the mechanism", "button")
    assert user.path == f"/mechanisms/{own}"
    user.look()


def _try(user, own):
    """Move a clearance, simulate, and read what comes of it; the address alone says the same."""
    user.go("Try it", "a")
    user.look()
    slider = user.tab_to("pin, slider", "input")
    number = user.browser.find_element("id", "value-pin")
    before = number.get_attribute("value")
    slider.send_keys(Keys.END)
    moved = number.get_attribute("value")
    assert float(moved) > float(before)
    user.go("Simulate", "button")
    assert user.path == f"/mechanisms/{own}/try?set=pin%3D{moved}&run=true"
    assert "Outcome: ok" in user.text
    values = user.browser.execute_script(VALUES)
    assert values[0] == "10"  # N: load x long / short, whatever the play
    user.until_drawn()
    user.look()
    user.open(user.path)
    assert user.browser.execute_script(VALUES) == values
