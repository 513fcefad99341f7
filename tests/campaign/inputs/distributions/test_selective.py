"""Selective assembly: the clearance of parts mated class by class, against integrals and draws of the two parts."""

from itertools import pairwise

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import integrate, stats

from campaign.inputs.distributions import Variable
from campaign.inputs.distributions.bounded import Selective
from tests.each import each

HOLE, SHAFT = (12.0, 12.018), (11.983, 11.994)  # 12 H7/g6


def fit(classes, cpk=1.0):
    table = {"distribution": "selective", "fit": "12 H7/g6", "cpk": cpk, "classes": classes}
    found = TypeAdapter(Variable).validate_python(table)
    assert isinstance(found, Selective)
    return found


def parts(cpk, classes, count, rng):
    """Return diameters of holes and shafts, mated class by class: parts of both are drawn until a class has enough."""
    sigmas = [z[np.abs(z) <= 3 * cpk] for z in rng.standard_normal((2, count))]
    edges = np.linspace(-3 * cpk, 3 * cpk, classes + 1)
    holes, shafts = [], []
    for i in range(classes):
        hole, shaft = (z[(z >= edges[i]) & (z < edges[i + 1])] for z in sigmas)
        n = min(hole.size, shaft.size)
        holes.append(hole[:n])
        shafts.append(shaft[:n])
    in_mm = (
        np.mean(ends) + (ends[1] - ends[0]) / (6 * cpk) * np.concatenate(z)
        for ends, z in ((HOLE, holes), (SHAFT, shafts))
    )
    return tuple(in_mm)


@each("classes", [1, 3, 4, 5])
@each("cpk", [0.7, 1.33])
def test_moments_and_quantiles_are_those_of_a_million_pairs(classes, cpk):
    """Mean and deviation within four standard errors; the share below each quantile likewise."""
    variable, n = fit(classes, cpk), 1_000_000
    hole, shaft = parts(cpk, classes, n, np.random.default_rng([3, classes]))
    clearance = 0.5 * (hole - shaft)
    mean, std = variable.moments()
    n = clearance.size
    assert abs(clearance.mean() - mean) < 4 * std / np.sqrt(n)
    assert clearance.std() == pytest.approx(std, rel=4 / np.sqrt(2 * n))
    u = np.array([0.001, 0.02, 0.1, 0.3, 0.5, 0.8, 0.99, 0.9999])
    below = np.searchsorted(np.sort(clearance), variable.ppf(u)) / n
    assert (np.abs(below - u) < 4.5 * np.sqrt(u * (1 - u) / n)).all()


@each("classes", [1, 4])
def test_probabilities_are_double_integrals(classes):
    """Class by class, the density of the shaft times the probability of the holes that leave less play."""
    variable, edges = fit(classes), np.linspace(-3, 3, classes + 1)
    h, s = (HOLE[1] - HOLE[0]) / 6, (SHAFT[1] - SHAFT[0]) / 6
    middle = 0.25 * (sum(HOLE) - sum(SHAFT))
    shares = np.diff(stats.norm.cdf(edges))
    for x in (0.004, 0.0085, 0.01025, 0.0111, 0.0165):
        total = 0.0
        for a, b in pairwise(edges):
            hole = stats.truncnorm(a, b)
            kinks = np.clip([(h * end - 2 * (x - middle)) / s for end in (a, b)], a, b)
            inside, _ = integrate.quad(
                lambda z, x=x, hole=hole: stats.norm.pdf(z) * hole.cdf((2 * (x - middle) + s * z) / h),
                a, b, points=sorted(kinks), epsabs=1e-13,
            )  # fmt: skip
            total += inside
        assert float(variable.cdf(np.array([x]))[0]) == pytest.approx(total / shares.sum(), rel=1e-9, abs=1e-12)


def test_classes_narrow_the_clearance_and_only_that():
    """The mean stays; with many classes only what the two tolerances differ by is left: 18 and 11 micrometres."""
    deviations = [fit(classes).moments()[1] for classes in (1, 2, 3, 5, 20)]
    assert deviations == sorted(deviations, reverse=True)
    assert {round(fit(classes).moments()[0], 12) for classes in (1, 3, 20)} == {0.01025}
    one = stats.truncnorm(-3, 3).std()
    assert deviations[0] == pytest.approx(1e-3 * np.hypot(18, 11) / 12 * one, rel=1e-9)
    assert deviations[-1] == pytest.approx(1e-3 * (18 - 11) / 12 * one, rel=0.04)


def test_a_fit_of_two_equal_tolerances_has_no_spread_but_that_of_a_class():
    """Hole and shaft of the same width: the variance is that of two uniform classes, nearly."""
    table = {"distribution": "selective", "fit": "12 H7/g7", "cpk": 1.0, "classes": 10}
    variable = TypeAdapter(Variable).validate_python(table)
    width = 0.018 / 10
    assert variable.moments()[1] == pytest.approx(0.5 * width * np.sqrt(2 / 12), rel=0.02)


@each(
    ("keys", "said"),
    [({"fit": "12 g6/H7"}, "12 g6/H7"), ({"classes": 0}, "greater than or equal to 1"), ({"cpk": 0.0}, "cpk")],
)
def test_what_is_refused(keys, said):
    """What is not a fit, no class, no capability."""
    table = {"distribution": "selective", "fit": "12 H7/g6", "cpk": 1.0, "classes": 4} | keys
    with pytest.raises(ValueError, match=said):
        TypeAdapter(Variable).validate_python(table)
