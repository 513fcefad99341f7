"""Servers as their users have them, one with an empty store and one with finished campaigns, and browsers."""

import shutil
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import pytest

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from campaign.store.labels import LabelChange, change_labels
from clearcap.web.access import Role, users
from clearcap.web.settings import Settings
from clearcap.web.web_service import open_service
from engine import simulate
from tests.campaign.driving import computed
from tests.chromium import chromium
from tests.clearcap.web.conftest import PASSWORD
from tests.clearcap.web.journeys.keyboard import Keyboard
from tests.clearcap.web.journeys.live_server import HOST, LiveServer, live_server
from tests.until import until

TEXT = """\
format = 1
name = "bolt"
title = "Bolt with play"
mechanism = "clearance_pendulum"
samples = 30
seed = 7
decide = { runs = 0 }

[variables.J1]
distribution = "uniform"
lower = 4e-4
upper = 6e-4

[responses.drop]
lsl = -7e-4
usl = -3e-4
source = "a test"
"""
C60 = (
    (resources.files("campaign") / "library" / "c60.toml")
    .read_text("utf-8")
    .replace("\n[variables]", "\n[decide]\nruns = 0\n\n[variables]")
)
WIDER = (
    C60.replace('name = "c60"', 'name = "c60-wider"')
    .replace("seven joint clearances", "J1 of another supplier")
    .replace("std = 0.0175", "std = 0.025", 1)
)
SAMPLES, FEWER = 400, 100  # of the first, and of the other


@dataclass(frozen=True)
class FinishedCampaigns:
    """A server with two campaigns of the C-60, computed and reported, and an approver who has a password.

    Attributes
    ----------
    server : LiveServer
    first, wider : str
        Their ids; in the second J1 scatters more, and the samples are fewer.
    untouched : Path
        A folder with the same store and users, for a server that shows nothing of what other tests did.
    user : str
    """

    server: LiveServer
    first: str
    wider: str
    untouched: Path
    user: str = "ada"


@pytest.fixture(scope="session")
def finished(tmp_path_factory, cheap_passwords):
    """Return a server with finished campaigns: their rows are computed here, their reports by the server."""
    folder = tmp_path_factory.mktemp("c60")
    ids = []
    for name, text, samples in (("c60", C60, SAMPLES), ("wider", WIDER, FEWER)):
        (folder / f"{name}.toml").write_text(text)
        campaign = load_campaign(str(folder / f"{name}.toml"), samples=samples)
        store, plan = computed(folder / "runs", campaign, 100, simulate)
        change_labels(store, plan.campaign_id, LabelChange(owner="ada", add=("release-3",)), by="ada")
        write_state(store, plan.campaign_id, "queued")
        ids.append(plan.campaign_id)
    service = open_service(Settings(str(folder / "runs"), folder / "data", processes=0))
    service.users.add("admin", Role.ADMIN)
    with pytest.MonkeyPatch.context() as patch:  # a process of its own checks it
        patch.setattr(users, "_COST", cheap_passwords)
        service.users.add("ada", Role.APPROVER, PASSWORD)
    service.close()
    untouched = tmp_path_factory.mktemp("untouched")
    shutil.copytree(folder / "data", untouched / "data")
    with live_server(folder) as server:
        until(lambda: all(server.store.files.exists(f"{each}/report/report.html") for each in ids), "the reports")
    for each in ids:  # while no server writes there; and not the lease of its coordinator
        shutil.copytree(folder / "runs" / each, untouched / "runs" / each)
    with live_server(folder) as server:
        yield FinishedCampaigns(server, *ids, untouched)


@contextmanager
def browsers(tmp_path_factory):
    """Yield what opens a browser with a profile of its own, by address and width; all end with the block."""
    with ExitStack() as opened:

        def open_browser(url, width, preferences=None, with_axe=True):
            profile = tmp_path_factory.mktemp("profile")
            browser = opened.enter_context(chromium(profile, host=HOST, preferences=preferences))
            return Keyboard(browser, url, width, with_axe=with_axe)

        yield open_browser


@pytest.fixture
def keyboard(tmp_path_factory):
    """Return what opens a browser with a profile of its own, by address and width."""
    with browsers(tmp_path_factory) as open_browser:
        yield open_browser


@pytest.fixture(scope="session")
def kept_users(tmp_path_factory, finished):
    """Return what gives the approver at the browser of a width; he logs in once for all tests, which takes seconds."""
    known = {}
    with browsers(tmp_path_factory) as open_browser:

        def user_at(width):
            if width not in known:
                known[width] = open_browser(finished.server.url, width)
                known[width].log_in(finished.user, PASSWORD)
            known[width].begin_anew()
            known[width].open("/campaigns")
            return known[width]

        yield user_at


@pytest.fixture(params=[1400, 400])
def user(request, kept_users):
    """Return an approver at a browser, in a wide window and on a telephone, on the list of the finished campaigns."""
    return kept_users(request.param)
