"""Values in the order in which they were made: drift, runs and resembling neighbours raise an alarm, chance seldom."""

import itertools

import numpy as np
import pytest

from reporting import capability
from reporting.capability.row_order import FALSE_ALARMS, FEWEST, neighbours_in_random_order, row_order
from reporting.capability.verdict import verdict
from studies.row_order import ALTERNATING, CORRELATED, STABLE, drift, neighbours, step
from tests.each import each


def normals(n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=n)


@pytest.mark.slow
@each("process", STABLE)
@each("n", [FEWEST, 50, 300])
def test_a_stable_process_raises_an_alarm_in_one_of_a_hundred(process, n) -> None:
    """2,000 samples; three standard errors of a share of 1 % are 0.7 %."""
    rng = np.random.default_rng(n)
    found = [row_order(process.draw(rng, n)) for _ in range(2000)]
    assert sum(bool(order.finding) for order in found if order) / 2000 <= FALSE_ALARMS + 0.007


@pytest.mark.parametrize(
    ("draw", "n", "words"),
    [
        (drift(2.0), 125, "they rise from row to row (rank correlation +0."),
        (drift(-2.0), 125, "they fall from row to row (rank correlation -0."),
        (step(1.5), 200, "they rise from row to row"),
        (CORRELATED[0.6].draw, 200, "neighbours resemble each other (rank correlation +0."),
        (lambda rng, n: normals(n) + 0.6 * np.sin(8 * np.pi * np.arange(n) / n), 400, "consecutive groups differ ("),
    ],
)
def test_a_process_that_is_not_stable_is_told(draw, n, words) -> None:
    found = row_order(draw(np.random.default_rng(3), n))
    assert found.p < FALSE_ALARMS
    assert words in found.finding
    assert "The process was not stable" in found.finding


@each("process", ALTERNATING)
def test_sources_in_turn_and_readjustment_are_told(process) -> None:
    """Neighbours that differ too much: no drift, but not one stable process of independent parts either."""
    found = row_order(process.draw(np.random.default_rng(3), 125))
    assert found.p < FALSE_ALARMS
    assert found.neighbours < -0.3
    assert "The process was not stable" not in found.finding
    assert "spindles" in found.finding


def test_what_few_values_do_not_show_is_said_of_them_whatever_they_look_like() -> None:
    """A correlation that 50 values show in 19 of 20 samples; of 700 the mean's interval suffers by a fifth at most."""
    draws = [row_order(CORRELATED[0.6].draw(np.random.default_rng(seed), 50)) for seed in range(40)]
    assert {order.unseen for order in draws if order} == {
        "50 values show a correlation of neighbours surely only above 0.65; below, the interval of the mean may be up"
        " to 2.2 times too narrow."  # the root of 1.65 / 0.35
    }
    rng = np.random.default_rng(3)
    chosen = [row_order(neighbours(0.7)(rng, 50)) for _ in range(100)]
    assert sum(bool(order and order.finding) for order in chosen) >= 89
    assert "too narrow" in row_order(normals(600)).unseen
    assert row_order(normals(700)).unseen == ""


def test_mean_and_variance_over_all_orders_are_exact() -> None:
    """Of the sum of products of neighbours: over the 5,040 orders of seven ranks with ties."""
    ranks = np.array([1.5, 1.5, 3.0, 5.0, 5.0, 5.0, 7.0]) - 4.0
    totals = [order[:-1] @ order[1:] for order in map(np.array, itertools.permutations(ranks))]
    assert neighbours_in_random_order(ranks) == pytest.approx((np.mean(totals), np.var(totals)))


def test_only_ranks_count() -> None:
    """So no distribution is assumed, and one wild value raises no alarm."""
    x = normals(100)
    plain, bent = row_order(x), row_order(np.exp(3 * x))
    assert (plain.p, plain.neighbours, plain.trend) == (bent.p, bent.neighbours, bent.trend)
    assert row_order(np.append(x, 1e9)).finding == ""


@pytest.mark.parametrize("x", [normals(FEWEST - 1), np.repeat(3.0, 50), (normals(50) > 1.5) * 1.0])
def test_too_few_values_say_nothing(x) -> None:
    assert row_order(x) is None


def test_lots_are_tested_by_their_means() -> None:
    """Values of a lot resemble each other, which the intervals allow for; lots that drift are told."""
    rng = np.random.default_rng(5)
    lots = np.repeat(np.arange(40), 10)
    x = rng.normal(size=400) + np.repeat(rng.normal(size=40), 10)
    assert row_order(x).finding
    assert row_order(x, lots).finding == ""
    assert row_order(x, lots).n == 40
    moved = row_order(x + 0.1 * lots, lots)
    assert moved.finding.startswith("The lots are not in random order")
    assert "give the lot" not in moved.finding


def test_capability_notes_it_and_no_verdict_on_it_is_certain() -> None:
    """The same values in random order are certainly capable."""
    rng = np.random.default_rng(6)
    x = np.sort(rng.normal(size=400))
    drifting, shuffled = capability(x, -8.0, 8.0), capability(rng.permutation(x), -8.0, 8.0)
    assert any("not in random order" in note for note in drifting.notes)
    assert not any("not in random order" in note for note in shuffled.notes)
    assert drifting.order.finding in verdict(drifting, None).reasons
    assert (verdict(drifting, None).certain, verdict(shuffled, None).certain) == (False, True)
    assert drifting.cpk_interval == pytest.approx(shuffled.cpk_interval)
    assert capability(x, -8.0, 8.0, ordered=False).order is None
