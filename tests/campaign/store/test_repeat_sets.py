"""Repeats in the store: beside the rows, sealed and mended like them, with half the step and nothing else."""

from functools import partial

import pytest

from campaign.cluster.cluster import Cluster
from campaign.coordinator.rerun import failed_samples, rerun
from campaign.coordinator.submit import submit
from campaign.errors import StoreError
from campaign.plan_header import repeated_samples
from campaign.spec.load import load_campaign
from campaign.store.store import add_share, read_repeats, repeat_plans, repeated_shares, survey_repeats
from campaign.worker.messages import CampaignAddress
from campaign.worker.row import HalvedStep, halved_settings
from engine.mechanism import load_mechanism, set_values
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import rows, start

WALL = ["wall_s", "attempts"]


@pytest.fixture
def often(tmp_path):
    """Return a campaign of 25 samples that repeats two fifths of them."""
    path = tmp_path / "often.toml"
    path.write_text(SPEC.replace("[variables.J1]", "[repeats]\nshare = 0.4\n[variables.J1]", 1))
    return load_campaign(str(path))


def repeats_of(store, plan):
    """Return what a repeat's sample determines."""
    return read_repeats(store, plan).drop_columns(WALL).sort_by("sample")


@pytest.mark.processes
def test_repeats_are_beside_the_rows(tmp_path, often, campaign, workers):
    """The table and its counts are those of a campaign without repeats; which samples are repeated is known before."""
    shown = []
    store, driven = start(tmp_path / "a", often, simulate=fake_engine.depends_on_step, show=shown.append)
    plain = load_campaign(str(tmp_path / "often.toml"))
    none = plain.spec.model_copy(update={"repeats": plain.spec.repeats.model_copy(update={"share": 0.0})})
    without, driven_without = start(
        tmp_path / "b", type(plain)(none, plain.mechanism), simulate=fake_engine.depends_on_step
    )
    table, alone = rows(store, driven), rows(without, driven_without)
    assert table.equals(alone)
    assert driven.survey.rows == driven.samples == driven.computed == 25
    expected = repeated_samples(25, 0.0, 0.4).tolist()
    found = repeats_of(store, driven.plan)
    assert found["sample"].to_pylist() == expected
    assert read_repeats(without, driven_without.plan) is None
    assert (shown[-1].done, shown[-1].repeats, shown[-1].repeated) == (25, 11, 11)
    by_sample = {row["sample"]: row for row in table.to_pylist()}
    for row in found.to_pylist():
        original = by_sample[row["sample"]]
        assert (row["J1"], row["preload"]) == (original["J1"], original["preload"])
        assert row["FC-1"] == original["FC-1"] - 0.5  # the stand-in measures the step
        assert "simulation.step = 0.008 ms" in row["repeated_with"]


@pytest.mark.processes
def test_repeats_do_not_depend_on_how_they_are_computed(tmp_path, often, workers):
    """Other batches and numbers of workers: the same repeats to the bit."""
    tables = []
    for at, (count, size) in enumerate(((1, 25), (2, 3), (2, 1))):
        store, driven = start(tmp_path / str(at), often, count, size, fake_engine.depends_on_step)
        tables.append(repeats_of(store, driven.plan))
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])


@pytest.mark.processes
def test_a_repeat_that_kills_its_worker_is_a_row(tmp_path, often, workers):
    """Nothing of the campaign is lost or done twice, and the others are repeated."""
    store, driven = start(tmp_path / "a", often, 2, 5, fake_engine.kills_below_its_step)
    assert driven.survey.statuses == {"ok": 25}
    statuses = survey_repeats(store, repeat_plans(store, driven.plan)).statuses
    assert statuses.keys() == {"crashed", "ok"}
    assert sum(statuses.values()) == 11
    again = failed_samples(store, repeat_plans(store, driven.plan)[0])
    done = rerun(store, driven.plan, [], Cluster(workers=1), fake_engine.depends_on_step, repeated=again)
    assert (done.samples, done.repeats) == (0, {"ok": len(again)})
    reference, other = start(tmp_path / "b", often, 2, 5, fake_engine.depends_on_step)
    kept = "earlier_attempts"
    mended = repeats_of(store, driven.plan)
    assert set(mended[kept].to_pylist()) != {""}
    assert mended.drop_columns(kept).equals(repeats_of(reference, other.plan).drop_columns(kept))


@pytest.mark.processes
def test_damaged_repeats_are_computed_again(tmp_path, often, workers):
    """And nothing else: a damaged file goes into quarantine, rows and the other repeats stay as they are."""
    store, driven = start(tmp_path, often, 2, 5, fake_engine.depends_on_step)
    plan, before = driven.plan, repeats_of(store, driven.plan)
    name = f"{plan.campaign_id}/repeats-1/part-000001.parquet"
    content = store.files.read(name)
    store.files.write(name, content[:50] + b"?" + content[51:])
    assert survey_repeats(store, repeat_plans(store, plan), verify=True).missing == {1}
    _, again = start(tmp_path, often, 2, 5, partial(fake_engine.counts, tmp_path / "runs.txt"))
    assert again.computed == 0
    assert (tmp_path / "runs.txt").stat().st_size == repeat_plans(store, plan)[0].batches[1][1]
    assert store.files.exists(f"{name}.bad")
    assert survey_repeats(store, repeat_plans(store, plan), verify=True).missing == set()
    assert repeats_of(store, plan).num_rows == before.num_rows


@pytest.mark.processes
def test_more_repeats_of_a_finished_campaign(tmp_path, often, workers):
    """A larger share adds what lacks; rows and repeats that there are stay; a smaller one changes nothing."""
    store, driven = start(tmp_path, often, 2, 5, fake_engine.depends_on_step)
    plan, before = driven.plan, repeats_of(store, driven.plan)
    store.compact(plan)
    add_share(store, plan, 0.2)
    assert repeated_shares(store, plan) == (0.4,)
    add_share(store, plan, 0.8)
    add_share(store, plan, 0.8)
    assert repeated_shares(store, plan) == (0.4, 0.8)
    _, again = start(tmp_path, often, 2, 5, partial(fake_engine.counts, tmp_path / "runs.txt"))
    assert again.computed == 0
    expected = repeated_samples(25, 0.0, 0.8)
    assert (tmp_path / "runs.txt").stat().st_size == expected.size - before.num_rows
    after = repeats_of(store, plan)
    assert after["sample"].to_pylist() == expected.tolist()
    assert [row for row in after.to_pylist() if row["sample"] in set(before["sample"].to_pylist())] == (
        before.to_pylist()
    )
    for table in repeat_plans(store, plan):
        store.compact(table)
    assert repeats_of(store, plan).equals(after)
    assert survey_repeats(store, repeat_plans(store, plan), verify=True).missing == set()
    store.write_json(plan.campaign_id, "repeats.json", {"shares": [0.2]})
    with pytest.raises(StoreError, match=r"repeats\.json.*shares.*0\.4"):
        repeated_shares(store, plan)


@pytest.mark.processes
def test_a_longer_campaign_takes_over_repeats(tmp_path, often, workers):
    """With its rows: only what is new is simulated, once as a row and once more as a repeat."""
    store, short = start(tmp_path, often, 2, 5, fake_engine.depends_on_step)
    longer = load_campaign(str(tmp_path / "often.toml"), samples=35)
    plan = submit(store, longer, 5)
    assert survey_repeats(store, repeat_plans(store, plan)).done == 11
    start(tmp_path, longer, 2, 5, partial(fake_engine.counts, tmp_path / "runs.txt"))
    more = repeated_samples(35, 0.0, 0.4).size - 11
    assert (tmp_path / "runs.txt").stat().st_size == 10 + more
    taken = repeats_of(store, plan).slice(0, 11)
    assert taken.replace_schema_metadata().equals(repeats_of(store, short.plan).replace_schema_metadata())


def test_half_of_every_step():
    """A fixed step is halved; adaptive ones in all that their length depends on; inputs that set a step count."""
    c60 = load_mechanism("c60")
    assert halved_settings(c60, {"J1": 0.07}, 5e-3) == {"simulation.step": 2.5e-3}
    adaptive = {"simulation.step": 8e-3, "simulation.adaptive.longest": 0.032, "simulation.adaptive.travel": 4e-3}
    assert halved_settings(c60, {"J1": 0.07}, None) == adaptive
    assert halved_settings(c60, {"simulation.step": 1e-4}, None) == adaptive | {"simulation.step": 5e-5}
    calls = []
    HalvedStep(lambda *args, **more: calls.append((args, more)))(c60, {"J1": 0.07}, step=5e-3, horizon=9.0)
    HalvedStep(lambda *args, **more: calls.append((args, more)))(c60, {"J1": 0.07})
    (_, fixed), (given, free) = calls[0][0], calls[1][0]
    assert fixed == {"J1": 0.07, "simulation.wall_limit": 120.0}
    assert calls[0][1] == {"step": 2.5e-3, "horizon": 9.0}
    assert free["simulation.adaptive.travel"] == 4e-3
    assert calls[1][1]["step"] is None
    assert set_values(given, free).simulation.adaptive.longest == 0.032


def test_address_stays_small(store, plan):
    """Shares travel in it, not the numbers of the samples."""
    address = CampaignAddress.of(store, plan, repeats=(0.4, 0.8))
    assert address.repeats == (0.4, 0.8)
