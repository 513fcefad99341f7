"""A verdict is a promise: index, count and every other estimate must agree before it is certain."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from reporting import capability
from reporting.capability.intervals import Estimate
from reporting.capability.lots import describe_lots
from reporting.capability.shares import nonconforming
from reporting.capability.verdict import FEWEST_FOR_A_VERDICT, USUAL, SecondPopulation, bars_of, index_of_share, verdict


def spread(n: int, cpk: float, rejects: int = 0) -> np.ndarray:
    """Return n values with an upper Cpk for a limit at 3 of about `cpk`, this many of them beyond it."""
    kept = ndtri((np.arange(n - rejects) + 0.5) / (n - rejects)) / cpk
    return np.concatenate((np.clip(kept, -2.99, 2.99), np.full(rejects, 3.01)))


def judged(x, lsl=None, usl=None, others=(), **how):
    """Return the verdict on values."""
    c = capability(x, lsl, usl, ordered=False)
    return verdict(c, nonconforming(np.asarray(x), lsl, usl, 0.95), others, **how)


def objector(by: str, low: float, value: float, high: float) -> Estimate:
    return Estimate(value, (low, high), by, f"Ppk {value} by {by}")


@pytest.mark.parametrize(
    ("cpk", "word"),
    [(1.33, "capable"), (1.3299, "marginal"), (1.0, "marginal"), (0.9999, "not capable"), (-1, "not capable")],
)
def test_the_word_follows_from_cpk(cpk, word) -> None:
    c = capability(spread(40, 1.0), -3.0, 2.0)
    assert USUAL.class_of(cpk) == word
    assert verdict(replace(c, cpk=cpk, cpk_interval=(cpk, cpk)), None).word == word
    assert verdict(replace(c, cpk=None), None).word == "no verdict"
    assert verdict(replace(c, lsl=None, usl=None, cpk=None), None).word == "no limits"


@pytest.mark.parametrize(("rejects", "word"), [(27, "marginal"), (25, "marginal"), (110, "not capable")])
def test_a_count_that_excludes_the_index_overrules_it(rejects: int, word: str) -> None:
    """27 of 30,000 values out of limits, at least 593 ppm, with a Cpk of 1.4 that expects 13."""
    x = spread(30_000, 1.4, rejects)
    assert capability(x, usl=3.0).cpk > 1.33
    found = judged(x, usl=3.0)
    assert (found.word, found.by) == (word, "count")
    assert f"{rejects} of 30" in found.reasons[0]
    assert "Cpk 1.3" in found.reasons[0]


def test_a_count_that_excludes_the_index_raises_the_verdict_too() -> None:
    """Two rejects of 30,000 where Cpk 0.8 expects thousands: 8 to 241 ppm are marginal or capable."""
    x = np.random.default_rng(0).uniform(-1, 1, 30_000)
    x[:2] = 1.5
    found = judged(x, usl=1.4)
    assert capability(x, usl=1.4).cpk < 1
    assert (found.word, found.certain, found.by) == ("marginal", False, "count")
    assert found.index == pytest.approx(index_of_share(2e6 / 30_000))
    assert (found.index_low < 1.33 < found.index_high, "although Cpk 0.8" in found.reasons[0]) == (True, True)


@pytest.mark.parametrize("n", [2, 3, 10, FEWEST_FOR_A_VERDICT - 1])
def test_too_few_values_have_no_verdict(n: int) -> None:
    found = judged(spread(n, 1.0), -9.0, 9.0)
    assert (found.word, found.certain) == ("no verdict", None)
    assert f"{n} values are too few" in found.reasons[0]


def test_the_fewest_values_seldom_call_a_poor_response_capable() -> None:
    """Of 20,000 samples of a normal response with one limit and Cpk 1.00, at most one of twenty is called capable."""
    x = np.random.default_rng(1).normal(size=(20_000, FEWEST_FOR_A_VERDICT))
    cpk = (3.0 - x.mean(axis=1)) / (3 * x.std(axis=1, ddof=1))
    assert np.mean(cpk >= 1.33) <= 0.05
    fewer = x[:, :20]
    assert np.mean((3.0 - fewer.mean(axis=1)) / (3 * fewer.std(axis=1, ddof=1)) >= 1.33) > 0.05


def test_enough_agreeing_estimates_are_certain() -> None:
    x = spread(5_000, 1.0)
    found = judged(x, -5.0, 5.0, [objector("tail", 1.4, 1.6, math.inf)])
    assert (found.word, found.certain, found.by, found.reasons) == ("capable", True, "index", ())


def test_any_estimate_in_a_worse_class_takes_the_certainty() -> None:
    x = spread(5_000, 1.0)
    found = judged(x, -5.0, 5.0, [objector("fitted distribution", 0.9, 1.2, 1.5)])
    assert (found.word, found.certain, found.by) == ("capable", False, "index")
    assert found.reasons == ("Ppk 1.2 by fitted distribution: marginal.",)


def test_an_estimate_wholly_in_a_worse_class_overrules() -> None:
    x = spread(1_000, 1.0)
    found = judged(x, -5.0, 5.0, [objector("fitted distribution", 0.9, 0.95, 0.99), objector("tail", 0.9, 1.1, 1.2)])
    assert (found.word, found.by) == ("not capable", "fitted distribution")
    assert found.reasons[0].startswith("Ppk 0.95 by fitted distribution: not capable, although Cpk")
    assert not found.certain  # without a reject the values may end before the limit


def test_an_estimate_that_the_count_refutes_has_no_say() -> None:
    """None of 5,000 values is out of limits, at most 738 ppm: a fit that expects 8,000 is wrong."""
    others = [objector("fitted distribution", 0.7, 0.8, 0.9), objector("tail", 1.4, 1.6, math.inf)]
    found = judged(spread(5_000, 1.0), -5.0, 5.0, others)
    assert (found.word, found.certain) == ("capable", True)


def test_samples_that_are_no_production_have_no_verdict() -> None:
    found = judged(spread(500, 1.0), -5.0, 5.0, production=False)
    assert (found.word, found.certain) == ("no verdict", None)


@pytest.mark.parametrize(
    ("lsl", "usl", "found"),
    [
        (0.0, 5.0, ("constant", None, "")),
        (0.0, 3.0, ("constant", None, "")),
        (4.0, 5.0, ("not capable", True, "count")),
    ],
)
def test_a_constant_response_keeps_its_limits_or_not(lsl: float, usl: float, found: tuple) -> None:
    """It has no index, and is not asked for more values."""
    x = np.full(500, 3.0)
    of = judged(x, lsl, usl)
    assert (of.word, of.certain, of.by) == found
    assert "Every value is 3" in of.reasons[0]
    assert capability(x, lsl, usl).cpk is None


@pytest.mark.parametrize(
    ("failed", "finished", "word", "certain"),
    [
        (0, 5_000, "capable", True),
        (1, 5_000, "capable", True),  # one reject among 5,000 speaks neither for nor against 33 ppm
        (1, 700, "capable", False),  # among 700 it does
        (9, 5_000, "capable", False),
        (9, 30_000, "capable", False),
    ],
)
def test_failures_take_certainty_where_as_many_rejects_would_prove_a_worse_class(
    failed: int, finished: int, word: str, certain: bool
) -> None:
    """A failed sample has no value: it may be a reject, and is none for sure."""
    x = spread(finished - failed, 1.0)
    share = objector("tail", 1.4, 1.6, math.inf)
    found = verdict(capability(x, -5.0, 5.0, ordered=False), nonconforming(x, -5.0, 5.0, 0.95, failed), [share])
    assert (found.word, found.certain, found.by) == (word, certain, "index")
    assert any(f"{failed} of " in reason and "If they were rejects" in reason for reason in found.reasons) != certain


def test_failures_cannot_make_the_worst_class_worse() -> None:
    x = spread(1_000, 1.0)
    found = verdict(capability(x, -1.5, 1.5, ordered=False), nonconforming(x, -1.5, 1.5, 0.95, 100))
    assert (found.word, found.certain, found.reasons) == ("not capable", True, ())


def test_failures_count_on_one_side_only() -> None:
    """30 rejects on each side are 1,000 ppm of each; one failure more does not make 2,000 ppm of one side."""
    x = np.concatenate((spread(30_000, 1.1, 30), -spread(30_000, 1.1, 30)))
    counted = nonconforming(x, -3.0, 3.0, 0.95, 1)
    assert (counted.worse_with_failures.count, counted.worse_with_failures.n) == (31, 60_001)


def test_a_verdict_can_be_withheld_from_a_whole_campaign() -> None:
    found = judged(spread(5_000, 1.0), -5.0, 5.0, withheld="Half of the samples failed.")
    assert (found.word, found.certain, found.reasons) == ("no verdict", None, ("Half of the samples failed.",))
    assert judged(spread(5_000, 1.0), withheld="Half of the samples failed.").word == "no limits"


def test_a_share_in_the_scale_of_cpk() -> None:
    assert index_of_share(1349.898) == pytest.approx(1.0, abs=1e-7)
    assert index_of_share(0.0) == math.inf
    assert index_of_share(1e6) == -math.inf


def test_a_count_overrules_a_cpk_whose_interval_is_withheld() -> None:
    """Too few production lots for an interval of Cpk: the rejects are counted all the same."""
    x = spread(30_000, 1.4, 27)
    c = replace(capability(x, usl=3.0), cpk_interval=None, interval_reason="Two lots.", lots=describe_lots(x, x < 0))
    found = verdict(c, nonconforming(x, None, 3.0, 0.95))
    assert (found.word, found.certain, found.by) == ("marginal", False, "count")
    assert found.reasons[1] == "Two lots."


def test_a_certain_verdict_needs_an_estimate_without_the_normal_distribution() -> None:
    """Cpk 1.8 of 500 values is certain by its interval; of a t5 response the rejects may be those of Cpk 1.17."""
    x = spread(500, 1.8)
    alone = judged(x, usl=3.0)
    assert (alone.word, alone.certain) == ("capable", False)
    assert "0 of 500 values out of limits" in alone.reasons[-1]
    assert alone.reasons[-1].endswith("does not rule out not capable.")
    wide = objector("fitted distribution", 1.1, 1.6, 2.0)
    assert "Ppk 1.6 by fitted distribution does not rule out marginal" in judged(x, usl=3.0, others=[wide]).reasons[-1]
    narrow = objector("fitted distribution", 1.4, 1.6, 2.0)
    assert judged(x, usl=3.0, others=[wide, narrow]).certain


def test_what_is_not_capable_needs_none() -> None:
    assert judged(spread(500, 0.7, 8), usl=3.0).certain


def test_a_count_alone_proves_a_response_capable() -> None:
    """No reject among 150,000."""
    assert judged(spread(150_000, 1.8), usl=3.0).certain


def test_values_that_are_not_normal_follow_an_estimate_without_the_normal_distribution() -> None:
    """Cpk 1.6 says capable, the fitted distribution marginal: it decides where the values are not normal."""
    x, fitted = spread(5_000, 1.0), objector("fitted distribution", 1.1, 1.2, 1.5)
    assert judged(x, -5.0, 5.0, [fitted]).word == "capable"
    found = judged(x, -5.0, 5.0, [fitted], normal=False)
    assert (found.word, found.certain, found.by, found.index) == ("marginal", False, "fitted distribution", 1.2)
    assert found.reasons[0].startswith("Ppk 1.2 by fitted distribution: marginal, although Cpk 1.6")
    better = judged(x, -1.2, 1.2, [objector("fitted distribution", 1.4, 1.5, 1.6)], normal=False)
    assert better.word == "not capable"


def test_an_estimate_wholly_in_a_better_class_raises_the_verdict() -> None:
    """A skewed response: Cpk by sigma says not capable, every distribution that the values allow says capable."""
    x = spread(5_000, 1.0)
    found = judged(x, -2.995, 2.995, [objector("fitted distribution", 1.4, 1.6, 1.8)])
    assert (found.word, found.certain, found.index) == ("capable", True, 1.6)


def test_a_point_estimate_that_its_own_interval_does_not_confirm_changes_no_word() -> None:
    found = judged(spread(5_000, 1.0), -5.0, 5.0, [objector("fitted distribution", 1.05, 1.2, 1.5)])
    assert (found.word, found.certain, found.index) == ("capable", False, pytest.approx(1.67, abs=0.01))


def test_weighted_runs_decide_against_every_model_but_not_against_the_count() -> None:
    x, models = spread(5_000, 1.0), [objector("fitted distribution", 0.9, 0.95, 0.99)]
    weighted = objector("rare rejects", 1.36, 1.5, 1.62)
    found = judged(x, -5.0, 5.0, [*models, weighted], unseen=SecondPopulation(900.0, "few values", ""))
    assert (found.word, found.certain, found.by, found.index) == ("capable", True, "rare rejects", 1.5)
    assert judged(spread(30_000, 1.4, 110), usl=3.0, others=[weighted]).by == "count"


def test_a_second_population_that_the_values_permit_takes_the_certainty() -> None:
    x, tail = spread(5_000, 1.0), objector("tail", 1.4, 1.6, math.inf)
    few, large = (SecondPopulation(ppm, "few values", "Certain provided that.") for ppm in (5.0, 500.0))
    sure = judged(x, -5.0, 5.0, [tail], unseen=few)
    assert (sure.certain, sure.assumes) == (True, "Certain provided that.")
    unsure = judged(x, -5.0, 5.0, [tail], unseen=large)
    assert (unsure.word, unsure.certain, unsure.assumes) == ("capable", False, "")
    assert unsure.reasons == ("few values: marginal.",)


def test_normal_values_that_may_end_before_a_limit_are_not_certainly_poor() -> None:
    """Cpk 0.87 of 99 values without a reject: a distribution that ends before the limit has none either."""
    found = judged(spread(100, 1.0)[:-1], usl=2.6, others=[objector("fitted distribution", 0.7, 0.8, 0.9)])
    assert (found.word, found.certain) == ("not capable", False)


@pytest.mark.parametrize(("requirement", "marginal"), [(1.33, 1.0), (1.67, 1.33), (2.0, 1.67), (1.5, 1.17)])
def test_the_class_follows_from_what_is_required(requirement: float, marginal: float) -> None:
    bars = bars_of(requirement)
    assert [bars.class_of(x) for x in (requirement, marginal, marginal - 1e-9)] == [
        "capable",
        "marginal",
        "not capable",
    ]
    x, tail = spread(5_000, 1.0), [objector("tail", 1.4, 1.6, math.inf)]
    assert judged(x, -4.0, 4.0, tail, bars=bars).word == bars.class_of(4 / 3)


def test_a_prescribed_index_alone_decides() -> None:
    x, others = spread(5_000, 1.0), [objector("fitted distribution", 0.9, 0.95, 0.99)]
    others.append(objector("fitted percentiles", 1.1, 1.2, 1.3))
    assert judged(x, -5.0, 5.0, others, bars=bars_of(1.33, "cpk")).word == "capable"
    found = judged(x, -5.0, 5.0, others, bars=bars_of(1.33, "percentile"))
    assert (found.word, found.certain, found.index) == ("marginal", True, 1.2)


def test_a_tail_alone_is_not_certain_to_be_poor() -> None:
    """Beyond a small second population a Pareto tail goes on; the values end there, and none is out of limits."""
    x = spread(3_000, 1.0)
    found = judged(x, -5.0, 5.0, [objector("tail", 1.05, 1.15, 1.25)])
    assert (found.word, found.certain, found.by) == ("marginal", False, "tail")
    assert "does not rule out capable" in found.reasons[-1]
