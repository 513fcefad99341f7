"""Weights: the Pareto tail against its own distribution, Kish's size, refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reporting import ReportError
from reporting.tolerance.reweighting import Change, contributions, pareto_smoothed, tail_shape, weights

RNG = np.random.default_rng(31)


def test_smoothing_keeps_the_body_and_the_largest():
    """Only the tail changes, in its order, and never beyond the largest raw weight."""
    raw = RNG.pareto(1.5, 4000)
    smooth, k = pareto_smoothed(raw)
    changed = smooth != raw
    assert 0 < changed.sum() <= math.ceil(3 * math.sqrt(4000))
    kept = np.setdiff1d(np.flatnonzero(~changed), np.argmax(raw))
    assert np.min(raw[changed]) > np.max(raw[kept])
    assert smooth.max() <= raw.max()
    order = np.argsort(raw)
    assert np.all(np.diff(smooth[order]) >= 0)
    assert k == pytest.approx(1 / 1.5, abs=0.15)


@settings(deadline=None)
@given(st.floats(-700, 700))
def test_a_constant_factor_changes_nothing(constant):
    """Densities need not be normalised."""
    ratio = np.random.default_rng(1).normal(size=500)
    base, moved = weights(Change(ratio)), weights(Change(ratio + constant))
    assert moved.weight == pytest.approx(base.weight, abs=1e-12)
    assert moved.refusal == base.refusal


def test_no_change_is_equal_weights():
    """Every sample counts once, and no tail is fitted."""
    w = weights(Change(np.zeros(400)))
    assert w.weight == pytest.approx(np.full(400, 1 / 400))
    assert (w.effective, w.pareto_k, w.refusal) == (pytest.approx(400), None, "")


def test_ratios_by_variable_add_up():
    """A column a variable, shape (n, k)."""
    ratio = RNG.normal(size=(300, 3)) / 3
    assert weights(Change(ratio)).weight == pytest.approx(weights(Change(ratio.sum(axis=1))).weight)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (Change(np.zeros(50)), "worth 50 samples of the new"),
        (Change(np.r_[np.zeros(5000), 6.0]), "carry 7 %"),
        (Change(-np.log(np.arange(1, 200_001) - 0.5) / 1.3), "Pareto k = 0.7"),
        (Change(np.zeros(5000), outside=0.02), "2 % of the new values lie where"),
        (Change(np.full(50, -np.inf)), "worth 0"),
        (Change(np.zeros(0)), "worth 0"),
    ],
)
def test_weights_that_cannot_be_used_say_why(change, why):
    """Too few, one that carries all, a heavy tail, support that was never sampled, no overlap, no sample."""
    assert why in weights(change).refusal


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_impossible_ratios_raise(bad):
    """The old density is not zero at a sample it drew."""
    with pytest.raises(ReportError, match="NaN or infinity"):
        weights(Change(np.array([0.0, bad])))
    with pytest.raises(ReportError, match="probability"):
        weights(Change(np.zeros(3), outside=bad))


def test_the_shape_of_a_tail_is_that_of_its_smoothing():
    """From pieces of more values than are looked at as a whole, and from few."""
    for n in (20, 4000, 250_000):
        raw = RNG.pareto(2.0, n)
        assert tail_shape(n, lambda rows, raw=raw: raw[rows]) == pareto_smoothed(raw)[1]


def test_contributions_of_many_are_those_of_all():
    terms = RNG.standard_t(5, 250_000)
    found, scaled = contributions(terms.size, lambda rows: terms[rows]), terms / np.linalg.norm(terms)
    assert found.squares == pytest.approx(terms @ terms, rel=1e-13)
    assert found.most == pytest.approx(scaled[np.argmax(np.abs(scaled))], rel=1e-13)
    assert (found.third, found.fourth) == pytest.approx((np.sum(scaled**3), np.sum(scaled**4)), rel=1e-9)
