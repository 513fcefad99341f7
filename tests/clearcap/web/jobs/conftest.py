"""A campaign of 400 samples with rows of the stand-in, and the folder of a cache."""

from dataclasses import replace

import pytest

from campaign.plan import make_plan
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from engine.platform.private_folder import private_folder
from tests.campaign import fake_engine
from tests.clearcap.web.conftest import copy_store


def fails_where_wide(mechanism, values, **settings):
    """Fail where J1 is wide, so that columns have gaps."""
    return fake_engine.simulate(mechanism, values, status="ok" if values["J1"] < 0.1 else "not_converged")


@pytest.fixture(scope="session")
def long_plan(campaign):
    """Return a plan of 400 samples in 8 batches."""
    return make_plan(replace(campaign, spec=campaign.spec.model_copy(update={"samples": 400})), 50)


def _begun(address, plan):
    """Return a new store with a plan and no rows, and what computes batches of it."""
    store = open_store(address)
    store.create_plan(plan)
    campaign = CampaignAddress.of(store, plan, fails_where_wide)

    def compute(*batches):
        for batch in batches:
            run_batch(campaign, BatchRequest(batch))

    return store, compute


@pytest.fixture
def growing(long_plan, storage, tmp_path):
    """Return a store, a plan of 400 samples in 8 batches without rows, and what computes batches of it."""
    store, compute = _begun(storage(tmp_path), long_plan)
    return store, long_plan, compute


@pytest.fixture(scope="session")
def filled(long_plan, storage, tmp_path_factory):
    """Return a store and the plan with all rows, some of them failed; only to be read."""
    store, compute = _begun(storage(tmp_path_factory.mktemp("filled")), long_plan)
    compute(*range(8))
    return store, long_plan


@pytest.fixture
def own_filled(filled, storage, tmp_path):
    """Return a copy of the store with all rows, to be changed, and the plan."""
    store, plan = filled
    address = storage(tmp_path)
    copy_store(store.url, address)
    return open_store(address), plan


@pytest.fixture
def folder(tmp_path):
    """Return a private folder for columns."""
    return private_folder(tmp_path / "cache", "columns")
