"""The page in a real browser, and the PDF's pages: what a reader sees, and what no parser of HTML can know."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reporting.write import write_report
from tests.chromium import AXE, axe_faults, axe_run, chromium, needs_axe, needs_chromium, set_width
from tests.reporting.synthetic import c60_spec, c60_table

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium]


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, str]:
    """Write a report with everything in it: failures, a comparison, assumed limits, foreign names."""
    spec = replace(c60_spec(600), title="Schütz 断路器 C-60")
    folder = tmp_path_factory.mktemp("report")
    other = (c60_table(400, seed=3), replace(c60_spec(400), campaign="c60-other"))
    return write_report(c60_table(600, 5), spec, folder, kinds=("html", "json", "pdf"), against=other)


@pytest.fixture(scope="module")
def browser(files, tmp_path_factory) -> Iterator[Any]:
    """Open the page in a browser that cannot reach anything and writes down what it asks for."""
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        driver.get(Path(files["html"]).as_uri())
        yield driver


def test_nothing_is_asked_from_outside_and_nothing_goes_wrong(browser, files) -> None:
    """Every request of the browser is for the file itself, and its console is empty."""
    for log in ("performance", "browser"):
        browser.get_log(log)  # of other tests
    browser.get(Path(files["html"]).as_uri())
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    page = Path(files["html"]).as_uri()
    asked = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    # The browser's own start page asks for its own things before.
    urls = [each["request"]["url"] for each in asked if each["documentURL"] == page]
    assert [url for url in urls if not url.startswith("data:")] == [page]
    assert not any(each["request"]["url"].startswith("http") for each in asked)
    assert browser.get_log("browser") == []


def test_every_figure_is_seen(browser) -> None:
    """Each has a size, stays within the page, and its texts lie within its box."""
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    sizes = browser.execute_script(
        "return [...document.querySelectorAll('figure svg')].map(s => {const r = s.getBoundingClientRect();"
        " return [r.width, r.height, r.right, s.querySelectorAll('rect,polyline,path').length]})"
    )
    assert len(sizes) > 30
    for width, height, right, marks in sizes:
        assert width > 150
        assert height > 60
        assert right <= 1280
        assert marks > 2
    outside = browser.execute_script(
        "return [...document.querySelectorAll('svg text')].filter(t => {const r = t.getBoundingClientRect(),"
        " b = t.closest('svg').getBoundingClientRect();"
        " return r.left < b.left - 2 || r.right > b.right + 2 || r.top < b.top - 2 || r.bottom > b.bottom + 2})"
        ".map(t => t.textContent)"
    )
    assert outside == []


def test_the_page_is_no_wider_than_its_window(browser) -> None:
    """Wide tables scroll in a frame of their own, on a telephone too."""
    for width in (1280, 420):
        browser.set_window_size(width, 1000)
        wide = browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")
        assert wide <= 0, width
    browser.set_window_size(1280, 1000)


def test_nothing_is_cut_off_on_a_telephone(browser) -> None:
    """At 400 px no table needs scrolling, every column has its name, and the text of figures can be read."""
    set_width(browser, 400)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    try:
        assert browser.execute_script("return innerWidth") == 400
        cut = browser.execute_script(
            "return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1)"
            ".map(s => s.getAttribute('aria-label'))"
        )
        assert cut == []
        sizes = browser.execute_script(
            "return [...document.querySelectorAll('svg text')].map(t => parseFloat(getComputedStyle(t).fontSize)"
            " * t.getScreenCTM().a || 99)"
        )
        assert min(sizes) >= 9
        named = "return getComputedStyle(document.querySelector('table.summary td.n'), '::before').content"
        assert browser.execute_script(named) == '"Index"'
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_no_word_of_a_figure_covers_another(browser) -> None:
    """Names in the goal plot keep clear of each other and of the lines' own names."""
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    covered = browser.execute_script(
        "return [...document.querySelectorAll('div.front figure svg, .panels svg')].flatMap(s => {"
        " const t = [...s.querySelectorAll('text')].map(e => [e.textContent, e.getBoundingClientRect()]);"
        " return t.flatMap(([a, r], i) => t.slice(i + 1).filter(([b, q]) =>"
        " r.left < q.right - 1 && q.left < r.right - 1 && r.top < q.bottom - 3 && q.top < r.bottom - 3)"
        ".map(([b]) => a + ' / ' + b))})"
    )
    assert covered == []


def test_a_keyboard_reaches_everything(browser) -> None:
    """The first stop is the link past the head; every link, fold and scrolling table is a stop."""
    from selenium.webdriver.common.keys import Keys

    browser.execute_script("window.scrollTo(0, 0); document.activeElement.blur()")
    browser.find_element("tag name", "body").send_keys(Keys.TAB)
    assert browser.execute_script("return document.activeElement.className") == "skip"
    unreached = browser.execute_script(
        "return [...document.querySelectorAll('a[href], summary, .scroll')].filter(e => e.tabIndex < 0).length"
    )
    assert unreached == 0


@needs_axe
def test_axe_finds_no_fault(browser) -> None:
    """The usual check of accessibility, all its rules of WCAG 2.2 AA and good practice."""
    try:
        for scheme in ("light", "dark"):
            preferred = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", preferred)
            found = axe_run(browser)
            assert axe_faults(found) == [], scheme
            assert len(found["passes"]) > 20
            ground = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
            assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_a_telephone_shows_the_panels_of_the_response_that_is_tapped(browser) -> None:
    """Ten screens at most before that; then its six figures are there, and only its own."""
    set_width(browser, 400, 850)
    shown = "return [...document.querySelectorAll('.panels')].filter(p => p.offsetHeight > 0).length"
    try:
        browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = false); location.hash = ''")
        assert browser.execute_script(shown) == 0
        assert browser.execute_script("return document.documentElement.scrollHeight / innerHeight") <= 10
        browser.execute_script("document.querySelector('.show a').click()")
        assert browser.execute_script(shown) == 1
    finally:
        browser.execute_script("location.hash = ''")
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@needs_axe
def test_axe_would_find_one(browser) -> None:
    """The check sees a figure without a text."""
    browser.execute_script(AXE.read_text(encoding="utf-8"))
    browser.execute_script(
        "window.kept = document.querySelector('figure svg').getAttribute('aria-label');"
        "document.querySelector('figure svg').removeAttribute('aria-label')"
    )
    found = browser.execute_async_script("axe.run(document.querySelector('figure')).then(arguments[0])")
    browser.execute_script("document.querySelector('figure svg').setAttribute('aria-label', window.kept)")
    assert "svg-img-alt" in {v["id"] for v in found["violations"]}


@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="no pdftoppm on this machine")
def test_the_pdf_says_what_the_page_says(files, tmp_path: Path) -> None:
    """A4, its text is text, no page is empty, nothing is cut off at the right edge."""
    if "pdf" not in files:
        pytest.skip("WeasyPrint is not installed")
    about = subprocess.run(["pdfinfo", files["pdf"]], capture_output=True, text=True, check=True).stdout
    assert "(A4)" in about
    assert "Schütz 断路器 C-60" in about
    words = subprocess.run(["pdftotext", files["pdf"], "-"], capture_output=True, text=True, check=True).stdout
    for word in ("Can these numbers be trusted?", "FC-1", "Provenance", "Comparison with c60-other"):
        assert word in words
    subprocess.run(["pdftoppm", "-r", "40", "-gray", files["pdf"], tmp_path / "page"], check=True)
    pages = sorted(tmp_path.glob("page-*.pgm"))
    count = int(re.search(r"Pages:\s+(\d+)", about)[1])
    assert len(pages) == count
    for text, number in zip(words.split("\f"), range(1, count + 1), strict=False):
        assert f"{number} of {count}" in text
        assert "c60-0123456789" in text
    for page in pages:
        _, size, _, raw = page.read_bytes().split(b"\n", 3)
        width, height = map(int, size.split())
        grey = np.frombuffer(raw, np.uint8).reshape(height, width)
        assert np.count_nonzero(grey < 160) > 300, page  # an almost empty page is a fault of the layout
        assert grey[:, -8:].min() > 200, page  # the margin is empty


@pytest.fixture
def attacked(browser, files, tmp_path: Path) -> Any:
    """Open a page into which someone has got a script, a style sheet, a picture, a frame and a form."""
    page = Path(files["html"]).read_text(encoding="utf-8")
    sent = (tmp_path / "secret.svg").as_uri()
    inserted = (
        "<script>document.title = 'run'</script><style>h1 { color: rgb(1, 2, 3) }</style>"
        f"<img id=picture src='{sent}' onerror=\"document.title = 'run'\"><iframe id=frame src='{sent}'></iframe>"
        f"<a id=link href=\"javascript:document.title = 'run'\">link</a><base href='{sent}'>"
    )
    path = tmp_path / "attacked.html"
    path.write_text(page.replace("</h1>", f"</h1>{inserted}", 1), encoding="utf-8")
    (tmp_path / "secret.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg' width='7' height='7'/>")
    browser.get_log("browser")
    browser.get(path.as_uri())
    yield browser
    browser.get_log("browser")
    browser.get(Path(files["html"]).as_uri())


def test_what_got_into_the_page_does_nothing(attacked) -> None:
    """The content security policy keeps it from running, restyling, loading and sending; the page's style is there."""
    attacked.execute_script("document.getElementById('link').click()")
    assert attacked.title.endswith("capability report")
    assert attacked.execute_script("return getComputedStyle(document.querySelector('h1')).color") != "rgb(1, 2, 3)"
    assert attacked.execute_script("return document.getElementById('picture').naturalWidth") == 0
    assert attacked.execute_script("return document.baseURI") == attacked.current_url
    refused = [entry["message"] for entry in attacked.get_log("browser")]
    for what in ("script-src", "style-src", "img-src", "default-src 'none'", "base-uri"):
        assert any(what in message for message in refused), (what, refused)


def test_the_policy_lets_the_pages_own_style_through(browser) -> None:
    """Style sheet and the shade of a cell are as they are without the policy."""
    assert browser.execute_script("return getComputedStyle(document.body).margin") == "0px"
    shaded = "return getComputedStyle(document.querySelector('td[style]')).backgroundColor"
    assert browser.execute_script(shaded).startswith("rgba(27, 95, 158")
