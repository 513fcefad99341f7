"""The pictures of the service in the docs: pages about the C-60 as a browser shows them.

``CLEARCAP_PICTURES=docs/images pytest -m slow tests/clearcap/web/journeys/test_screenshots.py`` makes them anew.
"""

import base64
import io
import os
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from campaign.coordinator.heartbeat import Progress
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.state import write_state
from campaign.store.layout import HEARTBEAT
from campaign.store.store import repeated_shares
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from engine import simulate
from tests.chromium import chromium, needs_chromium, set_width
from tests.clearcap.web.conftest import PASSWORD
from tests.clearcap.web.journeys.keyboard import Keyboard
from tests.clearcap.web.journeys.live_server import HOST, live_server

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium]
DOCS = Path(__file__).parents[4] / "docs"
WIDTH, HEIGHT = 1400, 900  # px
HEIGHTS = {"try": 1500}
NAMES = ("campaigns", "live", "report", "whatif", "new", "try")
COLOURS = 256
MOST_BYTES = 200_000
BLOCK = 50  # px, of which the shades are compared: figures of another run differ within them
ALIKE = 0.95  # least correlation of the shades; two runs have 0.99 or more, a table that moves makes it 0.89
SAMPLES, HELD, RATE = 4000, 300, 45.0  # of the campaign that is shown while it is computed: all, done, 1/s
DONE = "return Number(document.querySelector('[data-field=done]').textContent.replace(/\\D/g, ''))"
FRAMED = "return document.readyState"


@pytest.fixture(scope="module")
def pictures(finished, tmp_path_factory):
    """Return the folder of the pictures, which are made here; the list shows no campaigns of other tests."""
    folder = Path(os.environ.get("CLEARCAP_PICTURES") or tmp_path_factory.mktemp("pictures"))
    profile = tmp_path_factory.mktemp("profile")
    with live_server(finished.untouched, "--no-drive") as server, chromium(profile, host=HOST) as browser:
        user = Keyboard(browser, server.url, WIDTH, with_axe=False)
        user.log_in(finished.user, PASSWORD)
        _show_pages(user, finished, folder, server.store)
    return folder


@contextmanager
def _held(store, campaign):
    """Have a campaign run in the block: its first rows are there, and its coordinator, this process, stands still."""
    plan = store.plan(campaign)
    address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
    with hold_lease(store, campaign) as token:
        write_state(store, campaign, "running")
        for number, (first, _) in enumerate(plan.batches):
            if first < HELD:
                run_batch(address, BatchRequest(number))
        progress = Progress(store, plan, store.survey(plan))
        beat = progress.heartbeat("running", token=token, pid=os.getpid(), beat=1)
        beat = replace(beat, rate=RATE, eta_s=beat.left / RATE, workers=1)
        store.write_json(campaign, HEARTBEAT, beat.to_json())
        yield progress.done


def _show_pages(user, finished, folder, store):
    """Take a picture of each page; one campaign is being computed meanwhile, as far as it is held."""
    user.open(f"/campaigns/new?from={finished.wider}&samples={SAMPLES}&set=J2.std%3D0.02")
    _shoot(user, folder, "new")
    user.write("Title", "C-60 circuit breaker, ON position: J2 of another supplier too")
    user.go("Submit", "button")
    with _held(store, user.path.removeprefix("/campaigns/")) as done:
        user.until(lambda: user.browser.execute_script(DONE) == done, "its rows")
        _shoot(user, folder, "live")
        user.open("/campaigns")
        user.until(lambda: "running" in user.text, "the campaign that is computed")
        _shoot(user, folder, "campaigns")
    user.open(f"/campaigns/{finished.first}/report")
    _until_framed(user)
    _shoot(user, folder, "report")
    user.open(f"/campaigns/{finished.first}/whatif?set=J1.std%3D0.0119&set=J3.std%3D0.0133")
    _shoot(user, folder, "whatif")
    user.open("/mechanisms/c60/try?set=J1%3D0.03&run=true")
    _shoot(user, folder, "try")


@pytest.mark.parametrize("name", NAMES)
def test_picture_shows_a_page(pictures, name):
    """It has the size of the window and many colours, none of them nearly everywhere, and stays small."""
    path = pictures / f"service-{name}.png"
    picture = Image.open(path).convert("L")
    assert picture.size == (WIDTH, HEIGHTS.get(name, HEIGHT))
    counts = sorted(picture.histogram())
    assert sum(count > 0 for count in counts) > 20
    assert counts[-1] < 0.97 * picture.width * picture.height
    assert path.stat().st_size < MOST_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_docs_show_the_page_as_it_is(pictures, name):
    """A page that was changed needs its picture made anew; no two pages are that alike."""
    made = {each: _shades(pictures / f"service-{each}.png") for each in NAMES}
    in_docs = _shades(DOCS / "images" / f"service-{name}.png")
    alike = {each: np.corrcoef(in_docs, shades)[0, 1] for each, shades in made.items() if shades.size == in_docs.size}
    assert alike.pop(name) > ALIKE, "make it anew: see the top of this file"
    assert max(alike.values(), default=0.0) < ALIKE


@pytest.mark.parametrize("name", NAMES)
def test_page_of_docs_has_the_picture(name):
    """The docs show a picture that has the size of those made here."""
    assert f"](images/service-{name}.png)" in (DOCS / "service.md").read_text("utf-8")
    with Image.open(DOCS / "images" / f"service-{name}.png") as picture:
        assert picture.size == (WIDTH, HEIGHTS.get(name, HEIGHT))


def _shades(path):
    """Return the mean shade of each block of a picture, one after the other."""
    with Image.open(path) as picture:
        size = picture.width // BLOCK, picture.height // BLOCK
        return np.asarray(picture.convert("L").resize(size, Image.Resampling.BOX), float).ravel()


def _until_framed(user):
    """Wait until the report in the frame is there."""
    user.browser.switch_to.frame(user.browser.find_element("css selector", "iframe.report"))
    user.until(lambda: user.browser.execute_script(FRAMED) == "complete" and "Trust" in user.text, "the report")
    user.browser.switch_to.default_content()


def _shoot(user, folder, name):
    """Write what the window shows, when all pictures of the page are drawn."""
    set_width(user.browser, WIDTH, HEIGHTS.get(name, HEIGHT))
    user.until_drawn()
    alerts = [each.text for each in user.browser.find_elements("css selector", "[role=alert]") if each.text]
    assert alerts == [], f"{user.path} is shown with {alerts}"
    shot = user.browser.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})
    picture = Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")
    picture.quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE).save(folder / f"service-{name}.png", optimize=True)
    set_width(user.browser, WIDTH)
