"""The study's limits have the shares that they claim: counted among a million plain runs, where these see them."""

import numpy as np
import pytest

from studies.coverage.rare import STATES, curved, flat, sphere


@pytest.mark.parametrize(
    "state", [flat(7, 0.02), sphere(5, 0.02), curved(3, 0.05, 0.03), curved(7, 0.1, 0.02), curved(10, -0.1, 0.02)]
)
def test_share_beyond_the_limit(state):
    n = 200_000
    z = np.random.default_rng(4).standard_normal((n, state.dimensions))
    error = np.sqrt(state.share * (1 - state.share) / n)
    assert np.mean(state.response(z) > state.limit) == pytest.approx(state.share, abs=4 * error)


def test_limits_are_from_7_to_50_variables_and_from_ppm_to_percents():
    assert {state.dimensions for state in STATES.values()} >= {7, 20, 50}
    assert min(state.share for state in STATES.values()) <= 1e-6
    assert max(state.share for state in STATES.values()) >= 0.03
