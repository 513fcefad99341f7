"""What rejects have in common, against scipy; the worst samples, against sorting."""

import numpy as np
import pytest
from scipy import stats

from reporting.sensitivity.reject_attribution import REJECTS, TAIL, reject_causes, worst_samples

RNG = np.random.default_rng(77)


def sample(n):
    """Return a response that J1 drives through its upper limit, and J2 by its spread."""
    inputs = {f"J{i}": 1e3 + RNG.normal(size=n) for i in (1, 2, 3)}
    return inputs["J1"] - 1e3 + 0.5 * (inputs["J2"] - 1e3) ** 2, inputs


def test_differences_are_scipys():
    """Welch's interval and Kolmogorov's distance."""
    y, inputs = sample(4000)
    found = reject_causes(y, inputs, None, 2.0, 0.95)
    out = y > 2.0
    assert (found.group, found.count, found.rejects) == (REJECTS, out.sum(), out.sum())
    assert [d.variable for d in found.differences[:2]] == ["J1", "J2"]
    for d in found.differences:
        a, b = inputs[d.variable][out], inputs[d.variable][~out]
        std = np.std(inputs[d.variable], ddof=1)
        welch = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
        assert np.array(d.shift_interval) * std == pytest.approx([welch.low, welch.high], abs=1e-9)
        distance = stats.ks_2samp(a, b, method="asymp")
        assert d.distance == pytest.approx(distance.statistic, abs=1e-12)
    assert found.differences[-1].p_value > 1e-3 > found.differences[0].p_value


def test_an_idle_variable_is_rarely_blamed():
    """Of 400 samples, the p-value of J3 is below 0.05 in at most 8 %; the asymptotic test is a little shy."""
    blamed = 0
    for _ in range(400):
        y, inputs = sample(500)
        found = reject_causes(y, inputs, None, 1.5, 0.95)
        blamed += next(d for d in found.differences if d.variable == "J3").p_value < 0.05
    assert blamed / 400 < 0.08


def test_without_rejects_the_least_margin_speaks():
    """The 1 % nearest to a limit, either side; without limits or with 30 rows there is nothing to say."""
    y, inputs = sample(5000)
    found = reject_causes(y, inputs, -50.0, 50.0, 0.95)
    assert (found.group, found.count, found.rejects) == (TAIL, 50, 0)
    assert found.differences[0].variable in ("J1", "J2")
    assert reject_causes(y, inputs, None, None, 0.95) is None
    assert reject_causes(y[:30], {k: v[:30] for k, v in inputs.items()}, None, 50.0, 0.95) is None
    everything = reject_causes(y, inputs, None, -100.0, 0.95)
    assert everything is None


def test_worst_samples_by_sorting():
    """Margins of both limits, negative beyond; ties by sample number; inputs of the row."""
    y, inputs = sample(300)
    number = np.arange(300) + 1000
    found = worst_samples(number, y, inputs, -1.0, 2.0)
    assert [w.side for w in found] == ["lower"] * 5 + ["upper"] * 5
    assert [w.sample for w in found[:5]] == list(number[np.argsort(y)[:5]])
    assert [w.sample for w in found[5:]] == list(number[np.argsort(-y)[:5]])
    assert found[5].margin == pytest.approx(2.0 - y.max())
    assert found[5].inputs["J2"] == inputs["J2"][np.argmax(y)]
    assert [w.sample for w in worst_samples(number[:9], np.zeros(9), {}, 0.0, None)] == list(number[:5])
    assert worst_samples(number[:0], y[:0], {}, 0.0, 1.0) == ()
    for n in (3, 5, 6):
        listed = [w.sample for w in worst_samples(number[:n], y[:n], {}, 0.0, None)]
        assert listed == list(number[np.argsort(y[:n])[:5]])
