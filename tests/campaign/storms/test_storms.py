"""Twenty storms: whatever is killed whenever, every row is there once and has the bits of a quiet day."""

import os
import random
import time
import uuid

import pytest

from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits, check_whole
from tests.campaign.storms.cluster import DASK, KINDS, drive, start_cluster, strike
from tests.campaign.storms.supervisor import Supervisor, those_left

pytestmark = [pytest.mark.slow, pytest.mark.storm]

STORMS = 20
COMMIT = os.environ.get("CLEARCAP_STORMS")  # when set, only a fifth of the storms runs, chosen by it
SEEDS = sorted(random.Random(COMMIT).sample(range(STORMS), STORMS // 5)) if COMMIT else range(STORMS)
SAMPLES, BATCH, SECONDS = 2000, 20, 0.006
BOUND = 180.0  # s; a quiet machine of two cores takes a quarter of it
KILLS, PAUSE = (5, 10), (0.0, 2.5)  # how many, and the time between them [s]
PARTS, WAIT = (1, 12), 15.0  # or the parts that come between them, waited for so long [s] at most


@pytest.fixture
def asked(campaign_file):
    """Return the campaign of the storms."""
    return load_campaign(str(campaign_file), samples=SAMPLES)


@pytest.mark.parametrize("seed", SEEDS)
def test_storm(seed, tmp_path, asked):
    """Kill -9 of workers, nannies, scheduler, coordinator, client, in any order, two at once, all at once."""
    print(f"storm {seed}; to repeat it: python -m pytest -m storm '{__file__}::test_storm[{seed}]'")
    chance, began = random.Random(seed), time.monotonic()
    quiet, plan = computed(tmp_path / "quiet", asked, 100)
    reference = bits(quiet, plan)
    store = open_store(str(tmp_path / "store"))
    plan = submit(store, asked, BATCH)
    with Supervisor(tmp_path, f"{seed}-{uuid.uuid4()}", **DASK) as supervisor:
        address = start_cluster(supervisor, tmp_path)
        drive(supervisor, store, plan, address, SECONDS)
        supervisor.add("client", "campaign", "watch", plan.campaign_id, "--store", store.url, after=3.0)
        struck = _kill_at_random(supervisor, store, plan, chance)
        while not supervisor.finished("coordinator"):
            told = f"storm {seed}: {struck}\n{supervisor.said('coordinator')}"
            assert time.monotonic() - began < BOUND, told
            time.sleep(0.1)
        codes = supervisor.codes
    print(f"storm {seed}: {time.monotonic() - began:.1f} s, {struck}, exit statuses {codes['coordinator']}")
    assert those_left(supervisor.mark) == [], f"storm {seed}"
    store.files.sweep(plan.campaign_id)
    store.files.sweep(f"{plan.campaign_id}/parts")
    check_whole(store, plan, reference)


def _kill_at_random(supervisor, store, plan, chance):
    """Kill for a while, or until the campaign is over; return what was hit, in order, with the time [s]."""
    struck, began = [], time.monotonic()
    for _ in range(chance.randint(*KILLS)):
        _pause(supervisor, store, plan, chance)
        for kind in chance.sample(KINDS, chance.choice((1, 1, 2))):
            if supervisor.finished("coordinator"):
                return struck
            if hit := strike(supervisor, kind, chance):
                struck.append(f"{time.monotonic() - began:.1f} {kind} {hit}")
    return struck


def _pause(supervisor, store, plan, chance):
    """Let some time pass; every other time let first some batches be finished, so that blows hit work."""
    wanted = _finished(store, plan) + chance.randint(*PARTS) * chance.choice((0, 1))
    until = time.monotonic() + WAIT
    while _finished(store, plan) < wanted and time.monotonic() < until and not supervisor.finished("coordinator"):
        time.sleep(0.05)
    time.sleep(chance.uniform(*PAUSE) * chance.random())


def _finished(store, plan):
    return len(store.files.names(f"{plan.campaign_id}/parts"))
