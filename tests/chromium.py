"""Chromium, driven by Selenium: it reaches nothing but what a test allows, and writes down what it asks for."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

AXE = Path(__file__).parents[1] / "node_modules" / "axe-core" / "axe.min.js"
ANSWERS_WITHIN = 600.0  # s, for a page, a script and whatever else the driver is told: only a hang reaches it
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--window-size=1280,1000",
           "--disable-background-networking", "--disable-component-update", "--disable-sync")  # fmt: skip
IN_3D = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # WebGL by the processor alone

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="no chromium with its driver on this machine"
)
needs_axe = pytest.mark.skipif(not AXE.exists(), reason="no axe-core: npm install --no-save axe-core@4")


@contextmanager
def chromium(
    profile: Path, *, host: str = "", preferences: dict[str, Any] | None = None, options: tuple[str, ...] = ()
) -> Iterator[Any]:
    """Open a browser in the block.

    Parameters
    ----------
    profile : Path
        Empty folder of its cookies and settings.
    host : str
        The only host that it can reach; empty: none.
    preferences : dict, optional
        Settings of the profile.
    options : tuple of str
        More words of its command line, as `IN_3D`.
    """
    webdriver = pytest.importorskip("selenium.webdriver")
    chosen = webdriver.ChromeOptions()
    chosen.binary_location = CHROMIUM
    reached = f", EXCLUDE {host}" if host else ""
    rules = f"--host-resolver-rules=MAP * ~NOTFOUND{reached}"
    for option in (*OPTIONS, *options, rules, f"--user-data-dir={profile}"):
        chosen.add_argument(option)
    if preferences:
        chosen.add_experimental_option("prefs", preferences)
    chosen.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=chosen, service=webdriver.ChromeService(DRIVER))
    commands = driver.command_executor  # its own bound of two minutes cannot be chosen
    commands.client_config.timeout = ANSWERS_WITHIN
    commands._conn = commands._get_connection_manager()
    driver.set_page_load_timeout(ANSWERS_WITHIN)
    driver.set_script_timeout(ANSWERS_WITHIN)
    try:
        yield driver
    finally:
        driver.quit()


def set_width(browser: Any, width: int, height: int = 900) -> None:
    """Give the page a window of a size [px]; below 600 px it is a telephone's."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def axe_run(browser: Any) -> dict[str, Any]:
    """Return what the usual check of accessibility finds: all its rules of WCAG 2.2 AA and good practice."""
    browser.execute_script(AXE.read_text(encoding="utf-8"))
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    found: dict[str, Any] = browser.execute_async_script("axe.run(document).then(arguments[0])")
    return found


def axe_faults(found: dict[str, Any]) -> list[tuple[str, list[str]]]:
    """Return rule and elements of each fault that was found."""
    return [(v["id"], [n["html"][:160] for n in v["nodes"][:2]]) for v in found["violations"]]
