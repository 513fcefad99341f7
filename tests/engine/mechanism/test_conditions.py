"""Conditions read as they were written."""

import pytest

from engine.mechanism.responses import Condition


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        (0.05, "tilt < 0.05"),
        (0.0, "tilt < 0"),
        (-3.0, "tilt < -3"),
        (1e-6, "tilt < 1e-06"),
        (0.1 + 0.2, "tilt < 0.30000000000000004"),
    ],
)
def test_a_limit_has_the_fewest_digits_that_give_it_back(limit, text):
    """0.05 is not 0.050000000000000003, and nothing of a limit is lost."""
    assert str(Condition("tilt", "<", limit)) == text
    assert float(text.split()[-1]) == limit
