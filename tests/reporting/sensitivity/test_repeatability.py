"""The scatter between two runs of a sample: its share, its interval, and what it does to sensitivity."""

import re
from dataclasses import replace

import numpy as np
import pytest

from reporting.samples import read_samples
from reporting.sensitivity import sensitivity
from reporting.sensitivity.repeatability import repeatabilities, repeatability, unexplained_by_rows
from reporting.sensitivity.summary import Known, without_scatter
from reporting.sensitivity.total_order import TotalOrder, total_order_indices
from reporting.trust.card import repeatable
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, repeats_of

CONFIDENCE = 0.95


def scattered(rng, share, samples, pairs, noise):
    """Return what repeats tell of a response of variance 1, of which scatter has this share."""
    exact = rng.normal(size=samples) * np.sqrt(1 - share)
    y = exact + np.sqrt(share) * noise(rng, samples)
    again = exact[:pairs] + np.sqrt(share) * noise(rng, pairs)
    std = float(np.std(y, ddof=1))
    return repeatability(y[:pairs], again, std, (std * 0.93, std * 1.08), CONFIDENCE)


def normal(rng, n):
    return rng.normal(size=n)


def jumps(rng, n):
    return np.where(rng.random(n) < 0.2, rng.normal(size=n), 0.1 * rng.normal(size=n)) / np.sqrt(0.208)


@pytest.mark.parametrize(("noise", "pairs", "least"), [(normal, 5, 0.93), (normal, 30, 0.93), (jumps, 40, 0.91)])
def test_intervals_hold(noise, pairs, least):
    """At least about as often as they are meant to, with few pairs and with scatter that few samples show."""
    rng = np.random.default_rng(4)
    found = [scattered(rng, 0.3, 400, pairs, noise).share_interval for _ in range(300)]
    assert np.mean([low <= 0.3 <= high for low, high in found]) >= least


def test_estimates():
    """Half the variance of the difference, in the unit of the response; a shift is no scatter."""
    rng = np.random.default_rng(2)
    first = rng.normal(10.0, 2.0, 4000)
    second = first + 0.7 + np.sqrt(2) * 0.5 * rng.normal(size=4000)
    found = repeatability(first, second, 2.0, (1.96, 2.04), CONFIDENCE)
    assert found.sigma == pytest.approx(0.5, rel=0.05)
    assert found.share == pytest.approx(0.0625, rel=0.1)
    assert found.removable == pytest.approx(1 - found.share)
    assert found.share_interval[0] < 0.0625 < found.share_interval[1]
    assert found.shift == pytest.approx(0.7, abs=0.05)
    assert found.shift_interval[1] - found.shift_interval[0] == pytest.approx(4 * 0.5 * np.sqrt(2 / 4000), rel=0.05)
    assert found.unseen < 0.001


def test_failed_repeats_and_few_pairs():
    """Pairs need both runs; below five there is no interval, below two no estimate."""
    first = np.array([1.0, 2.0, np.nan, 4.0, np.nan])
    second = np.array([1.1, np.nan, 3.0, 4.2, np.nan])
    found = repeatability(first, second, 1.0, None, CONFIDENCE)
    assert (found.pairs, found.lost, found.share_interval, found.sigma_interval) == (2, 2, None, None)
    assert found.sigma == pytest.approx(np.std([0.1, 0.2], ddof=1) / np.sqrt(2))
    assert repeatability(first[:2], second[:2], 1.0, None, CONFIDENCE).sigma is None
    assert repeatability(np.zeros(0), np.zeros(0), 1.0, None, CONFIDENCE).pairs == 0


def test_equal_runs_scatter_by_nothing():
    """Also where they differ by rounding; a response that does not vary, or is no production, has no share."""
    x = np.linspace(10.0, 11.0, 20)
    found = repeatability(x, np.nextafter(x, 12.0), 0.3, (0.25, 0.4), CONFIDENCE)
    assert (found.sigma, found.share, found.share_interval) == (0.0, 0.0, (0.0, 0.0))
    assert repeatability(x, x + 1e-3 * np.cos(9 * x), 0.0, None, CONFIDENCE).share is None
    assert repeatability(x, x + 1e-3 * np.cos(9 * x), None, None, CONFIDENCE).share is None


def test_a_constant_has_no_scatter_to_list():
    """Its values may differ in the last digits, up to what counts as a constant; real scatter has its sigma named."""
    spec, table = c60_spec(200), c60_table(200)
    samples, analysis = read_samples(table, spec), analysis_of(table, spec)
    for size, named in ((2e-13, False), (1e-6, True)):
        repeats = repeats_of(table, 2, {r.name: 1e-3 for r in spec.responses})
        rounding = size * np.random.default_rng(1).normal(size=repeats.sample.size)
        first = replace(samples, values=samples.values | {"FC-1": np.full_like(samples.values["FC-1"], 3.0)})
        repeats = replace(repeats, values=repeats.values | {"FC-1": 3.0 + rounding})
        found = repeatabilities(repeats, first, first, spec, CONFIDENCE)
        card = repeatable(tuple(replace(r, repeatability=found[r.spec.name]) for r in analysis.responses), repeats)
        assert ("Sigma of the scatter: FC-1" in card.text) is named, card.text


def test_scatter_is_no_interaction():
    """What repeats explain is not called an interaction, nor is a design advised; what they do not explain still is."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=(1500, 3))
    columns = dict(zip("abc", x.T, strict=True))
    noise, product = rng.normal(size=1500), x[:, 1] * x[:, 2]

    def of(y, scatter):
        share = scatter / np.var(y)
        known = repeatability(np.zeros(0), np.zeros(0), None, None, CONFIDENCE)
        known = replace(known, pairs=60, share=share, share_interval=(0.8 * share, 1.25 * share))
        return sensitivity(columns, {"y": y}, known={"y": Known(repeatability=known)}).responses[0]

    blind = sensitivity(columns, {"y": x[:, 0] + noise}).responses[0]
    assert "interactions, jumps, or scatter that no repeat has measured" in blind.notes[-1]
    assert [i.verdict for i in blind.influences] == ["critical", "open", "open"]
    found = of(x[:, 0] + noise, 1.0)
    assert found.scatter == pytest.approx(0.5, abs=0.05)
    assert found.rest < 0.05
    assert "which explains it" in found.notes[-1]
    assert not any("saltelli" in note or "interaction" in note for note in found.notes)
    both = of(x[:, 0] + noise + 1.5 * product, 1.0)
    assert both.rest_interval[0] > 0.3
    assert "interactions or jumps" in both.notes[-1]
    assert "saltelli" in both.notes[-1]


def test_a_variable_without_an_effect_is_no_longer_open():
    """Little scatter that is not measured leaves it open; measured, nothing is left that it could act in."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(3000, 2))
    y = x[:, 0] + np.sqrt(0.4) * rng.normal(size=3000)
    columns = {"a": x[:, 0], "b": x[:, 1]}
    assert sensitivity(columns, {"y": y}).responses[0].influences[1].verdict == "open"
    known = repeatability(np.zeros(0), np.zeros(0), None, None, CONFIDENCE)
    known = replace(known, pairs=300, share=0.4 / 1.4, share_interval=(0.25, 0.33))
    found = sensitivity(columns, {"y": y}, known={"y": Known(repeatability=known)}).responses[0]
    assert found.influences[1].verdict == "not critical"


def test_total_order_without_scatter():
    """The scatter's share is in every total-order index and in no first-order one; taken off, the indices are right."""
    rng = np.random.default_rng(6)
    n, share, errors, raw = 512, 0.4, [], []
    for _ in range(40):
        a, b = rng.normal(size=(2, n, 3))
        rows = [a, b, *(np.where(np.arange(3) == j, b, a) for j in range(3))]
        exact = np.stack([r[:, 0] + 0.5 * r[:, 1] * r[:, 2] for r in rows], axis=1)
        y = exact + np.sqrt(1.25 * share / (1 - share)) * rng.normal(size=exact.shape)
        totals = total_order_indices(y.ravel(), ("a", "b", "c"))
        assert isinstance(totals, TotalOrder)
        measured = repeatability(np.zeros(0), np.zeros(0), None, None, CONFIDENCE)
        measured = replace(measured, pairs=100, share=share, share_interval=(0.3, 0.53))
        mended = without_scatter(totals, Known(repeatability=measured), 2.1)
        truth = np.array([0.8, 0.2, 0.2]) * (1 - share)
        raw.append(totals.total - truth)
        errors.append(np.concatenate([mended.total - truth, mended.first_order - [0.48, 0.0, 0.0]]))
        assert np.all(mended.total_error > totals.total_error)
    assert np.mean(raw, axis=0) == pytest.approx(np.full(3, share), abs=0.04)
    assert np.mean(errors, axis=0) == pytest.approx(np.zeros(6), abs=0.04)


@pytest.mark.slow
def test_the_card_says_what_scatter_means():
    """Attention, with share and interval, and what it limits; the other responses in one sentence."""
    spec, table = c60_spec(300), c60_table(300)
    scatter = {r.name: 0.0 for r in spec.responses} | {"FC-1": 0.3, "FC-4": 0.02}
    analysis = analysis_of(table, spec, repeats=repeats_of(table, 6, scatter))
    line = next(check for check in analysis.trust if check.name == "Repeatability")
    assert line.level == "attention"
    assert "50 samples were simulated a second time, with half the step." in line.text
    share = analysis.responses[0].repeatability.share
    assert line.value == share == pytest.approx(0.09 / 0.478**2, rel=0.5)
    assert f"{100 * share:.0f} % (" in line.text
    assert f"all variables together explain at most {100 * (1 - share):.0f} % of the variance of FC-1" in line.text
    assert re.search(r"In the other responses scatter is at most .* of the variance \(FC-4\)", line.text)
    assert analysis.responses[0].sensitivity.scatter == share


def test_the_card_of_other_repeats():
    """None: it says so; few: what they may miss; a shift, and runs that succeed with one step only: attention."""
    spec, table = c60_spec(200), c60_table(200)
    samples, responses = read_samples(table, spec), analysis_of(table, spec).responses

    def card(repeats):
        found = repeatabilities(repeats, samples, samples, spec, CONFIDENCE)
        return repeatable(tuple(replace(r, repeatability=found.get(r.spec.name)) for r in responses), repeats)

    none = card(None)
    assert (none.level, none.value) == ("info", None)
    assert none.text.startswith("No sample was repeated")
    still = {r.name: 0.001 for r in spec.responses}
    few, many = card(repeats_of(table, 20, still)), card(repeats_of(table, 2, still))
    assert (few.level, many.level) == ("good", "good")
    missed = "So few may miss scatter that occurs in up to 26 % of the samples. To repeat more: clearcap repeat"
    assert missed in few.text
    assert "may miss" not in many.text
    doubtful = card(repeats_of(table, 40, still | {"FC-2": 0.014}))
    assert doubtful.level == "info"
    repeats = repeats_of(table, 2, still)
    moved = card(replace(repeats, values=repeats.values | {"FC-2": repeats.values["FC-2"] + 0.03}))
    assert moved.level == "attention"
    assert "Halving the step shifts the mean of FC-2 by 0.03" in moved.text
    assert "mm: the step is too long for it." in moved.text
    lost = card(replace(repeats, ok=repeats.ok & (np.arange(repeats.ok.size) > 1)))
    assert lost.level == "attention"
    assert "For 2 samples only one of the two runs succeeded" in lost.text
    assert card(replace(repeats, sample=repeats.sample[:0], ok=repeats.ok[:0], values={})).level == "info"


def test_scatter_is_at_most_what_the_inputs_leave_unexplained() -> None:
    """Two of fifteen runs with half the step jump: that is a bias of the step, and no scatter of the rows."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 3))
    y = x @ [1.0, 0.5, 0.2] + 0.2 * rng.normal(size=300)
    left = unexplained_by_rows(x, y)
    truth = 0.04 / (1.29 + 0.04)
    assert left[0] == pytest.approx(truth, rel=0.25)
    half = y[:15] + 0.01 * rng.normal(size=15)
    half[[3, 9]] -= 3.0
    free = repeatability(y[:15], half, float(y.std(ddof=1)), None, 0.95)
    capped = repeatability(y[:15], half, float(y.std(ddof=1)), None, 0.95, left)
    assert free.share > 0.3
    assert capped.share == left[0]
    assert capped.share_interval == (0.0, left[1])
    assert capped.beyond_rows == pytest.approx(free.share)
    small = repeatability(y[:15], y[:15] + 0.05 * rng.normal(size=15), float(y.std(ddof=1)), None, 0.95, left)
    assert small.beyond_rows is None


def test_few_rows_and_inputs_that_do_not_vary_leave_no_warning() -> None:
    """Every run may have failed, and the deviation of 0.95 fifty times is 1e-16, by rounding."""
    for n in range(3):
        assert unexplained_by_rows(np.zeros((n, 2)), np.zeros(n)) is None
    rng = np.random.default_rng(3)
    varies, y = rng.normal(size=(50, 1)), rng.normal(size=50)
    constant = np.column_stack([varies, np.full(50, 0.95)])
    assert unexplained_by_rows(constant, y) == unexplained_by_rows(varies, y)
