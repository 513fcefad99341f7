"""Cost laws: the optimum against Lagrange's closed form and against another solver, and tables of processes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from reporting.tolerance.cost_laws import ExponentialLaw, PowerLaw, Process, ProcessTable
from reporting.tolerance.cost_optimum import cheapest, costs
from tests.each import each


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
def test_the_optimum_of_a_power_law_is_lagranges(power):
    """The slope of the cost, k b / t^(k+1), is 2 price c t, so t_i ~ (b_i / c_i)^(1/(k+2))."""
    b, c, room = np.array([1.0, 3.0, 0.5, 2.0]), np.array([1.0, 0.25, 4.0, 2.25]), 0.02
    shape = (b / c) ** (1 / (power + 2))
    expected = shape * math.sqrt(room / np.sum(c * shape**2))
    laws = [PowerLaw(0.3, float(each), power) for each in b]
    found = cheapest(laws, c[None], np.array([room]), np.full(4, 1e-6), np.full(4, 1e3))
    assert found.tolerance == pytest.approx(expected, rel=1e-6)
    assert costs(laws, found.tolerance).sum() == pytest.approx(1.2 + np.sum(b / expected**power), rel=1e-10)
    assert found.price[0] == pytest.approx(power * b[0] / (2 * c[0] * expected[0] ** (power + 2)), rel=1e-5)


def test_the_optimum_of_equal_exponential_laws_is_equal():
    """By symmetry: four equal variables share the room."""
    found = cheapest(
        [ExponentialLaw(1.0, 5.0, 0.1)] * 4, np.ones((1, 4)), np.array([0.04]), np.full(4, 1e-3), np.ones(4)
    )
    assert found.tolerance == pytest.approx(np.full(4, 0.1), rel=1e-6)
    assert found.price[0] == pytest.approx(5.0 / 0.1 * math.exp(-1) / 0.2, rel=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_mixed_laws_are_as_cheap_as_another_solver_finds(seed):
    """Random laws, bounds, responses: SLSQP in the tolerances themselves, from three starts, is not cheaper."""
    rng = np.random.default_rng(seed)
    k, r = rng.integers(2, 6), rng.integers(1, 4)
    laws = [
        PowerLaw(0.0, rng.uniform(0.5, 2), rng.choice([0.5, 1, 2, 3]))
        if rng.random() < 0.6
        else ExponentialLaw(0.0, rng.uniform(1, 9), rng.uniform(0.1, 1))
        for _ in range(k)
    ]
    rate, lower = rng.uniform(0, 1, (r, k)) * (rng.random((r, k)) < 0.8), rng.uniform(0.1, 0.3, k)
    upper = lower * rng.uniform(1.5, 8, k)
    room = rate @ (lower + rng.uniform(0.2, 0.9) * (upper - lower)) ** 2 + 1e-6
    found = cheapest(laws, rate, room, lower, upper)
    assert np.all(rate @ found.tolerance**2 <= room * (1 + 1e-9))
    for share in (0.0, 0.1, 0.2):
        other = optimize.minimize(
            lambda t: costs(laws, t).sum(),
            lower + share * (upper - lower),
            method="SLSQP",
            bounds=list(zip(lower, upper, strict=True)),
            constraints={"type": "ineq", "fun": lambda t: room - rate @ t**2},
            options={"ftol": 1e-12, "maxiter": 300},
        )
        if np.all(rate @ other.x**2 <= room + 1e-9):
            assert costs(laws, found.tolerance).sum() <= other.fun * (1 + 1e-6)


def test_a_table_keeps_what_nothing_beats():
    """A process that is dearer and wider than another is never chosen."""
    table = ProcessTable((Process(3.0, 1.0), Process(1.0, 5.0, "grind"), Process(2.0, 6.0), Process(2.0, 2.0, "ream")))
    assert [p.tolerance for p in table.between(0.5, 5.0)] == [1.0, 2.0, 3.0]
    assert [p.name for p in table.between(0.5, 2.5)] == ["grind", "ream"]
    assert table.at(2.5).name == "ream"
    assert table.at(0.5) is None


@each(
    "law",
    [
        PowerLaw(0.0, 0.0),
        PowerLaw(math.inf, 1.0),
        PowerLaw(0.0, 1.0, -1.0),
        ExponentialLaw(0.0, -1.0, 1.0),
        ExponentialLaw(0.0, 1.0, math.nan),
        ProcessTable(()),
        ProcessTable((Process(0.0, 1.0),)),
        ProcessTable((Process(1.0, math.inf),)),
    ],
)
def test_impossible_laws_say_so(law):
    """And possible ones say nothing."""
    assert law.fault()
    assert not PowerLaw(0.0, 1.0, 2.0).fault()
