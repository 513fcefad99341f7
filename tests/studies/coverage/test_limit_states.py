"""The study's limits have the shares that they claim."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, gamma, multivariate_normal, norm
from scipy.stats.qmc import Sobol

from studies.coverage.rare import STATES, curved, flat, sphere
from studies.coverage.reliability import PROBLEMS, limit_state


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


def over(share: Callable[[float], float], *points: float, low: float = -12.0, high: float = 12.0) -> float:
    """Return the mean of a share over a standard normal variable; `points` are its jumps and kinks."""
    found = quad(lambda z: share(z) * norm.pdf(z), low, high, points=points or None, limit=500, epsabs=1e-16)
    return 1e6 * float(found[0])


def evenly(name: str, left_out: int, share) -> float:
    """Return the mean of a share, given all variables but one, over evenly spread points."""
    variables = list(PROBLEMS[name][1])
    of = variables.pop(left_out)
    points = Sobol(len(variables), rng=3).random(2**16)
    x = [v.ppf(column) for v, column in zip(variables, points.T, strict=True)]
    return 1e6 * float(np.mean(share(of, *x)))


def bars(x: float) -> float:
    """RP35: above a curve, or beyond a hyperbola."""
    curve, branch = 2 + np.exp(-0.1 * x**2) + (0.2 * x) ** 4, 4.5 / x if x else np.inf
    return norm.sf(min(curve, branch)) if x >= 0 else norm.sf(curve) + norm.cdf(branch)


def wedge_and_disc(x: float) -> float:
    """RP57: between a line and a cubic, or in a disc, which do not meet."""
    square = 4 - (x + 3) ** 2
    disc = norm.cdf(-3 + square**0.5) - norm.cdf(-3 - square**0.5) if square > 0 else 0.0
    return max(0.0, norm.cdf(np.cbrt(x**2 - 3)) - norm.cdf((2 - x) / 8)) + disc


def torque(x2, x3, x4, x5, x6, x7):
    """RP38: what the load is multiplied by."""
    bending = x4**2 - 4 * x5 * x6 * x7**2 + x4 * (x6 + 4 * x5 + 2 * x6 * x7)
    return x2**3 / (2 * x3**3) * bending / (x4 * x5 * (x4 + x6 + 2 * x6 * x7))


def paths(x1, x2, x3, x4):
    """RP60: the largest load that is carried."""
    return np.minimum(x1, np.maximum(2 * np.min([x2, x3, x4], axis=0), np.maximum(x4, np.minimum(x2, x3))))


def axial(of, x1, x2, x3, x4):
    """RP14: beyond the second moment that is left, on either side."""
    left = (x1 * np.pi * x2**3 / 32) ** 2 - (x3 * x4) ** 2 / 16
    root = np.sqrt(np.maximum(left, 0.0))
    return of.sf(root) + of.cdf(-root)


def stress(c, d, e):
    """RP91: the first margin is far from 0."""
    return np.maximum(np.sqrt(c**2 + d**2 - c * d + 3 * e**2), np.abs(d)) / 84_000


BOTH = multivariate_normal([0, 0], [[1, 3**-0.5], [3**-0.5, 1]], abseps=1e-12).cdf([-3, -3])
INDEPENDENTLY = {
    "RP8": lambda: evenly("RP8", 4, lambda of, a, b, c, d, f: of.sf((a + 2 * b + 2 * c + d - 5 * f) / 5)),
    "RP14": lambda: evenly("RP14", 4, axial),
    "RP22": lambda: over(lambda v: norm.sf(2.5 + 0.2 * v**2)),
    "RP24": lambda: over(lambda u: norm.sf((2.5 + 0.00463 * (3 * 2**0.5 * u) ** 4) / (0.2357 * 3 * 2**0.5))),
    "RP25": lambda: over(lambda x: max(0.0, norm.cdf(16 * x - 32) - norm.cdf(x**2 / 8 + 2)), low=2.0),
    "RP28": lambda: over(lambda z: norm.cdf((146.14 / (0.0104 + 0.00156 * z) - 78_064) / 11_710), low=-6.6),
    "RP31": lambda: over(lambda x: norm.sf(2 + 256 * x**4), -0.5, 0.0, 0.5),
    "RP33": lambda: 1e6 * (2 * norm.sf(3) - BOTH),
    "RP35": lambda: over(bars, 0.0, 1.5, 1.7),
    "RP38": lambda: evenly("RP38", 0, lambda of, *x: of.sf(155_900 / torque(*x))),
    "RP53": lambda: over(lambda z: norm.sf(20 * (np.sin(2.5 * (1.5 + z)) + 2) / ((1.5 + z) ** 2 + 4) - 1.5)),
    "RP54": lambda: 1e6 * gamma(20).cdf(8.951),
    # The difference of two uniform variables has the density (2 - |d|) / 4; the roots are those of the quartic.
    "RP55": lambda: 1e6 * sum((b - a) - (b**2 - a**2) / 4 for a, b in ((0.28874062, 0.93704838), (1.33553391, 2.0))),
    "RP57": lambda: over(wedge_and_disc, -5.0, -1.0, -2.0, 2.0),
    "RP60": lambda: evenly("RP60", 4, lambda of, *x: of.sf(paths(*x))),
    "RP63": lambda: 1e6 * quad(lambda s: norm.sf(0.1 * s - 4.5) * chi2.pdf(s, 99), 0, 300, points=[50, 100])[0],
    "RP75": lambda: over(lambda x: norm.sf(3 / abs(x)) if x else 0.0, 0.0),
    "RP77": lambda: over(lambda z: norm.sf((6 - z) / 1.25**0.5) if z <= 1 else norm.sf(4 + z), 1.0),
    "RP89": lambda: over(lambda x: norm.sf(min(8 - x**2, 6 - x / 5)), -3.0, -1.32, 0.0, 1.52, 3.0),
    "RP91": lambda: evenly("RP91", 0, lambda of, _, *x: of.cdf(stress(*x))),
    "RP107": lambda: 1e6 * norm.sf(5),
    "RP110": lambda: 1e6 * (1 - norm.cdf(4) * norm.cdf(5)),
    "RP111": lambda: over(lambda x: 2 * norm.sf(12.5 / abs(x)) if x else 0.0, -3.5, 0.0, 3.5),
    "four branches": lambda: over(lambda v: 1.0 if abs(v) > 3.5 else 2 * norm.sf(3 + 0.2 * v**2), -3.5, 3.5),
    "R - S": lambda: 1e6 * norm.sf(2**0.5),
    "beam in tension": lambda: over(
        lambda z: PROBLEMS["beam in tension"][1][0].cdf((75_000 + 5000 * z) / (100 * np.pi))
    ),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_shares_of_the_literature(name):
    """By one integral, or by a conditional probability over 65,536 points; and roughly by a count."""
    state = limit_state(name)
    assert 1e6 * state.share == pytest.approx(
        INDEPENDENTLY[name](), rel=0.01 if name in ("RP8", "RP14", "RP38") else 1e-3
    )
    z = np.random.default_rng(4).standard_normal((20_000, state.dimensions))
    error = np.sqrt(state.share / z.shape[0])
    assert np.mean(state.response(z) > state.limit) == pytest.approx(state.share, abs=4 * error + 2 / z.shape[0])
