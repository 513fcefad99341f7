"""The small campaign of the tests of `campaign`, for attacks."""

from tests.campaign.conftest import campaign, campaign_file, faked, kept_workers, plan, store, workers

__all__ = ["campaign", "campaign_file", "faked", "kept_workers", "plan", "store", "workers"]
