"""A server with an empty store, a browser, and the text of a campaign that takes seconds."""

import pytest

from tests.campaign.web.journeys.keyboard import Keyboard
from tests.campaign.web.journeys.live_server import HOST, live_server
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


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Return a server with an empty store."""
    with live_server(tmp_path_factory.mktemp("served")) as serving:
        yield serving


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
