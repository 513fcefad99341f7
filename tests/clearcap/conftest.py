"""The fixtures of campaigns, for the tests of what people ask for."""

from tests.campaign.conftest import *  # noqa: F403
