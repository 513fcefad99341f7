"""The small campaign of the tests of `campaign`, for attacks."""

from tests.campaign.conftest import (
    campaign,
    campaign_file,
    faked,
    forked_workers,
    kept_workers,
    pickled_campaign,
    plan,
    server_of_processes,
    store,
    workers,
)

__all__ = [
    "campaign",
    "campaign_file",
    "faked",
    "forked_workers",
    "kept_workers",
    "pickled_campaign",
    "plan",
    "server_of_processes",
    "store",
    "workers",
]
