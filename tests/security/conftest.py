"""The small campaign of the tests of `campaign`, for attacks."""

from tests.campaign.conftest import campaign, campaign_file, plan, store

__all__ = ["campaign", "campaign_file", "plan", "store"]
