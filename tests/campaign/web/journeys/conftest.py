"""Servers as their users have them, one with an empty store and one with finished campaigns, and browsers."""

from dataclasses import dataclass
from importlib import resources

import pytest

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from campaign.store.label_versions import change_labels
from campaign.store.labels import LabelChange
from campaign.web.access import Role
from campaign.web.settings import Settings
from campaign.web.web_service import open_service
from engine import simulate
from tests.campaign.driving import computed
from tests.campaign.web.conftest import PASSWORD
from tests.campaign.web.journeys.keyboard import Keyboard
from tests.campaign.web.journeys.live_server import HOST, LiveServer, live_server
from tests.campaign.web.running import until
from tests.chromium import chromium

TEXT = """\
format = 1
name = "bolt"
title = "Bolt with play"
mechanism = "clearance_pendulum"
samples = 30
seed = 7

[variables.J1]
distribution = "uniform"
lower = 4e-4
upper = 6e-4

[responses.drop]
lsl = -7e-4
usl = -3e-4
source = "a test"
"""
C60 = (resources.files("campaign") / "library" / "c60.toml").read_text("utf-8")
WIDER = (
    C60.replace('name = "c60"', 'name = "c60-wider"')
    .replace("seven joint clearances", "J1 of another supplier")
    .replace("std = 0.0175", "std = 0.025", 1)
)
SAMPLES = 400
REPORTED_WITHIN = 300.0  # s, on a machine that has other things to do


@dataclass(frozen=True)
class FinishedCampaigns:
    """A server with two campaigns of the C-60, computed and reported, and an approver who has a password.

    Attributes
    ----------
    server : LiveServer
    first, wider : str
        Their ids; in the second J1 scatters more.
    user : str
    """

    server: LiveServer
    first: str
    wider: str
    user: str = "ada"


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Return a server with finished campaigns: their rows are computed here, their reports by the server."""
    folder = tmp_path_factory.mktemp("c60")
    ids = []
    for name, text in (("c60", C60), ("wider", WIDER)):
        (folder / f"{name}.toml").write_text(text)
        campaign = load_campaign(str(folder / f"{name}.toml"), samples=SAMPLES)
        store, plan = computed(folder / "runs", campaign, 100, simulate)
        change_labels(store, plan.campaign_id, LabelChange(owner="ada", add=("release-3",)), by="ada")
        write_state(store, plan.campaign_id, "queued")
        ids.append(plan.campaign_id)
    service = open_service(Settings(str(folder / "runs"), folder / "data", processes=0))
    service.users.add("admin", Role.ADMIN)
    service.users.add("ada", Role.APPROVER, PASSWORD)
    service.close()
    with live_server(folder) as server:
        until(
            lambda: all((server.store / each / "report" / "report.html").exists() for each in ids),
            "the reports",
            REPORTED_WITHIN,
        )
        yield FinishedCampaigns(server, *ids)


@pytest.fixture
def keyboard(tmp_path_factory):
    """Return what opens a browser with a profile of its own, by address and width."""
    opened = []

    def open_browser(url, width, preferences=None, with_axe=True):
        context = chromium(tmp_path_factory.mktemp("profile"), host=HOST, preferences=preferences)
        opened.append(context)
        return Keyboard(context.__enter__(), url, width, with_axe=with_axe)

    yield open_browser
    for context in reversed(opened):
        context.__exit__(None, None, None)


@pytest.fixture(params=[1400, 400])
def user(request, keyboard, finished):
    """Return an approver at a browser, in a wide window and on a telephone, on the list of the finished campaigns."""
    someone = keyboard(finished.server.url, request.param)
    someone.log_in(finished.user, PASSWORD)
    return someone
