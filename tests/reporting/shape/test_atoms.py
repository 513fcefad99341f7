"""Atoms are named and never fitted; rounding and ties by chance are no atoms."""

import numpy as np
import pytest

from reporting.shape.fitting import fit_families
from reporting.shape.sorted_sample import ties
from tests.each import each


def zeros(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.where(rng.random(n) < 0.3, 0.0, rng.normal(size=n))


def noisy_zeros(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.where(rng.random(n) < 0.3, 1e-12 * rng.random(n), rng.normal(size=n))


def stop_below(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.maximum(rng.normal(size=n), -1.0)


def rare_stop_above(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.minimum(rng.normal(size=n), 1.8)


def rounded_stop(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.maximum(rng.normal(size=n), -1.0).round(1)


def habit(rng: np.random.Generator, n: int) -> np.ndarray:
    """Whole grams, many of them said as fifty or a hundred."""
    grams = np.maximum(rng.gamma(4.0, 18.0, n).round(), 1)
    return np.where(rng.random(n) < 0.35, np.maximum(50 * np.round(grams / 50), 50), grams)


@each("n", [120, 500, 30_000])
@each(
    ("draw", "value", "where"),
    [
        (zeros, 0.0, "inside"),
        (noisy_zeros, 0.0, "inside"),
        (stop_below, -1.0, "lowest"),
        (rare_stop_above, 1.8, "highest"),
        (rounded_stop, -1.0, "lowest"),
        (habit, 50.0, "inside"),
    ],
)
def test_an_atom_is_named_with_its_share_and_its_end_and_not_fitted(draw, value: float, where: str, n: int) -> None:
    """Before, two normals of width 1e-6, or Johnson's SB without a gap, were fitted to each of these."""
    x = draw(np.random.default_rng(3), n)
    found = fit_families(x)
    assert (found.best, found.fits, found.candidates) == (None, (), ())
    atom = next(atom for atom in found.atoms if atom.value == pytest.approx(value, abs=1e-9))
    assert atom.where == where
    assert atom.count == np.count_nonzero(np.abs(x - value) < 1e-9)
    assert atom.share == atom.count / n
    assert f"{atom.value:.6g}" in found.notes[0]


@each("n", [50, 500, 30_000])
@each("digits", [1, 2, 4])
@each("family", ["normal", "exponential", "laplace", "standard_cauchy"])
def test_rounded_values_are_no_atoms(family: str, digits: int, n: int) -> None:
    x = np.sort(getattr(np.random.default_rng(4), family)(size=n).round(digits))
    assert ties(x).atoms() == ()


@pytest.mark.parametrize("digits", [0.5, 0.25, 0.1, 0.01])
def test_rounding_does_not_fail_a_family(digits: float) -> None:
    """40 samples of 2,000 values, in steps of a part of sigma: the normal family passes about as often as unrounded."""
    rng = np.random.default_rng(5)
    passed = [
        fit_families(digits * np.round(rng.normal(10, 1, 2000) / digits), names=["normal"]).best == "normal"
        for _ in range(40)
    ]
    assert np.mean(passed) >= 0.85


def test_equal_values_are_spread_over_what_rounds_to_them() -> None:
    values = np.array([1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0])
    spread = ties(values).spread(values)
    assert spread == pytest.approx([1.0, 1.625, 1.875, 2.125, 2.375, 2.75, 3.25])
    smooth = np.sort(np.random.default_rng(6).normal(size=200))
    assert np.array_equal(ties(smooth).spread(smooth), smooth)


@each("digits", [0, 1, 3, 17])
def test_ties_are_the_distinct_values_and_their_counts(digits: int) -> None:
    x = np.sort(np.random.default_rng(8).normal(size=40_000).round(digits))
    found, (values, counts) = ties(x), np.unique(x, return_counts=True)
    if digits < 17:
        assert np.array_equal(found.values, values)
        assert np.array_equal(found.counts, counts)
    assert found.counts.sum() == x.size


def test_a_discrete_response_says_so() -> None:
    found = fit_families(np.random.default_rng(7).poisson(1.5, 400))
    assert found.fits == ()
    assert "different values" in found.notes[0]


@each("seed", range(8))
def test_no_component_of_a_mixture_is_a_spike(seed: int) -> None:
    """A few values that happen to be close are no second distribution."""
    rng = np.random.default_rng(seed)
    x = np.concatenate((rng.normal(size=60), 0.3 + 1e-6 * rng.normal(size=3)))
    fit = fit_families(x, names=["two_normals"]).of("two_normals")
    assert fit is None or min(fit.parameters["sd 1"], fit.parameters["sd 2"]) > 1e-3


def test_narrow_distributions_apart_from_each_other_are_no_spikes() -> None:
    rng = np.random.default_rng(8)
    x = np.concatenate((5 + 0.001 * rng.normal(size=250), 9 + 0.002 * rng.normal(size=250)))
    fit = fit_families(x).of("two_normals")
    assert fit.passes
    assert fit.parameters["mean 1"] == pytest.approx(5, abs=1e-3)
    assert fit.parameters["sd 1"] == pytest.approx(0.001, rel=0.15)
