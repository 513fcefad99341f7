"""A campaign is made on a page: by its form, by its file, both ways; its cost is shown, and it is submitted."""

import re

import pytest
from selenium.webdriver.common.keys import Keys

from tests.chromium import needs_axe, needs_chromium

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
FILE = "Campaign file, TOML"
SHORT = """
[variables.short]
target = "parameters.short"
distribution = "uniform"
lower = 11.95
upper = 12.05
"""
TEXT = "return document.getElementById('text').value"
NAMES = "return [...document.querySelectorAll('#form-side input')].map(e => e.value)"
FOCUS = "return document.activeElement.id"


def test_a_campaign_is_made(user, finished):
    """Who fills in the form sees the file, and who writes into the file sees the form."""
    user.go("New campaign", "a")
    user.look()
    _fill_in(user, f"latch-{user.width}")
    _write_into_the_file(user)
    user.go("Check", "button")
    user.look()
    assert "No faults" in user.text
    user.go("Time a few runs", "button")
    assert re.search(r"6\d runs, about .* on 1 worker", user.text)  # some are repeated with half the step
    user.go("Submit", "button")
    assert user.path.startswith(f"/campaigns/latch-{user.width}-")
    user.look()
    user.until(lambda: "State: completed" in user.text, "the rows")
    assert "60 of 60" in user.text
    user.open("/campaigns?search=latch")
    assert f"Latch at {user.width} px" in user.text
    user.look()


def _fill_in(user, name):
    """Fill in the form from its top; whoever chooses from a list stays where he was."""
    user.write("Name (start of the id)", name)
    user.write("Title", f"Latch at {user.width} px")
    user.tab_to("Mechanism", "select").send_keys("l")
    user.until(lambda: 'mechanism = "lever"' in user.browser.execute_script(TEXT), "the mechanism in the file")
    assert user.browser.execute_script(FOCUS) == "mechanism"
    user.write("Samples", "60")
    user.write("Sampler", "lhs", "select")
    user.write("Seed", "5")
    user.write("Name", "long")
    user.tab_to("Distribution", "select").send_keys("u")
    user.until(lambda: user.browser.find_elements("id", "v0.upper") and not _has(user, "v0.mean"), "its own numbers")
    assert user.browser.execute_script(FOCUS) == "v0.distribution"
    user.write("Sets the number", "parameters.long")
    user.write("lower", "29.9")
    user.write("upper", "30.1")
    user.write("LSL", "9.9")
    user.write("USL", "10.1")
    user.tab_to("Response")
    wanted = ("samples = 60", 'sampler = "lhs"', "seed = 5", "[variables.long]", "upper = 30.1", "usl = 10.1")
    user.until(lambda: all(line in user.browser.execute_script(TEXT) for line in wanted), "the form in the file")


def _has(user, name):
    return bool(user.browser.find_elements("id", name))


def _write_into_the_file(user):
    """Add a variable at the end of the file: a row of the form, and its density, appear."""
    user.tab_to(FILE, "textarea").send_keys(Keys.CONTROL + Keys.END, Keys.NULL + SHORT + Keys.TAB)
    user.until(lambda: "parameters.short" in user.browser.execute_script(NAMES), "the file in the form")
    drawn = user.browser.find_element("id", "densities").text
    assert "long uniform, between 29.9 and 30.1" in drawn
    assert "short uniform, between 11.95 and 12.05" in drawn
    user.look()
