"""A browser that is driven by its keyboard alone, and whose every page is looked at."""

import json
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from selenium.common.exceptions import (
    ElementNotInteractableException,
    JavascriptException,
    StaleElementReferenceException,
)
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.chromium import axe_faults, axe_run, set_width
from tests.until import until

STOPS = 250  # most presses of Tab to anything on a page
FOCUS = """
const e = document.activeElement, s = getComputedStyle(e), r = e.getBoundingClientRect();
const outlined = s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2;
const inside = r.bottom > 0 && r.top < innerHeight && r.right > 0 && r.left < innerWidth && r.width > 0;
return [e.tagName, (outlined || e.tagName === 'IFRAME') && inside, e.outerHTML.slice(0, 150)];
"""
NARROW, TALL = 130, 5  # px of a table's cell, and lines in it: more in less is hard to read
LOOK = f"""
const root = document.documentElement, range = document.createRange();
const lines = cell => {{ range.selectNodeContents(cell);
  return new Set([...range.getClientRects()].map(part => Math.round(part.top))).size; }};
const squeezed = [...document.querySelectorAll('main td, main th')]
  .filter(cell => cell.clientWidth < {NARROW} && lines(cell) > {TALL});
return {{title: document.title, headings: document.querySelectorAll('h1').length,
  wide: root.scrollWidth - root.clientWidth, width: innerWidth,
  squeezed: squeezed.slice(0, 3).map(cell => cell.outerHTML.slice(0, 120)),
  beyond: [...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1
    && !e.closest('.scroll')).slice(0, 3).map(e => e.outerHTML.slice(0, 120))}};
"""
REFUSED = "Failed to load resource: the server responded with a status of 4"
DRAWN = "return [...document.images].every(i => i.complete && i.naturalWidth > 0)"


PAGE_IS_REPLACED = (ElementNotInteractableException, JavascriptException, StaleElementReferenceException)


class Keyboard:
    """Somebody at a browser without a mouse.

    Parameters
    ----------
    browser : WebDriver
    url : str
        Address of the server, without a path: the only one that may be asked.
    width : int
        Of the window [px].
    with_axe : bool
        Each page is also checked by axe.

    Attributes
    ----------
    titles : dict of str to str
        Path -> title of each page that was looked at.
    """

    def __init__(self, browser: Any, url: str, width: int, *, with_axe: bool = True) -> None:
        self.browser, self.url, self.width, self._with_axe = browser, url, width, with_axe
        self.titles: dict[str, str] = {}
        self._asked: list[str] = []
        self._focus = ""  # what had the focus last
        set_width(browser, width)

    def begin_anew(self) -> None:
        """Be as in a new browser, but logged in: scripts run, things move, and nothing was looked at or asked."""
        self.browser.switch_to.default_content()
        self.browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
        set_width(self.browser, self.width)
        self.browser.get("about:blank")
        self.browser.get_log("browser")
        self.browser.get_log("performance")
        self.titles.clear()
        self._asked.clear()

    @property
    def path(self) -> str:
        """Path of the page, with its query."""
        parts = urlsplit(self.browser.current_url)
        return parts.path + (f"?{parts.query}" if parts.query else "")

    @property
    def text(self) -> str:
        """All that the page shows."""
        return str(self.browser.find_element("tag name", "body").text)

    def open(self, address: str) -> None:
        """Type an address."""
        self.browser.get(address if "://" in address else self.url + address)

    def log_in(self, name: str, password: str) -> None:
        """Log in by name and password."""
        self.open("/login")
        self.write("Name", name)
        self.write("Password", password)
        self.go("Log in", "button")

    def until(self, holds: Callable[[], Any], what: str) -> Any:
        """Wait until something holds, and return it."""

        def found() -> Any:
            try:
                return holds()
            except PAGE_IS_REPLACED:
                return None

        return until(found, lambda: f"{what}: not on {self.path}, which shows:\n{self.text}")

    def tab_to(self, name: str, kind: str = "") -> Any:
        """Press Tab until an element has the focus; each on the way shows that it has it.

        Parameters
        ----------
        name : str
            How a reader of screens calls it.
        kind : str
            Its tag, if others have that name.
        """
        seen = []
        for _ in range(STOPS):
            ActionChains(self.browser).send_keys(Keys.TAB).perform()  # also from a field of a file
            tag = until(self._focused, lambda: f"{self.path}: the focus cannot be seen on {self._focus}")
            if tag == "BODY":  # the browser's own frame, before it begins anew
                continue
            element = self.browser.switch_to.active_element
            seen.append(element.accessible_name)
            if seen[-1] == name and kind.upper() in ("", tag):
                return element
        raise AssertionError(f"{self.path}: no {kind or 'element'} {name!r} by Tab; there are {seen}")

    def _focused(self) -> str:
        """Return the tag of what has the focus and shows it; nothing if it does not, as while the page still moves."""
        tag, is_shown, self._focus = self.browser.execute_script(FOCUS)
        return tag if is_shown or tag == "BODY" else ""

    def write(self, name: str, text: str, kind: str = "") -> None:
        """Replace what a field holds."""
        element = self.tab_to(name, kind)
        if element.tag_name != "select":
            element.send_keys(Keys.CONTROL, "a")
            element.send_keys(Keys.DELETE)
        element.send_keys(text)

    def press(self, name: str, kind: str = "", key: str = Keys.ENTER) -> None:
        """Press Enter on a link or a button of the same page, again where the page has replaced it meanwhile."""
        self.until(lambda: self.tab_to(name, kind).send_keys(key) is None, f"{name} is pressed")

    def go(self, name: str, kind: str = "") -> None:
        """Press Enter on a link or a button, and wait for the page that comes."""
        self.browser.execute_script("window.isLeft = true")
        self.press(name, kind)
        self.until(self._has_come, f"{name}: another page")

    def _has_come(self) -> bool:
        return bool(self.browser.execute_script("return !window.isLeft")) and self._is_complete()

    def _is_complete(self) -> bool:
        return bool(self.browser.execute_script("return document.readyState === 'complete'"))

    def until_drawn(self) -> None:
        """Wait until every picture of the page is there."""
        self.until(lambda: self.browser.execute_script(DRAWN), "all pictures")

    def look(self, *, is_answer: bool = False) -> None:
        """Check the page once it is complete: its title, heading, width, cells, messages, requests; what axe finds.

        Parameters
        ----------
        is_answer : bool
            It is the answer to a form, and has the title of the form's page.
        """
        self.until(self._is_complete, "a complete page")  # one that a page leads to by itself is not yet
        self.check_requests()
        told = [entry["message"] for entry in self.browser.get_log("browser")]
        if is_answer:  # a refused form is answered by its page, with a status of which the browser tells
            told = [each for each in told if not each.startswith(f"{self.browser.current_url} - {REFUSED}")]
        seen = self.browser.execute_script(LOOK)
        path = urlsplit(self.path).path
        assert told == [], f"{self.path} wrote {told}"
        assert seen["width"] == self.width, f"{self.path} is laid out for {seen['width']} px"
        assert seen["wide"] <= 0, f"{self.path} is {seen['wide']} px wider than its window: {seen['beyond']}"
        assert seen["squeezed"] == [], f"{self.path} has cells that are narrow and tall: {seen['squeezed']}"
        assert seen["headings"] == 1, f"{self.path} has {seen['headings']} headings h1"
        assert seen["title"].endswith(" – clearcap"), f"{self.path} has the title {seen['title']!r}"
        if is_answer:
            path = next(other for other, title in self.titles.items() if title == seen["title"])
        others = {other for other, title in self.titles.items() if title == seen["title"] and other != path}
        assert others == set(), f"{path} has the title of another page: {seen['title']}"
        self.titles[path] = seen["title"]
        if self._with_axe:
            faults = axe_faults(axe_run(self.browser))
            assert faults == [], f"{self.path}: {faults}"
            self.browser.get_log("browser")  # what axe caused

    def check_requests(self) -> None:
        """Check that nothing but the server was asked since the last time."""
        events = [json.loads(entry["message"])["message"] for entry in self.browser.get_log("performance")]
        asked = [each["params"]["request"]["url"] for each in events if each["method"] == "Network.requestWillBeSent"]
        allowed = (f"{self.url}/", "data:", "chrome://", "chrome-untrusted://")
        self._asked += [url for url in asked if not url.startswith(("chrome", "data:"))]
        foreign = [url for url in asked if not url.startswith(allowed)]
        assert foreign == [], f"{self.path} asked {foreign}"

    @property
    def asked(self) -> list[str]:
        """Every address that the browser has asked the server for."""
        return self._asked
