"""Distributions against scipy's, and through the shared statistical harness."""

import itertools
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy import integrate, stats

from campaign.inputs.distributions import DISTRIBUTIONS, Variable
from campaign.inputs.distributions.skewed import Weibull
from campaign.inputs.sampling.inverse_transform import uniforms
from tests.campaign.statistics import check_sample
from tests.each import each

pytestmark = pytest.mark.bits

C60 = {"distribution": "truncated_normal", "mean": 0.07, "std": 0.0175, "lower": 0.01, "upper": 0.13}


def entry(distribution, **keys):
    return {"distribution": distribution, **keys}


# before a cut, as scipy writes them
PARENTS = [
    (entry("normal", mean=-2.0, std=3.0), stats.norm(-2.0, 3.0)),
    (entry("normal", nominal=5.0, tolerance=0.3, cpk=1.25), stats.norm(5.0, 0.08)),
    (entry("normal", dimension="20 +0.05/-0.01", cpk=1.25), stats.norm(20.02, 0.008)),
    # hole 0 to 18, shaft -17 to -6 micrometres: radial 3 to 17.5, and sigma^2 = ((18 / 6)^2 + (11 / 6)^2) / 4
    (entry("normal", fit="12 H7/g6", cpk=1.0), stats.norm(0.01025, 1e-3 * np.hypot(18, 11) / 12)),
    (entry("normal", nominal=5.0, inertia=0.05), stats.norm(5.0, 0.05)),
    (entry("normal", nominal=5.0, inertia=0.05, shift=-0.03), stats.norm(4.97, 0.04)),
    (entry("normal", nominal=5.0, inertia=0.05, sigma_shift=0.75), stats.norm(5.03, 0.04)),
    # Cp 2 with a shift of 1.5 sigma is Cpk 1.5; with 0.04 of a tolerance of 0.1, 0.06 are left for 3 sigma
    (entry("normal", nominal=5.0, tolerance=0.3, cpk=1.5, sigma_shift=1.5), stats.norm(5.075, 0.05)),
    (entry("normal", dimension="20 ±0.1", cpk=1.0, shift=-0.04), stats.norm(19.96, 0.02)),
    (entry("normal", nominal=5.0, tolerance=0.3, cpk=1.0, inflation=1.5), stats.norm(5.0, 0.15)),
    (entry("uniform", lower=2.0, upper=5.0), stats.uniform(2.0, 3.0)),
    (entry("triangular", lower=0.0, mode=1.0, upper=4.0), stats.triang(0.25, 0.0, 4.0)),
    (entry("triangular", lower=0.0, mode=0.0, upper=1.0), stats.triang(0.0, 0.0, 1.0)),
    (entry("triangular", lower=0.0, mode=1.0, upper=1.0), stats.triang(1.0, 0.0, 1.0)),
    # distances in a zone of diameter 0.2: uniform in a disc; two normal ones cut off at a circle
    (entry("position", zone=0.2), stats.triang(1.0, 0.0, 0.1)),
    (entry("position", zone=0.2, std=0.05), stats.truncweibull_min(2.0, 0.0, 2.0**0.5, scale=0.05 * 2.0**0.5)),
    (entry("beta", lower=1.0, upper=3.0, alpha=2.0, beta=5.0), stats.beta(2.0, 5.0, 1.0, 2.0)),
    (entry("beta", lower=1.0, upper=3.0, alpha=0.5, beta=0.7), stats.beta(0.5, 0.7, 1.0, 2.0)),
    (entry("beta", lower=-1.0, upper=1.0, mean=0.2, std=0.25), stats.beta(8.616, 5.744, -1.0, 2.0)),
    (entry("lognormal", log_mean=-2.0, log_std=0.5), stats.lognorm(0.5, 0.0, np.exp(-2.0))),
    (entry("lognormal", mean=3.0, std=1.0, origin=1.0), stats.lognorm(np.log(1.25) ** 0.5, 1.0, 2.0 / 1.25**0.5)),
    (entry("weibull", shape=1.7, scale=2.0, origin=-1.0), stats.weibull_min(1.7, -1.0, 2.0)),
    (entry("weibull", shape=0.6, scale=2.0), stats.weibull_min(0.6, 0.0, 2.0)),
    (entry("exponential", scale=0.3, origin=1.0), stats.expon(1.0, 0.3)),
    (entry("exponential", mean=1.3, origin=1.0), stats.expon(1.0, 0.3)),
    (entry("exponential", std=0.3, origin=1.0), stats.expon(1.0, 0.3)),
    (entry("gamma", shape=2.5, scale=0.4), stats.gamma(2.5, 0.0, 0.4)),
    (entry("gamma", shape=0.4, scale=0.4), stats.gamma(0.4, 0.0, 0.4)),
    (entry("gamma", mean=1.5, std=0.25, origin=0.5), stats.gamma(16.0, 0.5, 0.0625)),
]
# cut: keys of the parent, scipy's parent, bounds, and the keys that say them
CUTS = [
    (entry("truncated_normal", mean=0.07, std=0.0175), stats.norm(0.07, 0.0175), 0.01, 0.13),
    (entry("truncated_normal", mean=0.0, std=1.0), stats.norm(), 3.0, 9.0),
    (entry("truncated_normal", mean=0.0, std=1.0), stats.norm(), -9.0, -3.0),
    (entry("truncated_normal", mean=0.0, std=1.0), stats.norm(), 30.0, 31.0),
    (entry("truncated_normal", nominal=1.0, tolerance=0.3, cpk=1.0), stats.norm(1.0, 0.1), 0.9, 1.3),
    (entry("truncated_normal", dimension="1 ±0.3", cpk=1.0), stats.norm(1.0, 0.1), 0.9, 1.2),
    (entry("normal", mean=0.0, std=1.0), stats.norm(), -0.5, np.inf),
    (entry("triangular", lower=0.0, mode=1.0, upper=4.0), stats.triang(0.25, 0.0, 4.0), 0.5, 3.0),
    (entry("beta", lower=1.0, upper=3.0, alpha=2.0, beta=5.0), stats.beta(2.0, 5.0, 1.0, 2.0), 1.2, 2.5),
    (entry("beta", lower=0.0, upper=1.0, alpha=0.5, beta=0.7), stats.beta(0.5, 0.7), 0.0, 0.1),
    (entry("lognormal", log_mean=-2.0, log_std=0.5), stats.lognorm(0.5, 0.0, np.exp(-2.0)), 0.1, 0.3),
    (entry("lognormal", log_mean=0.0, log_std=1.5), stats.lognorm(1.5), -np.inf, 3.0),
    (entry("weibull", shape=1.7, scale=2.0), stats.weibull_min(1.7, 0.0, 2.0), 3.0, np.inf),
    (entry("exponential", scale=0.3), stats.expon(0.0, 0.3), 1.0, 4.0),
    (entry("gamma", shape=2.5, scale=0.4), stats.gamma(2.5, 0.0, 0.4), 0.2, 8.0),
    (entry("gamma", shape=0.4, scale=0.4), stats.gamma(0.4, 0.0, 0.4), 1.0, np.inf),
]
BATCHED = [
    entry("normal", mean=1.0, std=0.3, batch={"size": 1, "std": 0.4}),
    entry("truncated_normal", mean=0.0, std=1.0, lower=-0.5, upper=2.0, batch={"size": 1, "std": 0.5}),
    entry("uniform", lower=0.0, upper=1.0, batch={"size": 1, "std": 0.1}),
    entry("weibull", shape=2.0, scale=1.0, lower=0.1, batch={"size": 1, "std": 0.1}),
]
DISCRETE = [
    entry("poisson", rate=3.5),
    entry("poisson", rate=0.2, origin=1.0, step=0.5),
    entry("poisson", rate=3.5, step=0.1, lower=0.3, upper=0.7),
    entry("poisson", rate=2.0, lower=30.0),
    entry("poisson", rate=1e5, upper=1e5),
    entry("geometric", probability=0.3),
    entry("geometric", probability=0.3, origin=-1.0, step=2.0, lower=3.0, upper=20.0),
    entry("geometric", probability=1e-4),
    entry("empirical", values=[0.1, 0.3, 0.2, 0.3, 9.0]),
    entry("empirical", values=[0.1, 0.3, 0.2, 0.3, 9.0], lower=0.2, upper=1.0),
]


def make(table):
    return TypeAdapter(Variable).validate_python(table)


def cut(case):
    """Return a parent's keys with its bounds."""
    keys, _, low, high = case
    if keys["distribution"] in ("triangular", "beta"):
        return {**keys, "within": [low, high]}
    return {**keys, **{key: b for key, b in (("lower", low), ("upper", high)) if np.isfinite(b)}}


def name(value):
    return "-".join(map(str, value.values())) if isinstance(value, dict) else ""


SELECTIVE = [entry("selective", fit="12 H7/g6", cpk=1.0, classes=4)]  # test_selective.py
CONTINUOUS = [*(keys for keys, _ in PARENTS), *map(cut, CUTS), *SELECTIVE]
U = np.array([1e-9, 1e-4, 0.01, 0.3, 0.5, 0.9, 0.999, 1.0 - 1e-9])


def test_every_distribution_is_tested():
    """None of the list is left out below."""
    assert {e["distribution"] for e in (*CONTINUOUS, *DISCRETE)} | {"constant"} == set(DISTRIBUTIONS)


@each(("keys", "oracle"), PARENTS)
def test_uncut_is_scipys(keys, oracle):
    """Quantiles, probabilities, densities, moments and ends agree with scipy's."""
    variable, x = make(keys), oracle.ppf(U)
    assert variable.ppf(U) == pytest.approx(x, rel=1e-9, abs=1e-13)
    assert variable.cdf(x) == pytest.approx(oracle.cdf(x), rel=1e-9)
    inside = x[1:-1]
    assert variable.logpdf(inside) == pytest.approx(oracle.logpdf(inside), rel=1e-9, abs=1e-9)
    assert variable.moments() == pytest.approx((oracle.mean(), oracle.std()), rel=1e-9)
    assert variable.support() == pytest.approx(oracle.support())


@each("case", CUTS)
def test_cut_is_the_conditioned_distribution(case):
    """Probabilities are scipy's, conditioned; moments are those of its density, integrated; tails keep their digits."""
    variable, (_, parent, low, high) = make(cut(case)), case
    upper_tail = parent.sf(low) < 0.5
    total = parent.sf(low) - parent.sf(high) if upper_tail else parent.cdf(high) - parent.cdf(low)
    x = parent.isf(parent.sf(low) - U * total) if upper_tail else parent.ppf(parent.cdf(low) + U * total)
    assert variable.ppf(U) == pytest.approx(x, rel=1e-8, abs=1e-12)
    probability = (parent.sf(low) - parent.sf(x) if upper_tail else parent.cdf(x) - parent.cdf(low)) / total
    assert variable.cdf(x) == pytest.approx(probability, rel=1e-9, abs=1e-14)
    assert variable.logpdf(x[1:-1]) == pytest.approx(parent.logpdf(x[1:-1]) - np.log(total), rel=1e-9, abs=1e-9)
    begin, end = max(low, parent.support()[0]), min(high, parent.isf(1e-300))
    assert variable.support() == pytest.approx((begin, min(high, parent.support()[1])))
    breaks = sorted({begin, *np.clip(variable.ppf(U), begin, end), end})

    def expected(f):
        return sum(
            integrate.quad(lambda x: f(x) * parent.pdf(x) / total, a, b, epsabs=0, epsrel=1e-7, limit=200)[0]
            for a, b in itertools.pairwise(breaks)
        )

    mean = expected(lambda x: x)
    assert variable.moments() == pytest.approx((mean, expected(lambda x: (x - mean) ** 2) ** 0.5), rel=1e-6)
    outside = np.array([low - 0.1, high + 0.1])[np.isfinite([low, high])]
    assert (variable.logpdf(outside) == -np.inf).all()


@pytest.mark.parametrize("keys", BATCHED, ids=name)
def test_batches_are_a_mixture(keys):
    """Probability, density and moments of parts of all batches: integrals over the batches' shifts."""
    variable, spread = make(keys), keys["batch"]["std"]
    x = variable.ppf(np.array([0.05, 0.4, 0.8]))

    def over_shifts(f):
        low, high = -6 * spread, 6 * spread
        parts = np.linspace(low, high, 9)
        return sum(
            integrate.quad(lambda d: f(d) * stats.norm.pdf(d, 0, spread), a, b, epsrel=1e-10)[0]
            for a, b in itertools.pairwise(parts)
        )

    alone = make({key: value for key, value in keys.items() if key != "batch"})
    low, high = alone.cut()

    def share(a, b):
        return float(alone.parent().cdf(np.asarray(b)) - alone.parent().cdf(np.asarray(a)))

    for value, cdf in zip(x, variable.cdf(x), strict=True):
        direct = over_shifts(lambda d, v=value: share(low - d, v - d) / share(low - d, high - d))
        assert cdf == pytest.approx(direct, abs=1e-4)
    grid = np.linspace(*variable.ends(), 20_001)
    density = np.exp(variable.logpdf(grid))
    mean = np.trapezoid(grid * density, grid)
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=1e-4)
    assert variable.moments()[0] == pytest.approx(mean, rel=1e-3)
    assert variable.moments()[1] == pytest.approx(np.trapezoid((grid - mean) ** 2 * density, grid) ** 0.5, rel=1e-3)


def test_variance_of_uncut_batches_is_the_sum():
    """Without bounds the variances within and between batches add up."""
    mean, std = make(BATCHED[0]).moments()
    assert (mean, std) == pytest.approx((1.0, 0.5), rel=1e-6)
    assert make(BATCHED[0]).ends() == pytest.approx(stats.norm(1.0, 0.5).ppf([1e-6, 1 - 1e-6]), abs=1e-4)


def test_bounds_hold_in_every_batch():
    """A batch shifted far is cut as any other: its values stay within the bounds and still spread."""
    variable, shift = make(BATCHED[1]), np.repeat([-3.0, 0.0, 3.0], 4000)
    x = variable.ppf(uniforms(1, "x", 0, 12_000), shift)
    assert -0.5 <= x.min() < x.max() <= 2.0
    shifted = [make({**BATCHED[1], "mean": d, "batch": {"size": 1, "std": 1e-9}}) for d in (-3.0, 0.0, 3.0)]
    for values, oracle in zip(np.split(x, 3), shifted, strict=True):
        check_sample(values, oracle)


@each("keys", [*CONTINUOUS, *DISCRETE])
def test_samples_follow_the_distribution(keys):
    """Bounds, moments and shape of 20,000 draws."""
    check_sample(make(keys).ppf(uniforms(11, "x", 0, 20_000)), make(keys))


@each("keys", [*CONTINUOUS, *BATCHED, *DISCRETE])
def test_bits_depend_on_the_own_number_alone(keys):
    """Alone, in the middle of others, or at the end of an odd number of them: the same bits."""
    variable, u = make(keys), uniforms(5, "x", 0, 259)
    shift = {"shift": 0.02 * np.arange(-129.0, 130.0) / 129.0} if "batch" in keys else {}

    def part(begin, end):
        return variable.ppf(u[begin:end], **{key: d[begin:end] for key, d in shift.items()})

    whole = part(0, 259)
    for length in (1, 2, 3, 7, 8, 17, 64):
        pieces = [part(begin, min(begin + length, 259)) for begin in range(0, 259, length)]
        assert np.concatenate(pieces).tobytes() == whole.tobytes()


@each("keys", [*CONTINUOUS, *DISCRETE])
@settings(deadline=None, max_examples=12)
@given(st.floats(2.0**-40, 1.0 - 2.0**-40), st.floats(2.0**-40, 1.0 - 2.0**-40))
def test_quantiles_invert_probabilities(keys, u, v):
    """No value below the quantile has the probability, the quantile has; quantiles rise with probability."""
    variable = make(keys)
    x, y = variable.ppf(np.array([u, v]))
    low, high = variable.support()
    assert low <= x <= high
    assert (x <= y) if u <= v else (x >= y)
    if variable.density_points(3):
        # as near as doubles beside x can say: where the density is high, or x large, neighbours differ by more
        slack = (
            1e-9 + 8 * np.spacing(abs(x)) * float(np.exp(variable.logpdf(np.array([x]))[0])) if low < x < high else 1e-6
        )
        assert float(variable.cdf(np.array([x]))[0]) == pytest.approx(u, abs=min(slack, 1.0))
    else:
        assert float(variable.cdf(np.array([x]))[0]) >= u * (1 - 1e-12)
        assert x == low or float(variable.cdf(np.array([np.nextafter(x, -np.inf)]))[0]) < u * (1 + 1e-12)


@each("keys", [keys for keys in CONTINUOUS if 0.5 not in keys.values()])
def test_density_integrates_to_one(keys):
    """The curve that is drawn is a density: over the ends it holds all but the 1e-6 tails."""
    x, y = np.array(make(keys).density_points(40_001)).T
    singular = {keys.get("shape"), keys.get("alpha")} & {0.4, 0.5, 0.6}
    assert np.trapezoid(y, x) == pytest.approx(1.0, abs=0.05 if singular else 1e-4)


@pytest.mark.parametrize(
    ("keys", "oracle"),
    [
        (entry("poisson", rate=3.5, origin=1.0, step=0.5), stats.poisson(3.5)),
        (entry("poisson", rate=1e4, origin=1.0, step=0.5), stats.poisson(1e4)),
        (entry("geometric", probability=0.3, origin=1.0, step=0.5), stats.geom(0.3)),
    ],
    ids=name,
)
def test_counts_are_scipys(keys, oracle):
    """Counts, scaled, have scipy's probabilities and moments; cut, those conditioned on the bounds."""
    variable, k = make(keys), oracle.ppf(U)
    assert variable.ppf(U) == pytest.approx(1.0 + 0.5 * k, abs=0)
    x = 1.0 + 0.5 * k
    assert variable.cdf(x) == pytest.approx(oracle.cdf(k), rel=1e-11)
    assert variable.logpdf(x) == pytest.approx(oracle.logpmf(k), rel=1e-9)
    assert variable.logpdf(x + 0.1).tolist() == [-np.inf] * len(x)
    assert variable.moments() == pytest.approx((1.0 + 0.5 * oracle.mean(), 0.5 * oracle.std()), rel=1e-9)
    low, high = oracle.ppf(0.2), oracle.ppf(0.9)
    cut_off = make({**keys, "lower": 1.0 + 0.5 * low, "upper": 1.0 + 0.5 * high})
    conditioned = oracle.logpmf([low, high]) - np.log(oracle.cdf(high) - oracle.cdf(low - 1))
    assert cut_off.logpdf(np.array([1.0 + 0.5 * low, 1.0 + 0.5 * high])) == pytest.approx(conditioned, rel=1e-9)
    assert cut_off.support() == (1.0 + 0.5 * low, 1.0 + 0.5 * high)


def test_bounds_of_counts_are_kept_by_decimals():
    """3 times 0.1 is above 0.3 in doubles; a bound of 0.3 still keeps the third count, and no value exceeds it."""
    variable = make(entry("poisson", rate=3.0, step=0.1, lower=0.1, upper=0.3))
    assert sorted(set(variable.ppf(uniforms(1, "x", 0, 1000)).tolist())) == [0.1, 0.2, 0.3]


def test_empirical_draws_the_values_again():
    """Each value as often as it was measured, and no other."""
    variable = make(DISCRETE[-2])
    assert variable.ppf((np.arange(5) + 0.5) / 5).tolist() == [0.1, 0.2, 0.3, 0.3, 9.0]
    assert variable.moments() == pytest.approx((np.mean([0.1, 0.3, 0.2, 0.3, 9.0]), np.std([0.1, 0.3, 0.2, 0.3, 9.0])))
    assert make(DISCRETE[-1]).support() == (0.2, 0.3)


def test_default_is_truncated_normal():
    """A variable that names no distribution is a truncated normal, and the same campaign as one that says so."""
    keys = {key: value for key, value in C60.items() if key != "distribution"}
    assert make(keys) == make(C60)
    assert make(keys).model_dump(exclude_none=True) == make(C60).model_dump(exclude_none=True)
    with pytest.raises(ValidationError, match="lower"):
        make({"mean": 0.0, "std": 1.0})


def test_models_travel():
    """A variable that has computed its tables is still equal to a fresh one, and can be sent to another process."""
    for keys in (C60, DISCRETE[0]):
        used, fresh = make(keys), make(keys)
        used.ppf(U)
        assert used == fresh == pickle.loads(pickle.dumps(used))


def test_unbounded_ends_are_quantiles():
    """A normal variable is tried on the mechanism where one in a million lies beyond."""
    low, high = make({"distribution": "normal", "mean": 1.0, "std": 0.1}).ends()
    assert (low, high) == pytest.approx((1.0 - 0.47534, 1.0 + 0.47534), abs=1e-5)
    assert make(C60).ends() == (0.01, 0.13)


@pytest.mark.parametrize(
    "keys",
    [
        {"distribution": "lognormal", "mean": 3.0, "std": 0.5, "origin": 2.0},
        {"distribution": "weibull", "shape": 0.8, "scale": 1.0, "origin": 2.0},
        {"distribution": "gamma", "shape": 4.0, "scale": 0.5, "origin": 2.0, "lower": 1.0},
        {"distribution": "exponential", "scale": 1.0, "origin": 2.0, "lower": 2.0},
    ],
)
def test_the_origin_is_never_drawn_and_no_end(keys):
    """A stiffness > 0 may be lognormal: it is tried where one in a million lies below, and not at 0."""
    variable = make(keys)
    low, _ = variable.tried()
    assert low > variable.ends()[0] == 2.0
    assert float(variable.cdf(np.array([low]))[0]) == pytest.approx(1e-6)
    assert make({**keys, "lower": 2.5}).tried()[0] == 2.5


def test_constant():
    """A constant is drawn as itself and has no density."""
    variable = make({"distribution": "constant", "value": 3.0})
    assert variable.ppf(U[:3]).tolist() == [3.0, 3.0, 3.0]
    assert (variable.moments(), variable.ends(), variable.density_points()) == ((3.0, 0.0), (3.0, 3.0), ())
    assert variable.cdf(np.array([2.9, 3.0])).tolist() == [0.0, 1.0]
    assert variable.logpdf(np.array([2.9, 3.0])).tolist() == [-np.inf, 0.0]


IMPOSSIBLE = [
    (entry("normal"), "give mean and std or nominal and tolerance and cpk"),
    (entry("normal", mean=1.0), "mean is given without std"),
    (entry("normal", mean=1.0, std=0.1, cpk=1.0), "mean and cpk cannot be given together"),
    (entry("normal", nominal=1.0, tolerance=0.1), "nominal is given without cpk"),
    (entry("normal", mean=1.0, std=0.0), "greater than 0"),
    (entry("normal", mean=1.0, std=0.1, shift=0.1), "shift belongs to a tolerance or an inertia"),
    (entry("normal", nominal=1.0, inertia=0.1, shift=0.1), "shift = 0.1: allowed: less than inertia = 0.1"),
    (entry("normal", nominal=1.0, tolerance=0.1, cpk=1.0, shift=-0.2), "less than half the tolerance, 0.1"),
    (entry("normal", nominal=1.0, inertia=0.1, shift=0.01, sigma_shift=1.0), "give one of them"),
    (entry("normal", nominal=1.0, inertia=0.1, cpk=1.0), "cannot be given together"),
    (entry("normal", fit="12 H7/g6", cpk=1.0, sigma_shift=1.5), "a fit has two"),
    (entry("normal", nominal=1.0, inertia=0.1, inflation=0.5), "greater than or equal to 1"),
    (entry("normal", mean=1.0, std=0.1, lower=2.0, upper=1.0), "lower = 2 is not below upper = 1"),
    (entry("normal", nominal=3.0, tolerance=0.1, cpk=1.0, upper=2.0), "nominal = 3 lies outside of"),
    (
        entry("normal", mean=0.0, std=1.0, lower=40.0),
        "holds a share of 0 of normal, mean 0, sd 1: nothing can be drawn",
    ),
    (entry("uniform", lower=1.0, upper=1.0), "lower = 1 is not below upper = 1"),
    (entry("uniform", lower=0.0, upper=1.0, batch={"size": 9, "std": 0.2}), "reduce batch.std"),
    (entry("uniform", lower=0.0, upper=1.0, batch={"size": 0, "std": 0.1}), "batch.size"),
    (entry("triangular", lower=0.0, upper=1.0, mode=2.0), "mode = 2 lies outside"),
    (entry("triangular", lower=0.0, upper=1.0, mode=0.5, within=[0.2, 1.2]), "reaches beyond"),
    (entry("beta", lower=0.0, upper=1.0, mean=0.5, std=0.5), "std = 0.5: too large for mean 0.5 .* below 0.5"),
    (entry("beta", lower=0.0, upper=1.0, mean=1.0, std=0.1), "mean = 1 lies outside"),
    (entry("beta", lower=0.0, upper=1.0, mean=0.5, beta=2.0), "cannot be given together"),
    (entry("lognormal", mean=-1.0, std=0.1), "mean = -1 is not above origin = 0"),
    (entry("lognormal", mean=1.0, std=0.1, upper=-1.0), "nothing can be drawn"),
    (entry("weibull", mean=1.0, std=1e-4), "std = 0.0001 is 0.0001 times the mean .* 0.00128 to 15.8"),
    (entry("exponential", mean=2.0, scale=2.0), "cannot be given together"),
    (entry("gamma", shape=2.0), "shape is given without scale"),
    (entry("poisson", rate=0.0), "greater than 0"),
    (entry("poisson", rate=2.0, step=0.5, lower=0.6, upper=0.9), "no value origin"),
    (entry("geometric", probability=1.0), "less than 1"),
    (entry("geometric", probability=0.5, upper=0.5), "no value origin"),
    (entry("empirical"), "its values are missing; give values, or file and column"),
    (entry("empirical", values=[1.0], file="x.csv", column="a"), "values and file cannot be given together"),
    (entry("empirical", file="x.csv"), "are only valid together"),
    (entry("empirical", values=[]), "at least 1"),
    (entry("empirical", values=[1.0, float("nan")]), "finite"),
    (entry("empirical", values=[1.0, 2.0], lower=3.0), "none of the 2 values, 1 to 2, lies in"),
]


@each(("keys", "said"), IMPOSSIBLE)
def test_impossible_is_refused(keys, said):
    """What cannot be drawn is refused with key, value and remedy."""
    with pytest.raises(ValidationError, match=said):
        make(keys)


ABSURD = [
    {"distribution": "normal", "mean": 0.0, "std": 7e99},
    {"distribution": "lognormal", "log_mean": 0.0, "log_std": 70.0},
    {"distribution": "lognormal", "mean": 1e-99, "std": 1e100},
    {"distribution": "weibull", "shape": 0.007, "scale": 0.35},
    {"distribution": "gamma", "mean": 1e50, "std": 1e-99},
    {"distribution": "beta", "mean": 130.0, "std": 1e-99, "lower": -3.0, "upper": 1e100},
    {"distribution": "poisson", "rate": 1.0, "step": 1e-100, "lower": 1e100},
    {"distribution": "constant", "value": 1e101},
]


@each("table", ABSURD)
def test_a_distribution_of_absurd_sizes_is_refused(table):
    """It gave infinite values, or an overflow where it was used."""
    with pytest.raises(ValidationError, match="allowed"):
        TypeAdapter(Variable).validate_python(table)


EXTREME = [
    {"distribution": "exponential", "std": 0.013, "lower": 2.0},
    {"distribution": "weibull", "shape": 7e7, "scale": 1e99},
    {"distribution": "normal", "mean": 7e-6, "std": 2e-96, "lower": 0.0, "upper": 1e16},
    {"distribution": "lognormal", "log_mean": 0.0, "log_std": 70.0, "upper": 1.0},
    {"distribution": "poisson", "rate": 0.5, "step": 1e98, "lower": 2.1},
]


@pytest.mark.parametrize("table", EXTREME, ids=lambda table: "-".join(map(str, table.values())))
def test_extreme_parameters_give_numbers(table):
    """Moments of a far tail were not numbers, and others warned."""
    variable = TypeAdapter(Variable).validate_python(table)
    low, high = variable.support()
    x = variable.ppf(np.array([2.0**-54, 0.5, 1.0 - 2.0**-53]))
    assert (low <= x).all()
    assert (x <= high).all()
    assert np.isfinite([*x, *variable.moments(), *variable.ends()]).all()
    assert not np.isnan(variable.logpdf(np.array([-1e100, *x, 1e100]))).any()


def test_the_deviation_of_a_narrow_weibull():
    """Where the series begins, it agrees with the formula; far beyond, with its limit pi / (sqrt(6) shape)."""
    for shape, share in ((1.01e4, 1e-6), (1e8, 1e-7)):
        of_series = Weibull(distribution="weibull", shape=shape, scale=1.0)
        mean, std = of_series.moments()
        exact = np.pi / np.sqrt(6.0) / shape * (1.0 - 1.2020569 / 1.6449341 / shape)
        assert std / mean == pytest.approx(exact, rel=share)


@pytest.mark.parametrize("name", ["lognormal", "gamma", "weibull"])
def test_a_distribution_is_described_as_it_was_asked_for(name):
    """Who gives mean and std reads mean and sd, and not the parameters that follow from them."""
    made = make(entry(name, mean=0.05, std=0.01))
    assert made.text().lower().startswith(f"{name}, mean 0.05, sd 0.01")


@each("std", [None, 0.02, 0.05])
def test_a_position_is_a_place_in_its_zone(std):
    """With a uniform direction, x and y are those of a million places: uniform in the disc, or normal and in it."""
    rng, n = np.random.default_rng(4), 1_000_000
    variable = make(entry("position", zone=0.2, **({} if std is None else {"std": std})))
    x, y = rng.uniform(-0.1, 0.1, (2, n)) if std is None else std * rng.standard_normal((2, n))
    inside = np.hypot(x, y) <= 0.1
    distance, angle = variable.ppf(rng.random(n)), 2 * np.pi * rng.random(n)
    along, across = distance * np.cos(angle), distance * np.sin(angle)
    count = np.count_nonzero(inside)
    for power in (2, 4):
        drawn, expected = along**power, x[inside] ** power
        error = np.hypot(drawn.std() / np.sqrt(n), expected.std() / np.sqrt(count))
        assert abs(drawn.mean() - expected.mean()) < 4 * error
    assert abs(np.corrcoef(along, across)[0, 1]) < 4 / np.sqrt(n)
    for u in (0.1, 0.5, 0.9):
        below = np.mean(np.hypot(x, y)[inside] <= variable.ppf(np.array([u]))[0])
        assert abs(below - u) < 4 * np.sqrt(u * (1 - u) / count)


def test_a_shifted_process_has_the_stated_capability_and_inertia():
    """By their definitions: Cpk from mean and sigma, and the root mean square distance from the target."""
    rng = np.random.default_rng(5)
    for off in ({}, {"shift": 0.02}, {"sigma_shift": -1.5}):
        process = make(entry("normal", nominal=3.0, tolerance=0.1, cpk=1.33, **off))
        mean, std = process.moments()
        assert min(3.1 - mean, mean - 2.9) / (3 * std) == pytest.approx(1.33, rel=1e-12)
        inertial = make(entry("normal", nominal=3.0, inertia=0.03, **off))
        x = inertial.ppf(rng.random(1_000_000))
        assert np.sqrt(np.mean((x - 3.0) ** 2)) == pytest.approx(0.03, rel=4e-3)


def test_a_drawing_says_the_bounds():
    """Where a distribution has to have some, and none are given."""
    adapter = TypeAdapter(Variable)
    fit = adapter.validate_python({"distribution": "truncated_normal", "fit": "12 H7/g6", "cpk": 1.33})
    assert fit.support() == pytest.approx((0.003, 0.0175), abs=1e-12)
    assert "12 H7/g6" in fit.text()
    assert adapter.validate_python(fit.model_dump(exclude_none=True)) == fit
    given = {"distribution": "truncated_normal", "dimension": "12 ±0.1", "cpk": 1.0, "upper": 12.05}
    assert adapter.validate_python(given).support() == (11.9, 12.05)
    for wrong in (
        {"dimension": "12 H99", "cpk": 1.0},
        {"dimension": "12 H7"},
        {"fit": "12 H7/g6", "dimension": "12 H7", "cpk": 1.0},
        {"fit": "12 H7/g6", "mean": 1.0, "cpk": 1.0},
        {"fit": 12, "cpk": 1.0},
        {"nominal": 12.0, "tolerance": 0.1, "cpk": 1.0},
    ):
        with pytest.raises(ValidationError):
            adapter.validate_python({"distribution": "truncated_normal", **wrong})
