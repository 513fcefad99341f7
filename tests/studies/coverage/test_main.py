"""The command of the coverage study: it repeats every estimate, and one that is wrong shows."""

import pickle
import re

import numpy as np
import pytest

from studies.coverage import __main__ as coverage
from studies.coverage.__main__ import Case, all_tallies, cases, lines
from studies.coverage.outcomes import GROUPS, Statement, faults
from studies.coverage.productions import LOTS, LOTS_IN_TURN, SHAPES
from studies.coverage.rare import AIMED, DESIGNED

pytestmark = pytest.mark.slow


def test_a_few_replications():
    """One table for a case, the counts behind it, and the words that say what was computed."""
    text = list(lines([Case(coverage.indices, SHAPES[0], 50, 20)], detailed=True))
    assert text[0] == "| intervals of | normal | lognormal | gamma | t5 | uniform | bimodal |"
    (row,) = (line for line in text if line.startswith("| Cpk | normal | 50 | "))
    assert sum(int(cell) for cell in row.split(" | ")[3:8]) == 20
    assert re.search(r"20 campaigns of 50, 500, 5,000 samples", text[-1])


def test_replications_do_not_depend_on_their_number():
    """A part of the study repeats the first campaigns of the whole one."""
    few, more = ([*_draws(Case(_recorded, SHAPES[0], 5, r))] for r in (2, 3))
    assert more[:2] == few
    assert len({tuple(draw) for draw in more}) == 3


def test_a_narrow_interval_shows():
    """Half the width of an exact interval is found out on a tenth of the replications."""
    assert set(faults(all_tallies([Case(_halved, SHAPES[0], 50, 100)])).values()) == {"too narrow"}


def test_every_case_has_a_part_of_its_replications():
    """A tenth of the study has all productions and sizes."""
    whole, tenth = cases(), cases(0.1)
    assert {(c.estimate, c.production, c.n) for c in whole} == {(c.estimate, c.production, c.n) for c in tenth}
    assert all(case.replications >= 1 for case in tenth)


def test_every_case_goes_to_another_process():
    """The command computes them in as many as there are cores."""
    assert pickle.loads(pickle.dumps(cases())) == cases()


DRAWN: list[list[float]] = []


def _recorded(production, n, rng):
    DRAWN.append(production.draw(n, rng).tolist())
    yield Statement("nothing", None, 0.0)


def _draws(case):
    DRAWN.clear()
    case.tallies()
    return [*DRAWN]


def _halved(production, n, rng):
    y = production.draw(n, rng)
    half = 0.5 * 1.96 * y.std() / np.sqrt(n)
    yield Statement("mean", (y.mean() - half, y.mean() + half), 0.0)


def test_every_number_has_a_row():
    """No estimate is left out of the short table, and no row is without a number."""
    numbers = set()
    for estimate in (*coverage.REPLICATIONS, coverage.attributions, coverage.verdicts):
        numbers |= {key[0] for key in Case(estimate, LOTS[0], 50, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.allocations, SHAPES[0], 100, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.pages, SHAPES[0], 100, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.verdicts_in_turn, SHAPES[0], 100, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.rare_shares, AIMED[0], 50, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.designed_shares, DESIGNED[0], 50, 1).tallies()}
    numbers |= {key[0] for key in Case(coverage.stops, LOTS_IN_TURN[0], 100, 1).tallies()}
    rows = {number: [group for group, pattern in GROUPS.items() if re.fullmatch(pattern, number)] for number in numbers}
    assert {number: found for number, found in rows.items() if len(found) != 1} == {}
    assert {group for found in rows.values() for group in found} == set(GROUPS)


def test_every_case_has_a_table():
    """No production is left out of the tables."""
    tabled = {production.name for productions, _, _ in coverage.TABLES for production in productions}
    assert {case.production.name for case in cases()} == tabled
