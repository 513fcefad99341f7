"""Values of a production lot share a shift: intervals rest on the differences between lots."""

import math

import numpy as np
import pytest
from scipy import stats

from reporting import capability
from reporting.capability.lots import LEAST_LOTS, describe_lots, lot_error
from reporting.capability.row_order import convergence, drift
from reporting.capability.shares import nonconforming


def in_lots(rng: np.random.Generator, lots: int, size: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Return normal values with sigma 1 within lots and `ratio` between them, and the lot of each value."""
    x = rng.normal(size=(lots, size)) + ratio * rng.normal(size=(lots, 1))
    return x.ravel(), np.repeat(np.arange(lots), size)


def of_unequal_size(x: np.ndarray, lots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the values without some of the later half of the lots: lots of 50 and of 20."""
    kept = (np.arange(x.size) % 50 < 20) | (lots < 10)
    return x[kept], lots[kept]


def coverage(ratio: float, *, lots: int = 20, unequal: bool = False, runs: int = 200) -> dict[str, float]:
    """Return how often the intervals hold the truth of a process with Cpl 1.33 and Cpu 1.83."""
    rng, std = np.random.default_rng(round(100 * ratio) + lots), math.hypot(1.0, ratio)
    lsl, usl, target = -3.99 * std, 5.49 * std, 0.4 * std
    bench = -stats.norm.ppf(stats.norm.cdf(-3.99) + stats.norm.sf(5.49))
    truth = {
        "mean": 0.0,
        "std": std,
        "cp": 1.58,
        "cpk": 1.33,
        "cpl": 1.33,
        "cpu": 1.83,
        "cc": -(usl + lsl) / (usl - lsl),
        "cpm": 1.58 / math.sqrt(1.16),
        "z_bench": bench,
    }
    inside = dict.fromkeys(truth, 0)
    for _ in range(runs):
        x, lot_of = in_lots(rng, lots, 50, ratio)
        c = capability(x, lsl, usl, target, batches=lot_of) if not unequal else None
        if c is None:
            x, lot_of = of_unequal_size(x, lot_of)
            c = capability(x, lsl, usl, target, batches=lot_of)
        for name, value in truth.items():
            low, high = getattr(c, f"{name}_interval")
            inside[name] += low <= value <= high
    return {name: count / runs for name, count in inside.items()}


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.3, 1.0])
def test_intervals_of_twenty_lots_hold(ratio: float) -> None:
    """Nominal 95 %, three binomial standard errors of 200 are 0.046; independent values' intervals: 38 % at ratio 1."""
    assert min(coverage(ratio).values()) >= 0.95 - 0.046


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ratio", "lots", "unequal"),
    [(0.0, 20, False), (0.7, 20, False), (1.0, 5, False), (1.0, 10, False), (0.7, 50, False), (0.7, 20, True)],
)
def test_intervals_of_lots_hold_for_any_number_and_size(ratio: float, lots: int, unequal: bool) -> None:
    """Three binomial standard errors of 400 are 0.033."""
    found = coverage(ratio, lots=lots, unequal=unequal, runs=400)
    assert min(found.values()) >= 0.95 - 0.033
    assert found["cpk"] <= 0.995


def test_lots_that_agree_cost_little() -> None:
    """A response that does not depend on the lot keeps nearly the interval of independent values."""
    widths = []
    for seed in range(20):
        x, lots = in_lots(np.random.default_rng(seed), 20, 50, 0.0)
        with_lots, without = capability(x, -4, 5.5, batches=lots), capability(x, -4, 5.5)
        widths.append(np.diff(with_lots.cpk_interval)[0] / np.diff(without.cpk_interval)[0])
        assert with_lots.lots.effective > 0.4 * x.size
    assert 0.9 < np.median(widths) < 1.25


def test_the_effective_number_is_that_of_the_variance_of_the_mean() -> None:
    """With sigma between equal to sigma within, 20 lots of 50 are worth 1000 / (1 + 49/2) = 39 values."""
    found = [describe_lots(*in_lots(np.random.default_rng(seed), 20, 50, 1.0)) for seed in range(200)]
    assert np.median([lots.effective for lots in found]) == pytest.approx(39.2, rel=0.1)
    assert np.median([lots.intraclass for lots in found]) == pytest.approx(0.5, abs=0.05)
    assert found[0].count == pytest.approx(found[0].worth) == 20


def test_too_few_lots_have_no_interval_and_a_reason() -> None:
    """One lot of 500 tells nothing of the next one."""
    x, lots = in_lots(np.random.default_rng(1), LEAST_LOTS, 100, 0.5)
    assert capability(x, -4, 4, batches=lots).interval_method == "production lots"
    for few in (1, 2, LEAST_LOTS - 1):
        c = capability(x[: 100 * few], -4, 4, batches=lots[: 100 * few])
        assert c.cpk is not None
        assert c.cpk_interval is c.cp_interval is c.std_interval is c.ppm_expected_interval is None
        assert f"intervals need {LEAST_LOTS}" in c.interval_reason
    most_in_one = np.repeat(np.arange(8), [493, 1, 1, 1, 1, 1, 1, 1])
    assert capability(x, -4, 4, batches=most_in_one).cpk_interval is None


def test_five_lots_with_a_failed_run_have_an_interval() -> None:
    x, lots = in_lots(np.random.default_rng(2), LEAST_LOTS, 50, 0.5)
    x[3] = np.nan
    assert capability(x, -4, 4, batches=lots).cpk_interval is not None


def test_lots_of_one_value_are_independent_values() -> None:
    x = np.random.default_rng(3).normal(size=60)
    assert capability(x, -4, 4, batches=np.arange(60)).cpk_interval == capability(x, -4, 4).cpk_interval
    assert capability(x, -4, 4, batches=np.arange(60)).lots is None


def test_batches_that_share_a_shift_are_one_lot() -> None:
    """Batches of 10 within lots of 100: the intervals rest on the lots, the sigma within on the batches."""
    x, lots = in_lots(np.random.default_rng(4), 20, 100, 1.0)
    batches = np.arange(x.size) // 10
    c, by_lot = (capability(x, -5, 5, batches=batches, lots=lots), capability(x, -5, 5, batches=lots))
    assert c.within.batches == 200
    assert c.cpk_interval == by_lot.cpk_interval


@pytest.mark.parametrize(("share", "limit"), [(0.1, 0.92), (0.01, 0.93)])
def test_the_counted_share_holds_with_lots(share: float, limit: float) -> None:
    """Without lots the interval of a share of 10 % in 20 lots of 50 holds in 44 %, that of 1 % in 64 % of campaigns."""
    rng, usl, inside, runs = np.random.default_rng(7), stats.norm.isf(share) * math.sqrt(2), 0, 300
    for _ in range(runs):
        x, lots = in_lots(rng, 20, 50, 1.0)
        low, high = nonconforming(x, None, usl, 0.95, lots=lots).total.interval
        inside += low <= 1e6 * share <= high
    assert inside / runs >= limit


def test_without_a_reject_lots_prove_less() -> None:
    x, lots = in_lots(np.random.default_rng(8), 20, 50, 1.0)
    with_lots, without = (nonconforming(x, None, 9.0, 0.95, lots=given).total for given in (lots, None))
    assert with_lots.count == 0
    assert with_lots.upper >= without.upper
    one_lot = nonconforming(x, None, 9.0, 0.95, lots=np.zeros(x.size)).total
    assert (one_lot.worth, one_lot.upper) == (pytest.approx(1.0), pytest.approx(950_000))


def test_error_of_a_weighted_mean_is_that_of_whole_lots() -> None:
    """400 campaigns: the reported error of a weighted mean is the spread of the means; independent: a fifth of it."""
    rng = np.random.default_rng(9)
    found, errors, independent = [], [], []
    for _ in range(400):
        x, lots = in_lots(rng, 30, 40, 1.0)
        weight = rng.uniform(0.5, 1.5, x.size)
        weight /= weight.sum()
        mean = float(weight @ x)
        error, freedom = lot_error(x - mean, weight, lots)
        found.append(mean)
        errors.append(error)
        independent.append(lot_error(x - mean, weight, None)[0])
        assert 28 < freedom <= 29
    assert np.mean(errors) == pytest.approx(np.std(found), rel=0.12)
    assert np.mean(independent) < 0.35 * np.std(found)


def test_the_band_of_the_running_index_begins_with_enough_lots() -> None:
    x, lots = in_lots(np.random.default_rng(10), 20, 50, 1.0)
    found = convergence(x, -5, 5, 0.95, lots)
    assert found.n[0] > 50 * (LEAST_LOTS - 1)
    c = capability(x, -5, 5, batches=lots)
    assert (found.low[-1], found.high[-1]) == pytest.approx(c.cpk_interval)
    assert convergence(x[:150], -5, 5, 0.95, lots[:150]) is None


def test_lots_that_differ_are_no_drift() -> None:
    """With independent errors, halves of 20 lots differ by more than 4 of them in every second campaign."""
    drifts = [
        drift(x, -5, 5, lots) for x, lots in (in_lots(np.random.default_rng(seed), 20, 50, 1.0) for seed in range(60))
    ]
    assert np.mean(np.abs(drifts) > 4) == 0
    x, lots = in_lots(np.random.default_rng(11), 40, 50, 0.2)
    x[1000:] += 2.0
    assert abs(drift(x, -5, 9, lots)) > 4


def test_few_lots_say_what_they_do_not_show() -> None:
    """20 equal lots are worth 20, and may lack a kind of lot that is rarer than 14 %; 59 show all from 5 % on."""
    for count, unseen in ((20, "fewer than 14 %"), (50, "fewer than 6 %"), (59, "")):
        x, lots = in_lots(np.random.default_rng(1), count, 250, 1.0)
        found = capability(x, -9.0, 9.0, lots=lots, batches=lots, ordered=False)
        assert found.lots.worth == count
        assert unseen in found.lots.blind
        assert bool(unseen) == ("too narrow" in found.interval_reason)
