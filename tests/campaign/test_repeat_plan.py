"""Which samples are repeated: known beforehand, spread over the campaign, kept when it grows."""

import numpy as np

from campaign.plan import make_plan
from campaign.repeat_plan import plan_repeats, repeated_samples, usual_share
from campaign.spec.load import load_campaign
from tests.campaign.conftest import SPEC
from tests.each import each


def test_every_beginning_has_its_share():
    """However early a campaign stops, about the share of its samples is repeated."""
    for share in (0.03, 0.05, 0.2, 0.9):
        chosen = repeated_samples(10_000, 0.0, share)
        for stopped in (100, 333, 1000, 5000, 10_000):
            assert abs(np.count_nonzero(chosen < stopped) - share * stopped) < 2.5
    assert repeated_samples(10_000, 0.0, 1.0).tolist() == list(range(10_000))
    assert repeated_samples(10_000, 0.0, 0.0).size == 0


def test_more_keep_what_there_is():
    """A larger share and more samples add repeats and drop none; shares beyond the first take the others."""
    few, many = repeated_samples(3_000_000, 0.0, 0.001), repeated_samples(3_000_000, 0.0, 0.0013)
    assert set(few.tolist()) < set(many.tolist())
    assert np.array_equal(few[few < 1000], repeated_samples(1000, 0.0, 0.001))
    added = repeated_samples(3_000_000, 0.001, 0.0013)
    assert sorted([*few.tolist(), *added.tolist()]) == many.tolist()


def test_no_design_is_in_step_with_it():
    """Samplers repeat a pattern every so many samples; the repeats meet all its places alike."""
    chosen = repeated_samples(100_000, 0.0, 0.05)
    for width in (2, 3, 8, 9, 13, 16, 21, 34, 64):
        counts = np.bincount(chosen % width, minlength=width)
        assert counts.min() > 0.9 * chosen.size / width


@each(("samples", "repeats"), [(1, 0), (20, 1), (60, 3), (100, 5), (400, 20), (500, 20), (1000, 30), (5000, 150)])
def test_usual_share(samples, repeats):
    """3 %, but up to 5 % to get twenty: with twice the steps a tenth of the campaign's time."""
    assert usual_share(samples) <= 0.05
    assert abs(repeated_samples(samples, 0.0, usual_share(samples)).size - repeats) <= 1


def test_usual_share_of_many_samples():
    """300 repeats are enough, however long the campaign is."""
    assert abs(repeated_samples(1_000_000, 0.0, usual_share(1_000_000)).size - 300) <= 2


def test_batches_follow_those_of_the_campaign(plan):
    """Each batch of repeats belongs to one batch of the campaign, and the sets hold each repeat once."""
    sets = plan_repeats(plan, (0.1, 0.1, 0.5))
    assert [repeats.number for repeats in sets] == [1, 3]
    numbers = sorted(number for repeats in sets for number in repeats.numbers)
    assert numbers == repeated_samples(25, 0.0, 0.5).tolist()
    for repeats in sets:
        for (first, count), batch in zip(repeats.batches, repeats.campaign_batches, strict=True):
            begin, size = plan.batches[batch]
            assert all(begin <= number < begin + size for number in repeats.numbers_of(first, first + count))
            assert repeats.batches[repeats.batch_of(batch)] == (first, count)
        assert sum(count for _, count in repeats.batches) == len(repeats.numbers)


def test_share_of_a_plan(tmp_path):
    """The file's share, the usual one without it, none with weights; a plan of an earlier version has none."""
    path = tmp_path / "demo.toml"
    shares = []
    for added in ("", "[repeats]\nshare = 0.4\n", "[repeats]\nshare = 0\n"):
        path.write_text(SPEC.replace("[variables.J1]", f"{added}[variables.J1]", 1))
        plan = make_plan(load_campaign(str(path)), 10)
        assert type(plan).from_json(plan.to_json()).repeats == plan.repeats
        shares.append(plan.repeats)
    assert shares == [0.05, 0.4, 0.0]
    aimed = 'sampler = "importance"\n[[importance.components]]\nshare = 0.5\nscale = 2.0\n[variables.J1]'
    path.write_text(SPEC.replace("[variables.J1]", aimed, 1))
    assert make_plan(load_campaign(str(path)), 10).repeats == 0.0
