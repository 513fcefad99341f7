"""Closed-form distributions against scipy's, and against themselves."""

import numpy as np
import pytest
from scipy import stats

from reporting.distributions import forms as shapes
from reporting.distributions.families import FAMILIES, Scaled
from tests.each import each

P = np.array([1e-6, 0.00135, 0.1, 0.5, 0.9, 0.99865, 1 - 1e-6])


@each(
    ("shape", "known"),
    [
        (shapes.normal(1.0, 2.0), stats.norm(1, 2)),
        (shapes.lognormal(-0.5, 0.3, 0.4), stats.lognorm(0.4, loc=-0.5, scale=np.exp(0.3))),
        (shapes.weibull(0.0, 1.7, 2.0), stats.weibull_min(1.7, scale=2)),
        (shapes.gamma(0.0, 3.2, 0.5), stats.gamma(3.2, scale=0.5)),
        (shapes.beta(2.0, 5.0), stats.beta(2, 5)),
        (shapes.beta(2.0, 5.0, 1.0, 4.0), stats.beta(2, 5, 1, 3)),
        (shapes.uniform(1.0, 4.0), stats.uniform(1, 3)),
        (shapes.triangular(1.0, 2.0, 4.0), stats.triang(1 / 3, 1, 3)),
        (shapes.exponential(-1.0, 2.0), stats.expon(-1, 2)),
        (shapes.log_logistic(0.0, 0.7, 0.3), stats.fisk(1 / 0.3, scale=np.exp(0.7))),
        (shapes.folded_normal(0.8, 0.6), stats.foldnorm(0.8 / 0.6, scale=0.6)),
        (shapes.folded_normal(0.0, 0.6), stats.halfnorm(scale=0.6)),
        (shapes.logistic(1.0, 0.3), stats.logistic(1, 0.3)),
        (shapes.laplace(1.0, 0.3), stats.laplace(1, 0.3)),
        (shapes.student_t(1.0, 0.3, 4.5), stats.t(4.5, 1, 0.3)),
        (shapes.largest_extreme(1.0, 0.3), stats.gumbel_r(1, 0.3)),
        (shapes.johnson_su(0.5, 1.5, 0.2, 2.0), stats.johnsonsu(0.5, 1.5, 0.2, 2.0)),
        (shapes.johnson_sb(0.5, 1.5, -1.0, 3.0), stats.johnsonsb(0.5, 1.5, -1.0, 4.0)),
    ],
)
def test_shapes_are_scipys(shape, known) -> None:
    z = known.ppf(P)
    assert shape.ppf(P) == pytest.approx(z, rel=1e-9, abs=1e-9)
    assert shape.logpdf(z) == pytest.approx(known.logpdf(z), rel=1e-8, abs=1e-8)
    assert shape.cdf(z) == pytest.approx(P, rel=1e-7)
    assert shape.sf(z) == pytest.approx(known.sf(z), rel=1e-6)
    assert shape.isf(known.sf(z)) == pytest.approx(z, rel=1e-8, abs=1e-8)
    beyond = np.array([known.support()[0] - 9.0, known.support()[1] + 9.0])
    assert shape.cdf(beyond).tolist() == [0.0, 1.0]
    assert shape.sf(beyond).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("power", [-0.7, 0.0, 0.5, 1.0, 2.5])
def test_power_transforms_are_scipys(power: float) -> None:
    """The log-likelihood of scipy's transform is that of the density, less constants of the moments."""
    x = np.random.default_rng(2).gamma(9.0, size=200) / 9
    y = stats.boxcox(x, power)
    shape = shapes.box_cox_normal(power, y.mean(), y.std())
    constant = -100 * (np.log(2 * np.pi) + 1)
    assert shape.logpdf(x).sum() == pytest.approx(stats.boxcox_llf(power, x) + constant, rel=1e-9)
    assert stats.norm.cdf((y - y.mean()) / y.std()) == pytest.approx(shape.cdf(x), rel=1e-9)
    x = x - 1
    y = stats.yeojohnson(x, power)
    shape = shapes.yeo_johnson_normal(power, y.mean(), y.std())
    assert shape.logpdf(x).sum() == pytest.approx(stats.yeojohnson_llf(power, x) + constant, rel=1e-9)
    inner = P[1:-1]
    if power == 0.5:
        assert shape.cdf(shape.ppf(inner)) == pytest.approx(inner, rel=1e-9)


def test_a_mixture_is_the_sum_of_its_parts() -> None:
    shape = shapes.two_normals(0.3, -1.0, 0.5, 2.0, 1.0)
    z = np.linspace(-3, 5, 9)
    one, two = stats.norm(-1, 0.5), stats.norm(2, 1)
    assert np.exp(shape.logpdf(z)) == pytest.approx(0.3 * one.pdf(z) + 0.7 * two.pdf(z), rel=1e-12)
    assert shape.cdf(z) == pytest.approx(0.3 * one.cdf(z) + 0.7 * two.cdf(z), rel=1e-12)
    assert shape.sf(z) == pytest.approx(0.3 * one.sf(z) + 0.7 * two.sf(z), rel=1e-12)
    assert shape.cdf(shape.ppf(P)) == pytest.approx(P, rel=1e-9)


@pytest.mark.parametrize("scale", [2.0, -2.0])
def test_a_scaled_distribution_is_that_of_the_scaled_values(scale: float) -> None:
    """Mirrored where the scale is negative: the smallest extreme value is the mirrored largest."""
    found = Scaled(shapes.largest_extreme(0.0, 1.0), 5.0, scale)
    known = stats.gumbel_r(5, 2) if scale > 0 else stats.gumbel_l(5, 2)
    x = np.linspace(-3, 12, 7)
    assert found.logpdf(x) == pytest.approx(known.logpdf(x), rel=1e-9)
    assert found.cdf(x) == pytest.approx(known.cdf(x), rel=1e-9)
    assert found.sf(x) == pytest.approx(known.sf(x), rel=1e-9)
    assert found.ppf(P) == pytest.approx(known.ppf(P), rel=1e-9)


@each("name", list(FAMILIES))
def test_outside_its_range_a_distribution_has_no_value(name: str) -> None:
    """A limit may lie anywhere: shares there are 0 or 1, never NaN."""
    family = FAMILIES[name]
    found = Scaled(family.build((0.2,) * len(family.parameters)), 0.0, 1.0)
    assert found.cdf([-1e6, 1e6]) == pytest.approx([0, 1], abs=0.02)
    assert found.cdf([-1e6, 1e6]) + found.sf([-1e6, 1e6]) == pytest.approx([1, 1])


@each("family", FAMILIES.values())
def test_many_distributions_at_once_are_the_same_one_by_one(family) -> None:
    """Parameters as columns: what a search and the intervals evaluate."""
    rng = np.random.default_rng(5)
    thetas = rng.normal(0, 0.3, (4, len(family.parameters)))
    z = np.array([0.2, 0.4, 0.7])
    together = family.build(list(thetas.T[:, :, None]))
    for i, theta in enumerate(thetas):
        alone = family.build(tuple(theta))
        with np.errstate(all="ignore"):
            assert together.logpdf(z)[i] == pytest.approx(alone.logpdf(z), rel=1e-12)
            assert together.cdf(z)[i] == pytest.approx(alone.cdf(z), rel=1e-12)
            assert together.sf(z)[i] == pytest.approx(alone.sf(z), rel=1e-12)
            assert together.ppf(P)[i] == pytest.approx(alone.ppf(P), rel=1e-12, nan_ok=True)
