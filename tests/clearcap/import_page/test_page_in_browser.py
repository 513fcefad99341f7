"""The page of what was found in a real browser, with WebGL by the processor and without any; and the docs' picture.

``CLEARCAP_PICTURES=docs/images pytest -m slow tests/clearcap/import_page/test_page_in_browser.py`` makes that anew.
"""

import io
import json
import os
import tomllib
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from tests.chromium import IN_3D, axe_faults, axe_run, chromium, needs_axe, needs_chromium, set_width
from tests.clearcap.import_page.conftest import HOSTILE, written
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium]
DOCS = Path(__file__).parents[3] / "docs"
BACKGROUND = (0xF4, 0xF6, 0xF9)
MOST_BYTES = 150_000


@pytest.fixture(scope="module")
def path(latch, tmp_path_factory):
    return written(latch, tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser(path, tmp_path_factory):
    """Open the page where WebGL works."""
    with chromium(tmp_path_factory.mktemp("profile"), options=IN_3D) as driver:
        set_width(driver, 1280, 800)
        driver.get(path.as_uri())
        yield driver


@pytest.fixture(autouse=True)
def nothing_selected(request):
    """Leave nothing selected for the next test."""
    yield
    if "browser" in request.fixturenames:
        request.getfixturevalue("browser").execute_script(
            "document.querySelector('button[aria-pressed=true]')?.click(); scrollTo(0, 0)"
        )


def seen(browser):
    """Return the canvas as a picture."""
    shot = browser.find_element("css selector", "#scene canvas").screenshot_as_png
    return Image.open(io.BytesIO(shot)).convert("RGB")


def drawn_share(picture):
    """Return the share of the picture that is not its background."""
    counts = {colour: count for count, colour in picture.getcolors(picture.width * picture.height)}
    return 1 - counts.get(BACKGROUND, 0) / (picture.width * picture.height)


def complaints(browser):
    """Return what the console holds; the driver of WebGL tells how long reading of pixels for a screenshot takes."""
    return [entry["message"] for entry in browser.get_log("browser") if "GL Driver Message" not in entry["message"]]


def pressed(browser):
    """Return the labels of the pressed buttons, and what is said to be selected."""
    buttons = browser.find_elements("css selector", "button[aria-pressed=true]")
    return [button.text for button in buttons], browser.find_element("id", "selected").text


def row(browser, name):
    """Return the button of the list with a label."""
    [found] = [b for b in browser.find_elements("css selector", "#list button") if b.text == name]
    return found


def test_nothing_is_asked_from_outside_and_nothing_goes_wrong(browser, path):
    """Every request is for the file itself or lies in it, and the console is empty."""
    for log in ("performance", "browser"):
        browser.get_log(log)  # of other tests
    browser.get(path.as_uri())
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    urls = [each["request"]["url"] for each in asked if each["documentURL"] == path.as_uri()]
    assert [url for url in urls if not url.startswith("data:")] == [path.as_uri()]
    assert not any(each["request"]["url"].startswith("http") for each in asked)
    assert complaints(browser) == []


def test_the_parts_are_seen(browser):
    """They fill a part of the canvas, each in its colour; the drawing is hidden, and the names stand on the canvas."""
    until(lambda: 0.15 < drawn_share(seen(browser)) < 0.9, "the parts")
    picture = seen(browser)
    hues = {h // 8 for _, (h, s, _) in picture.convert("HSV").getcolors(10**7) if s > 120}
    assert len(hues) >= 4
    assert not browser.find_element("id", "drawing").is_displayed()
    tags = browser.find_elements("css selector", "#tags span")
    assert [tag.text for tag in tags] == ["base-crank", "base-rocker", "crank-coupler", "rocker-coupler", "stop-1"]
    assert all(tag.is_displayed() for tag in tags)


@pytest.mark.parametrize("name", ["base-crank", "stop-1", "rocker"])
def test_an_entry_of_the_list_is_shown(browser, name):
    """A click on it shows its faces and lets the rest be seen through; another click ends that."""
    before = seen(browser)
    row(browser, name).click()
    assert pressed(browser) == ([name], f"Selected: {name}")
    until(lambda: changed_share(before, seen(browser)) > 0.1, "the rest is seen through")
    row(browser, name).click()
    assert pressed(browser) == ([], "")
    until(lambda: changed_share(before, seen(browser)) < 1e-3, "all is as before")


def changed_share(one, other):
    """Return the share of pixels that two pictures have different."""
    off = np.abs(np.asarray(one, int) - np.asarray(other, int)).max(axis=2)
    return float((off > 8).mean())


def test_a_click_on_a_name_or_a_part_selects(browser):
    """In the 3D scene itself; Escape ends it."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    tags = {tag.text: tag for tag in browser.find_elements("css selector", "#tags span")}
    tags["stop-1"].click()
    assert pressed(browser) == (["stop-1"], "Selected: stop-1")
    browser.find_element("tag name", "body").send_keys(Keys.ESCAPE)
    assert pressed(browser) == ([], "")
    canvas = browser.find_element("css selector", "#scene canvas")
    ActionChains(browser).move_to_element_with_offset(canvas, 0, -80).click().perform()
    assert pressed(browser)[0][0] in ("base", "crank", "rocker", "coupler")


def file_of(browser):
    """Return the mechanism file that the page would save."""
    address = browser.find_element("id", "save").get_attribute("href")
    return tomllib.loads(unquote(address.removeprefix("data:text/plain;charset=utf-8,")))


def test_answers_are_in_the_file(browser, path):
    """Gravity from a click on a face or from the list, what is fixed, densities, friction, groups."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import Select

    browser.get(path.as_uri())
    assert "gravity" not in file_of(browser)
    data = browser.execute_script("return JSON.parse(document.getElementById('data').textContent)")
    browser.find_element("id", "stand").click()
    canvas = browser.find_element("css selector", "#scene canvas")
    ActionChains(browser).move_to_element_with_offset(canvas, 0, -80).click().perform()
    down = np.array(file_of(browser)["gravity"]) / 9.81e-3
    words = browser.find_element("id", "said").text
    [part] = [each for each in data["parts"] if words == f"It stands on a face of {each['name']}."]
    assert any(np.allclose(down, plane[2:], atol=1e-6) for plane in part["planes"])
    right, up, normal = np.array(data["view"])
    assert down @ (normal + 0.35 * right + 0.45 * up) > 0  # the face that is seen, and not the one behind it
    assert pressed(browser) == ([], "")  # nothing is selected by that click
    Select(browser.find_element("id", "down")).select_by_visible_text("along −z")
    assert file_of(browser)["gravity"] == [0.0, 0.0, -9.81e-3]
    row(browser, "crank").click()
    assert Select(browser.find_element("id", "part")).first_selected_option.text == "crank"
    browser.find_element("id", "fix").click()
    for key, word in {"friction": "0.12", "density": "POM"}.items():
        browser.find_element("css selector", f"input[data-key={key}]").send_keys(
            Keys.CONTROL + "a", Keys.NULL + word, Keys.TAB
        )
    browser.find_element("css selector", "input[data-key=friction]").send_keys("x", Keys.TAB)
    assert "no number" in browser.find_element("id", "said").text
    Select(browser.find_element("id", "other")).select_by_visible_text("coupler")
    browser.find_element("id", "join").click()
    assert "--update latch.toml" in browser.find_element("id", "said").text
    found = file_of(browser)
    assert found["bodies"]["crank"] == {"part": "crank", "fixed": True, "density": "POM"}
    assert found["materials"]["contact"]["friction"] == 0.12
    assert found["groups"] == {"crank": ["crank", "coupler"]}
    open_now = [item.text for item in browser.find_elements("css selector", "#open li") if item.is_displayed()]
    assert not any("gravity" in text or "fixed" in text or "friction" in text for text in open_now)
    assert browser.find_element("id", "questions").text == f"Questions ({len(open_now)})"
    assert complaints(browser) == []
    browser.get(path.as_uri())


def test_a_keyboard_reaches_all(browser):
    """Tab goes to every entry, Enter selects, arrows with Shift turn the parts, and the button shows all again."""
    from selenium.webdriver.common.keys import Keys

    entry = row(browser, "crank-coupler")
    browser.execute_script("arguments[0].focus()", entry)
    entry.send_keys(Keys.ENTER)
    assert pressed(browser) == (["crank-coupler"], "Selected: crank-coupler")
    entry.send_keys(Keys.ESCAPE)
    before = seen(browser)
    canvas = browser.find_element("css selector", "#scene canvas")
    canvas.send_keys(*[Keys.SHIFT + Keys.ARROW_LEFT] * 20)
    until(lambda: changed_share(before, seen(browser)) > 0.03, "the parts are turned")
    browser.find_element("id", "reset").click()
    until(lambda: changed_share(before, seen(browser)) < 1e-3, "all is as before")
    reached = (
        "return [...document.querySelectorAll('button, canvas, input')].every(e => e.tabIndex >= 0 && !e.disabled)"
    )
    assert browser.execute_script(reached)


@needs_axe
def test_axe_finds_no_fault(browser):
    """The usual check of accessibility."""
    assert axe_faults(axe_run(browser)) == []


def test_on_a_telephone(browser):
    """Nothing is wider than the window."""
    set_width(browser, 400)
    try:
        assert browser.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0
        until(lambda: drawn_share(seen(browser)) > 0.05, "the parts")
    finally:
        set_width(browser, 1280, 800)


@pytest.mark.parametrize("option", ["--disable-3d-apis", "--blink-settings=scriptEnabled=false"])
def test_without_3d(path, tmp_path, option):
    """Without WebGL, or without scripts, the drawing is shown, and the list is whole."""
    with chromium(tmp_path, options=(option,)) as driver:
        driver.get(path.as_uri())
        assert driver.find_element("id", "drawing").is_displayed()
        assert driver.find_element("id", "drawing").size["width"] > 400
        assert driver.find_element("id", "flat").is_displayed()
        assert not driver.find_element("id", "scene").is_displayed()
        assert "stop-1" in driver.find_element("id", "list").text
        assert complaints(driver) == []


def test_hostile_names_do_nothing(hostile, tmp_path):
    """They are shown and run nothing, in the list and in the scene."""
    page = written(hostile, tmp_path, step=HOSTILE)
    with chromium(tmp_path / "profile", options=IN_3D) as driver:
        driver.get(page.as_uri())
        assert driver.title == f"{HOSTILE}: what was found"
        for button in driver.find_elements("css selector", "#list button"):
            driver.execute_script("arguments[0].click()", button)
        assert driver.title == f"{HOSTILE}: what was found"
        assert HOSTILE in driver.find_element("id", "list").text
        assert len(driver.find_elements("css selector", "script")) == 5
        assert complaints(driver) == []


def test_picture_of_the_docs(browser, tmp_path):
    """It shows the page with a joint selected, has the size of the window, and stays small; the docs have it."""
    row(browser, "crank-coupler").click()
    browser.execute_script("document.activeElement.blur(); scrollTo(0, 0)")
    shot = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    made = Path(os.environ.get("CLEARCAP_PICTURES") or tmp_path) / "latch-found.png"
    shot.quantize(128, kmeans=2, dither=Image.Dither.NONE).save(made, optimize=True)
    assert made.stat().st_size < MOST_BYTES
    assert drawn_share(shot.crop((20, 120, 800, 500))) > 0.1
    assert "](images/latch-found.png)" in (DOCS / "cad.md").read_text("utf-8")
    with Image.open(DOCS / "images" / "latch-found.png") as picture:
        assert picture.size == shot.size
