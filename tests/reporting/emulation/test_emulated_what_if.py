"""What-ifs by an emulator: against the functions themselves, and refused where it knows too little."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from reporting.emulation.emulated_what_if import emulated_what_if, sampled_deviations
from reporting.emulation.gaussian_process import fit_emulator
from reporting.tolerance.whatif import WhatIf

REFUSED = WhatIf(300, 0, 40.0, 0.1, 0.9, 0.6, 0.0, 1500, refusal="the samples are worth 40")
LIMITS = (0.0, 9.0)


def response(x, y):
    return 4.0 + 0.8 * x + 0.4 * y**2 + np.sin(x * y / 2)


def variables(rng, n, sigma):
    """Return two variables cut at 3; the first has another sigma before the cut."""
    return {
        "x": truncnorm.rvs(-3 / sigma, 3 / sigma, scale=sigma, size=n, random_state=rng),
        "y": truncnorm.rvs(-3, 3, size=n, random_state=rng),
    }


def test_sampled_functions_have_the_process_s_moments():
    """Mean and joint covariance of many functions at new points, less their mean, are the predicted ones."""
    x = np.random.default_rng(1).standard_normal((30, 2))
    emulator = fit_emulator(x, response(*x.T))
    at = np.random.default_rng(2).standard_normal((5, 2))
    covariance = emulator.predict(at)[1]
    found = sampled_deviations(emulator, at, 4000, np.random.default_rng(3))
    largest = covariance.diagonal().max()
    assert found.mean(axis=1) == pytest.approx(0.0, abs=4 * np.sqrt(largest / 4000))
    assert np.cov(found) == pytest.approx(covariance, abs=0.1 * largest)


def test_a_wider_variable_is_answered():
    """Half as much sigma again: the truth of mean, sigma, Cpk and share lies in the intervals of a labelled answer."""
    rng = np.random.default_rng(3)
    old, new = variables(rng, 400, 1.0), variables(rng, 4000, 1.5)
    answer = emulated_what_if(response(**old), old, new, LIMITS, REFUSED)
    y = response(**variables(rng, 400_000, 1.5))
    cpk = min(y.mean() - LIMITS[0], LIMITS[1] - y.mean()) / (3 * y.std())
    share = 1e6 * np.mean((y < LIMITS[0]) | (y > LIMITS[1]))
    truths = {"mean": y.mean(), "std": y.std(), "cpk": cpk, "ppm": share}
    for name, truth in truths.items():
        low, high = getattr(answer, name).interval
        assert low < truth < high
    assert answer.cpk.value == pytest.approx(cpk, rel=0.05)
    assert answer.refusal == ""
    assert answer.emulated == REFUSED.refusal
    assert "Emulated from 400 rows" in answer.notes[-1]


def test_what_an_emulator_does_not_know_is_refused_as_before():
    """Few rows, failed ones, values far beyond them, and a response that scatters."""
    rng = np.random.default_rng(4)
    old, wide = variables(rng, 300, 1.0), {"x": rng.uniform(-9, 9, 4000), "y": rng.uniform(-3, 3, 4000)}
    y, same = response(**old), {name: np.tile(x, 14) for name, x in old.items()}
    few = {name: x[:40] for name, x in old.items()}
    lacks = np.where(np.arange(300) % 20, y, np.nan)
    for values, rows, new, why in (
        (y[:40], few, same, "40 rows have a value"),
        (lacks, old, same, "5 % of the rows have no value"),
        (y, old, wide, "lie beyond those of the rows"),
        (rng.standard_normal(300), old, same, "explains"),
        (np.ones(300), old, same, "all values are equal"),
    ):
        answer = emulated_what_if(values, rows, new, LIMITS, REFUSED)
        assert answer.refusal == REFUSED.refusal
        assert answer.mean is None
        assert why in answer.notes[-1]


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Of 60 campaigns of 200 rows, nine tenths of the intervals that are given hold the truth, or more."""
    y = response(**variables(np.random.default_rng(5), 1_000_000, 1.5))
    truths = {"mean": y.mean(), "std": y.std(), "cpk": min(y.mean(), 9 - y.mean()) / (3 * y.std())}
    held, given = dict.fromkeys(truths, 0), 0
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        old, new = variables(rng, 200, 1.0), variables(rng, 4000, 1.5)
        answer = emulated_what_if(response(**old), old, new, LIMITS, REFUSED)
        if answer.refusal:  # too many new values lie beyond these rows
            continue
        given += 1
        for name, truth in truths.items():
            low, high = getattr(answer, name).interval
            held[name] += low <= truth <= high
    assert given >= 20
    assert min(held.values()) >= 0.9 * given, held
