"""A hundred storms: whatever is done to a campaign while it is computed, its table has the bits of a quiet day."""

import os
import random
import subprocess
import sys
import time
import uuid

import pytest

from campaign.coordinator.submit import submit
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits, check_endings, check_whole
from tests.campaign.storms.cluster import DASK
from tests.campaign.storms.command import CLOCK, SECONDS
from tests.campaign.storms.disk import tmpfs
from tests.campaign.storms.disturbances import drawn, strike
from tests.campaign.storms.modes import BATCH, ENGINE, MODES, STORMS, chosen, mode_of
from tests.campaign.storms.server_checks import check_accounts, check_visits
from tests.campaign.storms.storm import Storm
from tests.campaign.storms.supervisor import Supervisor, those_left

pytestmark = [pytest.mark.slow, pytest.mark.storm, pytest.mark.processes]

COMMIT = os.environ.get("CLEARCAP_STORMS")  # when set, only a share of the storms runs, chosen by it
SEEDS = chosen(COMMIT) if COMMIT else range(STORMS)
RUN = 0.03  # s, that a run of the stand-in takes
PATIENCE = 15.0  # s, in which progress is waited for before the next disturbance
BOUND = 1800.0  # s, for whatever may hang; a storm takes a tenth of it
RESUMES = 3  # undisturbed, until the campaign is complete

BLOCKS = """\
format = 1
name = "blocks"
mechanism = "incline"
samples = 120

[failures]
min_ok = 0                           # many blocks slide

[simulation]
horizon = 0.5

[variables.friction]
target = "materials.block_slope.friction"
distribution = "uniform"
lower = 0.4
upper = 0.8
"""


@pytest.fixture(scope="module")
def quiet_day(tmp_path_factory):
    """Return what returns the table of a campaign that nothing disturbs; each is computed once."""
    tables = {}

    def table(mode, asked):
        if mode.command not in tables:
            tables[mode.command] = bits(*computed(tmp_path_factory.mktemp("quiet"), asked, 100, mode.simulate))
        return tables[mode.command]

    return table


@pytest.mark.parametrize("seed", SEEDS)
def test_storm(seed, tmp_path, campaign_file, quiet_day, record_property):
    """Kills, signals, pauses, faults of the disk, damaged files: no row is lost, doubled, different or blamed."""
    chance = random.Random(seed)
    name = mode_of(seed)
    mode = MODES[name]
    campaign_file.write_text(BLOCKS if mode.command == ENGINE else SPEC.replace("samples = 25", "samples = 300"))
    asked = load_campaign(str(campaign_file))
    kinds = drawn(chance, mode)
    (tmp_path / "clock").touch()
    environment = {**DASK, SECONDS: str(RUN), CLOCK: str(tmp_path / "clock"), "TMPDIR": str(tmp_path)}
    with tmpfs(tmp_path / "disk", "12m", "nr_inodes=1000") as disk:
        store = open_store(str(disk / "store"))
        plan = submit(store, asked, BATCH) if mode.clustered else make_plan(asked, None if mode.has_server else BATCH)
        with Supervisor(tmp_path, f"{seed}-{uuid.uuid4()}", **environment) as supervisor:
            storm = Storm(chance, supervisor, disk, store, plan.campaign_id, mode)
            mode.start(storm, campaign_file, mode.command)
            try:
                _rage(storm, kinds, len(plan.batches))
                storm.undo(everything=True)
                _calm(storm)
                if mode.has_server:
                    check_visits(storm, plan.batches[0][1])
            finally:
                storm.undo(everything=True)
                if storm.visitors:
                    storm.visitors.leave()
                _record(storm, name, seed, kinds, record_property)
        assert those_left(supervisor.mark, within=BOUND) == []
        if mode.has_server:
            check_accounts(storm)
        _resume(storm, mode.command)
        check_endings(supervisor, storm.signals)
        check_whole(store, plan, quiet_day(mode, asked))
        assert (storm.folder / "report" / "report.html").exists()
        assert list(disk.rglob("*.tmp")) == []
    assert storm.hits, "nothing was hit: this was no storm"


def _rage(storm, kinds, batches):
    """Disturb, one after the other while the campaign makes its way, or several at once, or before it has begun."""
    for number, (kind, disturb) in enumerate(kinds):
        if number == 0 and storm.chance.random() < 0.5:
            storm.wait(lambda: False, storm.chance.uniform(0.0, 4.0))
        elif storm.chance.random() < 0.7:
            due = batches * (number + 1) // (len(kinds) + 2)
            storm.wait(lambda due=due: len(storm.parts()) >= due, PATIENCE)
        if storm.is_over():
            return
        if hit := strike(storm, disturb):
            storm.hits.append((kind, hit, round(time.monotonic() - storm.began, 1)))
        print(f"{time.monotonic() - storm.began:.1f} s: {kind}, hit {hit}, {len(storm.parts())} of {batches} batches")


def _calm(storm):
    """Wait until the campaign is complete, and who follows it knows; a process that ends as none should is seen."""
    until = time.monotonic() + BOUND
    while not (storm.is_over() and (storm.visitors is None or storm.visitors.has_seen_the_end)):
        check_endings(storm.supervisor, storm.signals)
        assert time.monotonic() < until, "it does not end"
        time.sleep(1.0)


def _record(storm, mode, seed, kinds, record_property):
    """Hand the figures of a storm to the summary at the end of the session."""
    said = "".join(life.text() for life in storm.supervisor.lives)
    figures = {
        "mode": mode,
        "seed": seed,
        "drawn": [kind for kind, _ in kinds],
        "hits": storm.hits,
        "restarts": len(storm.supervisor.lives) - len({life.name for life in storm.supervisor.lives}),
        "take-overs": storm.take_overs,
        "told of a take-over": said.count("was taken over by another process"),
        "seconds": round(time.monotonic() - storm.began, 1),
    }
    for life in storm.supervisor.lives:
        print(f"--- {life.name} {life.process.pid}: {life.process.poll()}\n{life.text()[-1500:]}")
    print(figures)
    record_property("storm", figures)


def _resume(storm, command):
    """Complete the campaign in peace, as someone does who comes in the morning."""
    for temporary in storm.folder.rglob("*.tmp"):  # of another machine, where it would be taken for alive for an hour
        os.utime(temporary, (0.0, 0.0))
    words = [sys.executable, "-m", command, "resume", storm.campaign, "--store", storm.store.url, "--workers", "2"]
    for _ in range(RESUMES):
        done = subprocess.run(
            words, env=storm.supervisor.environment, capture_output=True, text=True, timeout=BOUND, cwd="/"
        )
        assert "Traceback" not in done.stderr, done.stderr
        if done.returncode == 0:
            break
    assert done.returncode == 0, done.stderr
