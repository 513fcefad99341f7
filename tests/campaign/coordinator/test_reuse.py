"""A campaign of more samples, or of other limits, reuses the rows of an earlier one."""

from functools import partial

import pytest

from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign import fake_engine
from tests.campaign.driving import computed

KEPT = ["wall_s", "attempts"]


def test_a_longer_campaign_takes_over_the_rows_of_a_shorter_one(tmp_path, campaign, campaign_file, caplog):
    """All whole batches of them, to the bit; the rest is to be computed."""
    caplog.set_level("INFO")
    store, short = computed(tmp_path / "a", campaign, 10)
    longer = load_campaign(str(campaign_file), samples=64)
    plan = submit(store, longer, 4)
    assert "24 rows are reused" in caplog.text
    assert plan.campaign_id != short.campaign_id
    assert store.survey(plan).rows == 24
    rows = store.table(plan.campaign_id)
    assert rows.equals(store.table(short.campaign_id).slice(0, 24))
    store, plan = computed(tmp_path / "a", longer, 4)
    whole, _ = computed(tmp_path / "b", longer, 100)
    assert store.table(plan.campaign_id).drop_columns(KEPT).equals(whole.table().drop_columns(KEPT))


def test_other_limits_need_no_new_runs(tmp_path, campaign, campaign_file):
    """Nor does another title: the whole table is reused."""
    store, _ = computed(tmp_path, campaign, 10)
    campaign_file.write_text(campaign_file.read_text().replace("usl = 16.0", "usl = 15.0"))
    plan = submit(store, load_campaign(str(campaign_file)), 7)
    assert store.survey(plan).missing == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("seed = 7", "seed = 8"),
        ("std = 0.0175", "std = 0.0176"),
        ("samples = 25", "samples = 25\n[simulation]\nstep = 0.001"),
        ("seed = 7", 'seed = 7\nsampler = "sobol"'),
        ("[responses.FC-1]", "[[failures.retry]]\nstep = 0.0005\n[responses.FC-1]"),
    ],
)
def test_other_rows_are_not_taken_over(tmp_path, campaign, campaign_file, old, new):
    """Another seed, distribution, step, sampler or retry of failed runs: other rows."""
    store, _ = computed(tmp_path, campaign, 10)
    text = campaign_file.read_text().replace(old, new)
    head, _, tail = text.partition("[simulation]\nstep = 0.001")
    campaign_file.write_text(head + tail + ("\n[simulation]\nstep = 0.001\n" if tail else ""))
    plan = submit(store, load_campaign(str(campaign_file), samples=30), 10)
    assert store.survey(plan).rows == 0


def test_other_policies_and_orders(tmp_path, campaign, campaign_file):
    """How many runs may fail is nothing to a row; in which order variables are named is, for columns are in it."""
    store, _ = computed(tmp_path, campaign, 10)
    text = campaign_file.read_text()
    campaign_file.write_text(f"{text}\n[failures]\nmax_failed = 3\n")
    assert store.survey(submit(store, load_campaign(str(campaign_file), samples=30), 10)).rows == 20
    first, second = text.index("[variables.J1]"), text.index("[variables.preload]")
    end = text.index("[responses.FC-1]")
    campaign_file.write_text(text[:first] + text[second:end] + text[first:second] + text[end:])
    other = submit(store, load_campaign(str(campaign_file), samples=40), 10)
    assert list(other.spec.variables) == ["preload", "J1"]
    assert store.survey(other).rows == 0


def test_what_is_there_is_surveyed_once(tmp_path, campaign, campaign_file, monkeypatch):
    """However many batches the new plan has, of which each may be there already."""
    store, _ = computed(tmp_path, campaign, 10)
    survey, seen = type(store).survey, []

    def counted(self, plan, **options):
        seen.append(plan)
        return survey(self, plan, **options)

    monkeypatch.setattr(type(store), "survey", counted)
    plan = submit(store, load_campaign(str(campaign_file), samples=64), 2)
    assert (len(plan.batches), seen.count(plan)) == (32, 1)


def test_sampler_that_cannot_keep_its_samples_says_so(tmp_path, campaign_file, caplog):
    """Latin hypercube samples of another number are others."""
    caplog.set_level("INFO")
    campaign_file.write_text(campaign_file.read_text().replace("seed = 7", 'seed = 7\nsampler = "lhs"'))
    store, short = computed(tmp_path, load_campaign(str(campaign_file)), 10)
    plan = submit(store, load_campaign(str(campaign_file), samples=50), 10)
    assert store.survey(plan).rows == 0
    assert f"the rows of {short.campaign_id} cannot be reused: lhs divides each range" in caplog.text


def test_crashed_rows_are_computed_again(tmp_path, campaign, campaign_file):
    """What came from a machine and not from the sample is not reused."""
    limit = sorted(computed(tmp_path / "a", campaign, 10)[0].table()["J1"].to_pylist())[-2]
    store, short = computed(tmp_path / "b", campaign, 10, partial(fake_engine.raises_above, limit))
    assert store.survey(short).statuses == {"crashed": 1, "ok": 24}
    plan = submit(open_store(store.url), load_campaign(str(campaign_file), samples=64), 5)
    assert store.survey(plan).statuses == {"ok": 20}
