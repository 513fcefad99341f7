"""The report that the README shows: the picture of its first screen, how much it says, and its pages on paper.

``CLEARCAP_PICTURES=docs/images pytest -m slow tests/test_readme_picture.py`` makes it anew.
"""

import base64
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.chromium import chromium, needs_chromium, set_width
from tests.reporting.render.visible_words import visible_words

pytestmark = [pytest.mark.slow, needs_chromium, pytest.mark.processes]
ROOT = Path(__file__).parents[1]
SHOWN = ROOT / "docs" / "images" / "report.png"
WIDTH = 1400  # px: the summary fits in
COLOURS = 64
MOST_BYTES = 200_000
BOTTOM = "return Math.ceil(document.querySelector('div.front').getBoundingClientRect().bottom + scrollY)"
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
    """It is the first screen, stays small, and is as wide as the one that the README shows."""
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
    assert 700 < height < 1100  # one screen
    assert not is_cut
    assert made.stat().st_size < MOST_BYTES
    with Image.open(SHOWN) as shown:
        assert shown.width == WIDTH


def test_what_is_seen_unfolded_is_read_in_minutes(report):
    """The first screen and the pages of the responses: at most 2,000 words, with those of the figures."""
    front = report.read_text(encoding="utf-8").split('<section class="appendix"')[0]
    assert 500 < len(visible_words(front)) <= 2000


@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="no pdftoppm on this machine")
def test_first_screen_and_responses_are_eight_full_pages_at_most(report, tmp_path):
    """No page before the appendix ends above its middle; the sheet to sign is one page."""
    pytest.importorskip("weasyprint")
    words = [sys.executable, "-P", "-m", "clearcap", "report", "--pdf", "--summary", "--store", str(report.parents[2])]
    run = subprocess.run(words, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    path = report.with_name("report.pdf")
    text = subprocess.run(["pdftotext", path, "-"], capture_output=True, text=True, check=True).stdout.split("\f")
    count = next(i for i, page in enumerate(text) if "Can these numbers be trusted?" in page)
    assert 2 <= count <= 8
    subprocess.run(["pdftoppm", "-r", "30", "-gray", "-l", str(count), path, tmp_path / "page"], check=True)
    for page in tmp_path.glob("page-*.pgm"):
        with Image.open(page) as picture:
            inked = np.flatnonzero((np.asarray(picture) < 200).any(axis=1))
            body = inked[inked < 0.94 * picture.height]  # above the page's number
            assert body.max() > 0.55 * picture.height, page
    sheet = subprocess.run(["pdfinfo", report.with_name("summary.pdf")], capture_output=True, text=True, check=True)
    assert "Pages:           1\n" in sheet.stdout
    assert "…" not in report.with_name("summary.html").read_text(encoding="utf-8").split("<body")[1]
