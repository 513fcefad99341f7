"""Indices around a target against published processes, identities, and simulated coverage."""

import math

import numpy as np
import pytest

from reporting.capability import capability
from reporting.capability.summary import target_indices


def two_point(mean, std, n=400):
    """Return values with exactly this mean and this standard deviation, divisor n."""
    return mean + std * np.tile([-1.0, 1.0], n // 2)


@pytest.mark.parametrize(("mean", "std", "cpm", "cpmk"), [(50.0, 5.0, 1.0, 1.0), (57.5, 2.5, 0.632456, 0.316228)])
def test_montgomerys_two_processes(mean, std, cpm, cpmk):
    """Introduction to Statistical Quality Control, section 8.3: limits 35 and 65, target 50, Cpk 1 for both."""
    found = target_indices(two_point(mean, std), 35.0, 65.0, 50.0, 0.95)
    assert (found.cpm_star, found.cpmk) == pytest.approx((cpm, cpmk), abs=5e-7)


@pytest.mark.parametrize(
    ("lsl", "usl", "target", "cpm_star", "cpmk"),
    [
        (35.0, 65.0, 55.0, 10 / 3 / math.sqrt(12.5), 7.5 / 3 / math.sqrt(12.5)),  # the upper limit is nearer
        (None, 65.0, 55.0, 10 / 3 / math.sqrt(12.5), 7.5 / 3 / math.sqrt(12.5)),
        (35.0, None, 55.0, 20 / 3 / math.sqrt(12.5), 22.5 / 3 / math.sqrt(12.5)),
        (35.0, 57.0, 55.0, 2 / 3 / math.sqrt(12.5), -0.5 / 3 / math.sqrt(12.5)),  # the mean is out of limits
    ],
)
def test_an_off_centre_target_and_one_limit(lsl, usl, target, cpm_star, cpmk):
    """The mean is 57.5 and sigma 2.5: tau^2 is 6.25 + 6.25."""
    found = target_indices(two_point(57.5, 2.5), lsl, usl, target, 0.95)
    assert (found.cpm_star, found.cpmk) == pytest.approx((cpm_star, cpmk))


def test_the_identity_and_the_interval_of_boyles():
    """Cpmk = Cpk Cpm / Cp of the same sigma; for normal values the interval of Cpm* is nearly Boyles'."""
    x = np.random.default_rng(3).normal(10.2, 0.5, 4000)
    found, c = target_indices(x, 8.0, 12.0, 10.0, 0.95), capability(x, 8.0, 12.0, 10.0)
    assert found.cpm_star == pytest.approx(c.cpm)
    assert found.cpmk == pytest.approx(c.cpk * c.cpm / c.cp)
    assert found.cpm_star_interval == pytest.approx(c.cpm_interval, rel=0.01)


@pytest.mark.parametrize(
    ("arguments"),
    [
        {"target": None},
        {"target": 13.0},
        {"target": 12.0},
        {"lsl": None, "usl": None},
        {"x": np.full(50, 10.0), "target": 10.0},
        {"x": np.array([10.0])},
        {"x": np.array([1e200, -1e200])},
    ],
)
def test_without_a_target_between_the_limits_there_is_none(arguments):
    """Nor without a limit, without spread around the target, or with one value."""
    given = {"x": np.linspace(9, 11, 50), "lsl": 8.0, "usl": 12.0, "target": 10.0} | arguments
    assert target_indices(**given, confidence=0.95) is None


def test_few_values_and_few_lots_have_no_interval():
    """Cpmk from 100 values; nothing from four lots; a constant beside the target has indices and no interval."""
    x = np.random.default_rng(1).normal(10, 0.4, 120)
    for n, intervals in ((99, (True, False)), (100, (True, True))):
        found = target_indices(x[:n], 8.0, 12.0, 10.0, 0.95)
        assert (found.cpm_star_interval is not None, found.cpmk_interval is not None) == intervals
    found = target_indices(x, 8.0, 12.0, 10.0, 0.95, np.arange(120) // 30)
    assert (found.cpm_star_interval, found.cpmk_interval) == (None, None)
    assert target_indices(np.full(120, 10.5), 8.0, 12.0, 10.0, 0.95).cpm_star_interval is None


def test_lots_widen_the_intervals():
    """200 samples of 30 lots of 20, half of the variance between: 90 % or more are covered, and naively below 75 %."""
    rng, lots = np.random.default_rng(4), np.arange(600) // 20
    truth = np.array([4.7, 4.0]) / 3 / math.sqrt(1.49)
    covered = np.zeros((2, 2))
    for _ in range(200):
        x = ((rng.normal(size=(30, 20)) + rng.normal(size=(30, 1))) / math.sqrt(2)).ravel()
        for way, given in enumerate((lots, None)):
            found = target_indices(x, None, 4.0, -0.7, 0.95, given)
            for which, (low, high) in enumerate((found.cpm_star_interval, found.cpmk_interval)):
                covered[way, which] += low <= truth[which] <= high
    assert np.all(covered[0] >= 0.9 * 200)
    assert np.all(covered[1] < 0.75 * 200)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["normal", "lognormal", "standard_t", "uniform"])
def test_the_intervals_cover(shape):
    """500 samples of 200 values, the target 0.7 sigma off: 91.5 to 98 % (standard error 1 %)."""
    rng = np.random.default_rng(5)
    draw, mean, std = {
        "normal": (lambda: rng.normal(size=200), 0.0, 1.0),
        "lognormal": (
            lambda: rng.lognormal(0, 0.5, 200),
            math.exp(1 / 8),
            math.sqrt(math.expm1(1 / 4) * math.exp(1 / 4)),
        ),
        "standard_t": (lambda: rng.standard_t(5, 200), 0.0, math.sqrt(5 / 3)),
        "uniform": (lambda: rng.random(200), 0.5, math.sqrt(1 / 12)),
    }[shape]
    target, usl = mean - 0.7 * std, mean + 4 * std
    truth = 4.7 * std / (3 * std * math.sqrt(1.49)), 4 * std / (3 * std * math.sqrt(1.49))
    found = [target_indices(draw(), None, usl, target, 0.95) for _ in range(500)]
    for name, true in zip(("cpm_star_interval", "cpmk_interval"), truth, strict=True):
        covered = np.mean([getattr(f, name)[0] <= true <= getattr(f, name)[1] for f in found])
        assert 0.915 <= covered <= 0.98, name


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_intervals_do_not_depend_on_the_unit(scale):
    """Heavy tails far from the target, in units whose squares overflow or vanish: the intervals of unit 1."""
    x = np.random.default_rng(2).standard_t(4, 300)
    plain = target_indices(x, -9.0, 9.0, 2.0, 0.95)
    found = capability(scale * x, -9.0 * scale, 9.0 * scale, 2.0 * scale)
    assert found.cpm_interval is None or found.cpm_interval == pytest.approx(capability(x, -9.0, 9.0, 2.0).cpm_interval)
    again = target_indices(scale * x, -9.0 * scale, 9.0 * scale, 2.0 * scale, 0.95)
    assert again is None or again.cpm_star_interval == pytest.approx(plain.cpm_star_interval)
