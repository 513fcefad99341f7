"""What the study takes for a warning of the page, and what not."""

import numpy as np
import pytest

from studies.coverage.estimates import methods
from studies.coverage.outcomes import WARNED
from studies.coverage.productions import LOTS, SHAPES

pytestmark = pytest.mark.slow


def outcomes(production, n: int, pattern: str, campaigns: int = 5) -> list[str]:
    """Return the outcomes of the statements whose number begins with a word."""
    return [
        statement.outcome()
        for r in range(campaigns)
        for statement in methods(production, n, np.random.default_rng((15, r)))
        if statement.number.startswith(pattern)
    ]


def test_an_upper_bound_of_a_tail_is_no_warning():
    """Of 500 normal values half the tails were warned of; a bound is a statement, and counts as one."""
    found = outcomes(SHAPES[0], 500, "tail")
    assert len(found) == 10
    assert WARNED not in found


def test_shares_of_a_normal_distribution_are_warned_of_where_lots_cannot_test_the_shape():
    """20 lots of a lognormal response, 50 values; before, 40 % of the campaigns had no warning, and none held."""
    lognormal = LOTS[-1]
    assert lognormal.shape == "lognormal"
    assert set(outcomes(lognormal, 50, "Z.bench", 12)) == {WARNED}
