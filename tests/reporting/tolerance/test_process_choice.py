"""Choice of processes against trying all of them."""

from itertools import product

import numpy as np
import pytest

from reporting import ReportError
from reporting.tolerance import cost_optimum
from reporting.tolerance.allocation import CostedVariable, Requirement, allocate
from reporting.tolerance.cost_laws import ExponentialLaw, PowerLaw, Process, ProcessTable
from reporting.tolerance.cost_optimum import Programme, cheapest, cheapest_choice, costs
from tests.each import each


def random_programme(rng, variables, choices, responses, continuous=0):
    """Return a programme whose cheapest set is neither the widest nor the finest."""
    table_rate = rng.uniform(0.2, 1, (responses, variables))
    tables = tuple(
        ProcessTable(
            tuple(Process(t, c) for t, c in zip(np.sort(rng.uniform(0.1, 1, choices)),
                                                -np.sort(-rng.uniform(1, 9, choices)), strict=True))
        ).between(0.0, 9.0)
        for _ in range(variables)
    )  # fmt: skip
    laws = tuple(
        (PowerLaw(0.0, rng.uniform(0.1, 1), 2.0), ExponentialLaw(0.0, rng.uniform(1, 9), 0.3))[i % 2]
        for i in range(continuous)
    )
    lower, upper, rate = (
        np.full(continuous, 0.1),
        np.full(continuous, 1.5),
        rng.uniform(0.2, 1, (responses, continuous)),
    )
    finest = table_rate @ np.array([t[0].tolerance ** 2 for t in tables]) + rate @ lower**2
    widest = table_rate @ np.array([t[-1].tolerance ** 2 for t in tables]) + rate @ upper**2
    room = finest + rng.uniform(0.1, 0.6) * (widest - finest)
    return Programme(laws, lower, upper, rate, tables, table_rate, room)


def cheapest_of_all(p):
    """Return the cost of the cheapest set, by trying every combination of processes."""
    best = np.inf
    for chosen in product(*p.tables):
        room = p.room - p.table_rate @ np.array([c.tolerance**2 for c in chosen])
        if np.any(room < 0):
            continue
        cost = sum(c.cost for c in chosen)
        if p.laws:
            optimum = cheapest(p.laws, p.rate, room, p.lower, p.upper)
            if optimum is None:
                continue
            cost += costs(p.laws, optimum.tolerance).sum()
        best = min(best, cost)
    return best


def cost_of(p, found):
    """Return the cost of a choice, after checking that it fits."""
    optimum, chosen = found
    used = p.table_rate @ np.array([c.tolerance**2 for c in chosen]) + p.rate @ optimum.tolerance**2
    assert np.all(used <= p.room * (1 + 1e-7))
    return sum(c.cost for c in chosen) + costs(p.laws, optimum.tolerance).sum()


@each("seed", range(30))
def test_processes_are_the_cheapest_of_all(seed):
    """Up to six variables with up to five processes, one to three responses."""
    rng = np.random.default_rng(seed)
    p = random_programme(rng, rng.integers(1, 7), rng.integers(2, 6), rng.integers(1, 4))
    found = cheapest_choice(p)
    assert found[0].gap == 0.0
    assert cost_of(p, found) == pytest.approx(cheapest_of_all(p), rel=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_processes_beside_continuous_tolerances_are_the_cheapest_of_all(seed):
    """Two variables of a table and two with a law each."""
    rng = np.random.default_rng(100 + seed)
    p = random_programme(rng, 2, 3, rng.integers(1, 3), continuous=2)
    found = cheapest_choice(p)
    assert found[0].gap == 0.0
    assert cost_of(p, found) == pytest.approx(cheapest_of_all(p), rel=1e-8)


def test_realistic_sizes_are_proved():
    """Twelve variables with six processes each, 2e9 combinations."""
    p = random_programme(np.random.default_rng(7), 12, 6, 3)
    assert cheapest_choice(p)[0].gap == 0.0
    # All variables alike: the choice is ambiguous, its cost is not.
    like = Programme(p.laws, p.lower, p.upper, p.rate, (p.tables[0],) * 8, np.ones((1, 8)), p.room[:1])
    few = Programme(p.laws, p.lower, p.upper, p.rate, like.tables[:4], np.ones((1, 4)), p.room[:1] / 2)
    assert cheapest_choice(like)[0].gap == 0.0
    assert cost_of(few, cheapest_choice(few)) == pytest.approx(cheapest_of_all(few))


def test_a_search_that_is_cut_says_how_much_it_may_miss(monkeypatch):
    """The gap holds: the cheapest of all is not below the found cost less the gap."""
    monkeypatch.setattr(cost_optimum, "_MOST_BRANCHES", 3)
    cut = 0
    for seed in range(12):
        p = random_programme(np.random.default_rng(seed), 5, 4, 2)
        found = cheapest_choice(p)
        cost, right = cost_of(p, found), cheapest_of_all(p)
        assert cost - found[0].gap <= right * (1 + 1e-9) <= cost * (1 + 1e-8)
        cut += found[0].gap > 0
    assert cut > 0


def joint(name, processes, **changes):
    """Return a joint with a table, at present 0.02."""
    table = ProcessTable(tuple(Process(*each) for each in processes))
    return CostedVariable(**{"variable": name, "tolerance": 0.02, "law": table, "lower": 1e-3, "upper": 1.0} | changes)


CHOICES = ((0.03, 1.0, "drilled"), (0.02, 2.0, "reamed"), (0.01, 5.0, "honed"))


def requirement(shares, target=1.33):
    """Return a response of sigma 0.03 between limits 0.15 from its mean."""
    return Requirement("gap", 10.0, 0.03, 9.85, 10.15, target, shares)


def test_an_allocation_names_the_processes():
    """J1 matters and is made finer for a higher target, J2 does not and is drilled; a step has no price."""
    costed = [joint("J1", CHOICES), joint("J2", CHOICES)]
    found = allocate(costed, [requirement({"J1": 0.8, "J2": 0.1}, 1.5)])
    assert found.processes == {"J1": "reamed", "J2": "drilled"}
    found = allocate(costed, [requirement({"J1": 0.8, "J2": 0.1}, 2.2)])
    assert found.processes == {"J1": "honed", "J2": "drilled"}
    assert (found.cost, found.cost_now) == (6.0, 4.0)
    assert found.responses[0].cpk >= 2.2
    assert found.responses[0].price is None
    assert "at its lower bound" in allocate(costed, [requirement({"J1": 0.8, "J2": 0.1}, 5.0)]).refusal


def test_a_locked_table_stays_and_an_unknown_present_has_no_cost():
    """What is locked costs what it costs now; a present tolerance finer than every process has no known cost."""
    costed = [joint("J1", CHOICES, locked=True), joint("J2", CHOICES, tolerance=0.005)]
    found = allocate(costed, [requirement({"J1": 0.5, "J2": 0.01})])
    assert found.tolerances == {"J1": 0.02, "J2": 0.03}
    assert (found.cost, found.cost_now) == (3.0, None)


@pytest.mark.parametrize(
    ("costed", "shares", "why"),
    [
        ([joint("J1", CHOICES, locked=True, tolerance=0.005)], {"J1": 0.5}, "J1: locked at 0.005, but no process"),
        ([joint("J1", CHOICES, lower=0.1)], {"J1": 0.5}, "J1: no process lies within the bounds 0.1 to 1"),
        ([joint("J1", ())], {"J1": 0.5}, "J1: a table of processes needs at least one"),
        ([joint("J1", CHOICES)], {"J1": -0.1}, "gap: the share of J1 is -0.1"),
        ([joint("J1", CHOICES)], {"J1": float("nan")}, "gap: the share of J1 is nan"),
        ([joint("J1", CHOICES)], {"J1": 0.7, "J2": 0.5}, "gap: the shares of the variance add up to 1.2"),
    ],
)
def test_impossible_tables_and_shares_raise(costed, shares, why):
    """They name the variable or the response, the number and the remedy."""
    with pytest.raises(ReportError, match=why):
        allocate(costed, [requirement(shares)])
