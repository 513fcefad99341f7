"""The picture of the README: the top of the report that the command of its caption writes, as a browser shows it.

``CLEARCAP_PICTURES=docs/images pytest -m slow tests/test_readme_picture.py`` makes it anew.
"""

import base64
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.chromium import chromium, needs_chromium, set_width

pytestmark = [pytest.mark.slow, needs_chromium, pytest.mark.processes]
ROOT = Path(__file__).parents[1]
SHOWN = ROOT / "docs" / "images" / "report.png"
WIDTH = 1320  # px: the summary fits in
COLOURS = 64
MOST_BYTES = 200_000
BOTTOM = "return Math.ceil(document.querySelector('table.summary').getBoundingClientRect().bottom + scrollY)"
CUT = "const box = document.querySelector('table.summary').parentElement; return box.scrollWidth > box.clientWidth"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Return the page of the report, in a store of its own; its author is nobody in particular."""
    folder = tmp_path_factory.mktemp("readme")
    command = re.search(r"^\*Top of the report of `clearcap (.+)`\.\*$", (ROOT / "README.md").read_text("utf-8"), re.M)
    words = [sys.executable, "-P", "-m", "clearcap", *shlex.split(command[1])]
    environment = {**os.environ, "LOGNAME": "A. Engineer"}
    run = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    (page,) = folder.glob("runs/*/report/report.html")
    return page


def test_picture_is_the_top_of_the_report(report, tmp_path):
    """It goes down to the end of the summary, stays small, and is as wide as the one that the README shows."""
    with chromium(tmp_path / "profile") as browser:
        browser.execute_cdp_cmd("Emulation.setScrollbarsHidden", {"hidden": True})
        set_width(browser, WIDTH)
        browser.get(report.as_uri())
        height, is_cut = browser.execute_script(BOTTOM), browser.execute_script(CUT)
        set_width(browser, WIDTH, height)
        shot = browser.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})
    picture = Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")
    made = Path(os.environ.get("CLEARCAP_PICTURES") or tmp_path) / SHOWN.name
    picture.quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE).save(made, optimize=True)
    assert picture.size == (WIDTH, height)
    assert 1000 < height < 4000
    assert not is_cut
    assert made.stat().st_size < MOST_BYTES
    with Image.open(SHOWN) as shown:
        assert shown.width == WIDTH
