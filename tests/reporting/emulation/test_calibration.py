"""Calibration against a closed form, constants that nothing tells apart, and the coverage of a hundred benches."""

import numpy as np
import pytest

from reporting.emulation.calibration import Discrepancy, Measured, Prior, calibrate
from reporting.emulation.gaussian_process import fit_emulator
from reporting.errors import ReportError

MEAN, STD = np.array([2.0, 3.0, 1.0]), np.array([0.3, 0.5, 0.1])
NAMES = ("a", "b", "w")  # two constants, and what differs from specimen to specimen


def prior(constants=("a", "b")):
    columns = [NAMES.index(name) for name in constants]
    return Prior(NAMES, constants, lambda z: MEAN[columns] + STD[columns] * z, MEAN, STD)


def emulators(functions, n=60, seed=1):
    """Return an emulator of each function of a, b and w by rows that are drawn."""
    x = MEAN + STD * np.random.default_rng(seed).standard_normal((n, 3))
    return {name: fit_emulator(x, function(*x.T)) for name, function in functions.items()}


def measured(entries):
    """Return measurements, each (response, value, sigma, specimen, known w or None)."""
    response, value, sigma, specimen, w = zip(*entries, strict=True)
    known = np.full((len(entries), 3), np.nan)
    known[:, 2] = [np.nan if each is None else each for each in w]
    return Measured(response, np.array(value), np.array(sigma), specimen, known)


LINEAR = {"y": lambda a, b, w: a + 2 * b - 3 * w, "z": lambda a, b, w: a - b + w}
NONE = {name: Discrepancy(0.0, False) for name in LINEAR}


def test_a_linear_bench_has_its_closed_form():
    """Mean and covariance of the constants, with specimens that differ, a known discrepancy and repeated values."""
    entries = [("y", 5.2, 0.1, "A", None), ("z", 0.3, 0.05, "A", None), ("y", 5.5, 0.1, "B", None)]
    entries += [("y", 4.9, 0.1, "C", 1.1), ("y", 5.0, 0.1, "C", 1.1)]
    lacking = {"y": Discrepancy(0.2, False), "z": Discrepancy(0.1, False)}
    found = calibrate(emulators(LINEAR), measured(entries), prior(), lacking)
    rows = np.array([[1, 2], [1, -1], [1, 2], [1, 2], [1, 2.0]])
    of_w = np.array([-3.0, 1.0, -3.0, -3.0, -3.0])
    value = np.array([each[1] for each in entries]) - of_w * [1, 1, 1, 1.1, 1.1]
    covariance = np.diag([each[2] ** 2 for each in entries])
    for i, first in enumerate(entries):
        for j, second in enumerate(entries):
            if first[3] == second[3] and first[4] is None:
                covariance[i, j] += of_w[i] * of_w[j] * STD[2] ** 2
            if first[0] == second[0]:
                apart = ((first[4] or 1.0) - (second[4] or 1.0)) / STD[2]
                covariance[i, j] += lacking[first[0]].scale ** 2 * np.exp(-0.5 * apart**2)
    precision = np.diag(STD[:2] ** -2.0) + rows.T @ np.linalg.solve(covariance, rows)
    expected = np.linalg.inv(precision)
    mean = expected @ (MEAN[:2] / STD[:2] ** 2 + rows.T @ np.linalg.solve(covariance, value))
    std = np.sqrt(np.diag(expected))
    for constant, at, spread in zip(found.constants, mean, std, strict=True):
        assert constant.mean == pytest.approx(at, abs=0.1 * spread)
        assert constant.std == pytest.approx(spread, rel=0.08)
        assert constant.interval == pytest.approx((at - 1.96 * spread, at + 1.96 * spread), abs=0.2 * spread)
    ((first, second, correlation),) = found.correlations
    assert (first, second) == ("a", "b")
    assert correlation == pytest.approx(expected[0, 1] / std.prod(), abs=0.06)
    # the information's eigenvalues are those of the closed form in standard scores
    information = np.diag(STD[:2]) @ (precision - np.diag(STD[:2] ** -2.0)) @ np.diag(STD[:2])
    left = 1 / np.sqrt(1 + np.linalg.eigvalsh(information)[::-1])
    assert [each.fisher for each in found.directions] == pytest.approx(left, rel=0.03)
    assert found.holds(dict(zip("ab", mean, strict=True)))
    assert not found.holds({"a": mean[0] + 4 * std[0], "b": mean[1] + 4 * std[1]})


def test_only_a_product_is_told():
    """Two constants of which only the product matters are reported so, before any number."""
    product = emulators({"y": lambda a, b, w: a * b + 0.5 * w})
    found = calibrate(product, measured([("y", 6.8, 0.02, "A", 1.0)]), prior(), {"y": Discrepancy(0.0, False)})
    assert "cannot tell" in found.told[1]
    assert "a" in found.told[1]
    assert "b" in found.told[1]
    best, other = found.directions
    assert best.spread < 0.1
    assert other.spread > 0.8
    assert found.correlations[0][2] < -0.9
    # a second response that only b moves tells both
    both = product | emulators({"z": lambda a, b, w: b + 0.2 * w})
    entries = [("y", 6.8, 0.02, "A", 1.0), ("z", 3.4, 0.02, "A", 1.0)]
    told = calibrate(both, measured(entries), prior(), {name: Discrepancy(0.0, False) for name in both})
    assert all("The data tell" in words for words in told.told)
    assert told.constants[0].mean == pytest.approx((6.8 - 0.5) / 3.2, abs=0.05)


def test_a_constant_that_nothing_moves():
    only = emulators({"y": lambda a, b, w: a + w})
    found = calibrate(only, measured([("y", 3.1, 0.02, "A", 1.0)]), prior(), {"y": Discrepancy(0.0, False)})
    assert found.told[1].startswith("The data do not tell b")
    assert found.constants[1].spread == pytest.approx(1.0, abs=0.06)
    assert found.constants[1].std == pytest.approx(STD[1], rel=0.06)


def test_a_discrepancy_is_estimated():
    """Values that contradict each other by more than their uncertainty: the model errs, and says by how much."""
    entries = [("y", 5.2, 0.01, "A", 0.9), ("y", 6.4, 0.01, "A", 1.1), ("z", 0.0, 0.01, "A", 0.9)]
    lacking = {"y": Discrepancy(1.0, True), "z": Discrepancy(0.0, False)}
    found = calibrate(emulators(LINEAR), measured(entries), prior(), lacking)
    mean, (low, high) = found.discrepancies["y"]
    assert 0.3 < mean < 1.5
    assert low < mean < high
    exact = calibrate(emulators(LINEAR), measured(entries), prior(), NONE)
    assert any("no value of the constants explains it" in note for note in exact.notes)


def test_values_repeated_without_an_error_of_their_own():
    """However small the uncertainty, equal values are one, and contradictory ones no crash."""
    entries = [(name, value, 1e-12, "A", 1.0) for name, value in (("y", 5.2), ("z", 0.3)) for _ in range(2)]
    found = calibrate(emulators(LINEAR), measured(entries), prior(), NONE, particles=500)
    assert [each.mean for each in found.constants] == pytest.approx([8.9 / 3 - 0.7, 8.9 / 3], abs=0.05)
    apart = [*entries, ("y", 5.3, 1e-12, "A", 1.0)]
    told = calibrate(emulators(LINEAR), measured(apart), prior(), NONE, particles=500)
    assert all(np.isfinite(each.std) for each in told.constants)


def test_emulators_that_predict_badly_are_refused():
    rough = emulators({"y": lambda a, b, w: np.sin(20 * a) * np.cos(9 * b)})
    with pytest.raises(ReportError, match="y: the emulator explains"):
        calibrate(rough, measured([("y", 0.1, 0.1, "A", None)]), prior(), {"y": Discrepancy(0.0, False)})


BENCH = {"y": lambda a, b, w: a * b - 3 * w, "z": lambda a, b, w: np.exp(0.5 * a) - b + w**2}


@pytest.mark.slow
def test_coverage_of_a_hundred_benches():
    """The 95 % region holds the truth in 92 to 98 of 100 benches, each with its own truth, rows and discrepancy."""
    held, within = 0, np.zeros(2)
    for seed in range(100):
        rng = np.random.default_rng(1000 + seed)
        truth, specimens = MEAN[:2] + STD[:2] * rng.standard_normal(2), MEAN[2] + STD[2] * rng.standard_normal(3)
        lacks = {"y": 0.1 * abs(rng.standard_normal()), "z": 0.05}
        error = {name: lacks[name] * rng.standard_normal() for name in BENCH}
        entries = [
            (name, f(*truth, w) + error[name] + 0.03 * rng.standard_normal(), 0.03, str(i), None)
            for i, w in enumerate(specimens)
            for name, f in BENCH.items()
        ]
        lacking = {"y": Discrepancy(0.1, True), "z": Discrepancy(0.05, False)}
        found = calibrate(emulators(BENCH, 50, seed), measured(entries), prior(), lacking, seed=seed, particles=1000)
        held += found.holds(dict(zip("ab", truth, strict=True)))
        within += [
            low <= x <= high for x, (low, high) in zip(truth, (c.interval for c in found.constants), strict=True)
        ]
    assert 92 <= held <= 98
    assert (within >= 90).all()
