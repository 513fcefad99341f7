"""A sample is a function of (seed, sample number, variable name) alone."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign.distributions import Normal, TruncatedNormal, Uniform
from campaign.sampling import draw, uniforms

J = TruncatedNormal(distribution="truncated_normal", mean=0.07, std=0.0175, lower=0.01, upper=0.13)
VARIABLES = {f"J{i}": J for i in range(1, 8)}
WHOLE = draw(VARIABLES, seed=2018, first=0, count=400)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 399), st.integers(1, 100))
def test_any_slice_is_the_same_bits(first, count):
    """Whatever the batch, its samples are those of the whole."""
    part = draw(VARIABLES, seed=2018, first=first, count=min(count, 400 - first))
    for name, values in part.items():
        assert values.tobytes() == WHOLE[name][first : first + len(values)].tobytes()


def test_other_variables_do_not_matter():
    """One more variable, or another order, leaves the others as they were."""
    more = {"new": Normal(distribution="normal", mean=0.0, std=1.0), **dict(reversed(VARIABLES.items()))}
    drawn = draw(more, seed=2018, first=0, count=400)
    assert all(np.array_equal(drawn[name], WHOLE[name]) for name in VARIABLES)


def test_first_values_never_change():
    """A stored campaign can be extended by a later version: the stream itself is part of the format."""
    assert uniforms(2018, "J1", 0, 3).tolist() == [
        0.6137961892190279,
        0.20385611599472842,
        0.8281220665825978,
    ]


def test_seeds_and_names_give_unrelated_streams():
    """No two streams are correlated beyond chance (n = 20,000: 5 standard errors are 0.035)."""
    streams = [uniforms(seed, name, 0, 20_000) for seed in (0, 1, 2**63 - 1) for name in ("J1", "J2", "J10", "é")]
    correlation = np.corrcoef(streams) - np.eye(len(streams))
    assert np.abs(correlation).max() < 0.035


def test_strictly_inside_the_unit_interval():
    """The quantile of 0 or 1 may be infinite: neither is drawn, not even from extreme words."""
    u = uniforms(3, "x", 0, 200_000)
    assert 0.0 < u.min() < 1e-4
    assert 1.0 - 1e-4 < u.max() < 1.0
    assert ((np.uint64(2**64 - 1) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52 < 1.0


def test_corners_are_every_combination_of_ends_and_the_middle():
    """Bit j of the sample number is the end of variable j; any piece of them is the same as in the whole."""
    ranges = {"a": (0.0, 1.0), "b": (2.0, 4.0), "c": (-1.0, 1.0)}
    variables = {name: Uniform(distribution="uniform", lower=low, upper=high) for name, (low, high) in ranges.items()}
    whole = draw(variables, 0, 0, 9, "worst_case")
    rows = list(zip(*whole.values(), strict=True))
    assert set(rows[:8]) == set(itertools.product(*ranges.values()))
    assert rows[5] == (1.0, 2.0, 1.0)
    assert rows[8] == (0.5, 3.0, 0.0)
    piece = draw(variables, 7, 3, 4, "worst_case")
    assert all((piece[name] == whole[name][3:7]).all() for name in variables)
