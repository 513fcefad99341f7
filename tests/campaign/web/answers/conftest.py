"""A campaign of 400 samples with rows of the stand-in, and the folder of a cache."""

from dataclasses import replace

import pytest

from campaign.plan import make_plan
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from engine.private_folder import private_folder
from tests.campaign import fake_engine


def fails_where_wide(mechanism, values, **settings):
    """Fail where J1 is wide, so that columns have gaps."""
    return fake_engine.simulate(mechanism, values, status="ok" if values["J1"] < 0.1 else "not_converged")


@pytest.fixture
def growing(campaign, storage, tmp_path):
    """Return a store, a plan of 400 samples in 8 batches without rows, and what computes batches of it."""
    plan = make_plan(replace(campaign, spec=campaign.spec.model_copy(update={"samples": 400})), 50)
    store = open_store(storage(tmp_path))
    store.create_plan(plan)
    address = CampaignAddress.of(store, plan, fails_where_wide)

    def compute(*batches):
        for batch in batches:
            run_batch(address, BatchRequest(batch))

    return store, plan, compute


@pytest.fixture
def filled(growing):
    """Return the store and the plan with all rows, some of them failed."""
    store, plan, compute = growing
    compute(*range(8))
    return store, plan


@pytest.fixture
def folder(tmp_path):
    """Return a private folder for columns."""
    return private_folder(tmp_path / "cache", "columns")
