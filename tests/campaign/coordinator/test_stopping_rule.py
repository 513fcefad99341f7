"""Stop when sure: at checkpoints of the sample order, alike for any number of workers."""

import numpy as np
import pytest
from scipy import stats

from campaign.coordinator.stopping_rule import judge
from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.spec.campaign_file import Stop
from campaign.spec.load import load_campaign
from campaign.store import Store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from reporting import capability
from tests.campaign import fake_engine
from tests.campaign.driving import computed, rows, start

pytestmark = [pytest.mark.usefixtures("forked_workers"), pytest.mark.processes]

RULE = """
[stop]
response = "FC-1"
statistic = "mean"
half_width = 0.03
min_samples = 8
max_samples = 200
"""


def stopping(campaign_file, rule=RULE):
    """Return the campaign with a stopping rule."""
    campaign_file.write_text(campaign_file.read_text().replace("samples = 25\n", "") + rule)
    return load_campaign(str(campaign_file))


def test_checkpoints_grow_by_a_quarter():
    """From the least number of samples to the last sample."""
    rule = Stop(response="x", statistic="mean", half_width=1.0, min_samples=10)
    assert rule.checkpoints(30) == (10, 12, 15, 18, 22, 27, 30)
    assert rule.checkpoints(5) == (5,)


def test_stops_alike_for_any_workers_and_batches(tmp_path, campaign_file):
    """The same samples and rows, whatever the order in which batches arrive; the rule holds there and not before."""
    campaign = stopping(campaign_file)
    assert campaign.spec.samples == 200
    heartbeats = []
    store, outcome = start(tmp_path / "a", campaign, workers=2, batch_size=3, show=heartbeats.append)
    table = rows(store, outcome)
    assert outcome.verdict.sure
    assert (heartbeats[-1].samples, heartbeats[-1].done, heartbeats[-1].left) == (table.num_rows, table.num_rows, 0)
    assert heartbeats[-1].responses["FC-1"]["n"] == table.num_rows
    assert outcome.samples == table.num_rows == outcome.verdict.samples < 200
    low, high = stats.t.interval(
        0.95, table.num_rows - 1, table["FC-1"].to_numpy().mean(), stats.sem(table["FC-1"].to_numpy())
    )
    assert (outcome.verdict.low, outcome.verdict.high) == pytest.approx((low, high), rel=1e-9)
    assert high - low <= 0.06
    points = campaign.spec.stop.checkpoints(200)
    before = points[points.index(outcome.samples) - 1]
    assert not judge(store, outcome.plan, before).sure
    assert rows(*start(tmp_path / "b", campaign, workers=1, batch_size=7)).equals(table)


def test_rows_that_arrive_after_the_end_do_not_count(tmp_path, campaign_file, workers, monkeypatch):
    """A worker may finish a batch beyond the end when nobody waits for it any more."""
    record = Store.record

    def late(self, plan, *parts):
        if isinstance(plan, Plan):
            address = CampaignAddress(self.url, plan.campaign_id, plan.row_build, fake_engine.simulate)
            run_batch(address, BatchRequest(len(plan.batches) - 1))
        record(self, plan, *parts)

    monkeypatch.setattr(Store, "record", late)
    heartbeats = []
    store, outcome = start(tmp_path / "a", stopping(campaign_file), batch_size=3, show=heartbeats.append)
    assert outcome.verdict.sure
    assert store.read_part(outcome.plan, len(outcome.plan.batches) - 1).num_rows > 0
    assert (heartbeats[-1].done, rows(store, outcome).num_rows) == (outcome.samples, outcome.samples)


def test_stopped_campaign_computes_nothing_more(tmp_path, campaign_file, workers):
    """The same command again finds it at its end."""
    campaign = stopping(campaign_file)
    store, first = start(tmp_path / "a", campaign)
    store, again = start(tmp_path / "a", campaign)
    assert (again.computed, again.samples) == (0, first.samples)
    assert store.survey(again.plan).missing == []


def test_never_sure(tmp_path, campaign_file, workers):
    """A rule that is not met ends at the last sample, and says how far it is."""
    store, outcome = start(tmp_path / "a", stopping(campaign_file, RULE.replace("0.03", "1e-6").replace("200", "20")))
    assert outcome.samples == store.table().num_rows == 20
    assert not outcome.verdict.sure
    assert outcome.verdict.samples == 20


@pytest.mark.parametrize("statistic", ["mean", "std", "cp", "cpk", "ppm"])
def test_every_statistic_has_an_interval(tmp_path, campaign_file, statistic):
    """Around its value, narrower the more samples there are."""
    campaign = stopping(campaign_file, RULE.replace('"mean"', f'"{statistic}"'))
    store, plan = computed(tmp_path, campaign, 100)
    few, all_of_them = judge(store, plan, 20), judge(store, plan, 200)
    for verdict in (few, all_of_them):
        assert verdict.low <= verdict.value <= verdict.high
    assert all_of_them.high - all_of_them.low < few.high - few.low


BAD = {
    "unknown response": ('response = "FC-1"', 'response = "FC-9"', 'stop.response = "FC-9": c60 has no response of'),
    "no limits": ('response = "FC-1"\nstatistic = "mean"', 'response = "FC-2"\nstatistic = "cpk"', "needs limits"),
    "crossed": ("max_samples = 200", "max_samples = 5", "less than min_samples = 8"),
    "unknown statistic": ('"mean"', '"median"', "stop.statistic"),
    "not narrow": ("half_width = 0.03", "half_width = 0", "stop.half_width = 0"),
}


@pytest.mark.parametrize(("old", "new", "message"), BAD.values(), ids=BAD)
def test_bad_rule_is_refused(campaign_file, old, new, message):
    """With the key and what is allowed."""
    with pytest.raises(SpecError) as caught:
        stopping(campaign_file, RULE.replace(old, new))
    assert message in str(caught.value)


LOTS = """
[stop]
response = "FC-1"
statistic = "cpk"
half_width = 50.0
min_samples = 20
max_samples = 400
"""


def in_lots(campaign_file, rule=LOTS, size=40):
    """Return the campaign with a stopping rule and production lots of one variable."""
    text = campaign_file.read_text().replace(
        "upper = 0.13\n", f"upper = 0.13\nbatch = {{size = {size}, std = 0.009}}\n", 1
    )
    campaign_file.write_text(text)
    return stopping(campaign_file, rule)


@pytest.mark.parametrize("statistic", ["mean", "std", "cp", "cpk", "ppm"])
def test_never_stops_before_enough_lots(tmp_path, campaign_file, statistic):
    """However wide the asked interval is: one lot of 40 tells nothing of the next one."""
    rule = LOTS.replace('"cpk"', f'"{statistic}"').replace("50.0", "1e9")
    store, plan = computed(tmp_path, in_lots(campaign_file, rule), 100)
    for samples in (20, 40, 100, 199):
        verdict = judge(store, plan, samples)
        assert not verdict.sure
        assert verdict.lots == samples // 40
    assert judge(store, plan, 200).sure
    assert judge(store, plan, 200).lots == 5
    assert "5 whole production lots" in judge(store, plan, 200).text()


def test_too_few_lots_say_why(tmp_path, campaign_file):
    """And what would help."""
    store, plan = computed(tmp_path, in_lots(campaign_file), 100)
    verdict = judge(store, plan, 100)
    assert (verdict.low, verdict.high, verdict.sure) == (None, None, False)
    assert "intervals need 5" in verdict.text()
    assert "2 whole production lots" in verdict.text()


def test_intervals_of_the_rule_are_those_of_lots(tmp_path, campaign_file):
    """The report of the same samples has the same interval."""
    store, plan = computed(tmp_path, in_lots(campaign_file), 100)
    table, verdict = store.table(), judge(store, plan, 300)
    x = table["FC-1"].to_numpy()[:300]
    c = capability(x, 9.0, 16.0, batches=np.arange(300) // 40)
    assert (verdict.low, verdict.high) == pytest.approx(c.cpk_interval)
    assert c.interval_method == "production lots"


def test_lots_of_two_variables_end_together(tmp_path, campaign_file):
    """Lots of 40 and of 60: only at the multiples of 120 do all shifts change."""
    campaign_file.write_text(
        campaign_file.read_text().replace(
            'distribution = "uniform"\n', 'distribution = "uniform"\nbatch = {size = 60, std = 0.005}\n', 1
        )
    )
    store, plan = computed(tmp_path, in_lots(campaign_file, LOTS.replace("400", "900")), 300)
    assert (judge(store, plan, 599).lots, judge(store, plan, 600).lots) == (4, 5)
    assert not judge(store, plan, 599).sure
