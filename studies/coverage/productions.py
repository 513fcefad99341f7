"""Productions with known true values: a response of some shape, with or without lots, and its page in the report.

Every response is ``value(w)``, an increasing function of a standard normal score w, so a share below a value is a
normal probability, and moments are integrals over scores. The score is a weighted sum of independent normal variables,
so the true first-order indices, and the true values for changed variables, are integrals over scores as well. A draw is
a synthetic campaign in the form that the report takes: samples and request.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats
from scipy.interpolate import PchipInterpolator

from engine.arrays import Array
from reporting import ReportSpec, ResponseSpec, VariableSpec
from reporting.analysis import Analysis, analyse
from reporting.samples import Samples
from reporting.trust.checks import Check

SIZES = (50, 500, 5000)
# Shares of the score's variance due to the variables X1, X2, ...
SHARES = (0.5, 0.3, 0.15, 0.05, 0.0)
VARIABLES = tuple(f"X{i + 1}" for i in range(len(SHARES)))
_SCORES = np.linspace(-13.0, 13.0, 5201)
_DENSITY = stats.norm.pdf(_SCORES) * (_SCORES[1] - _SCORES[0])

RESPONSE, BATCH = "y", "production batch"
CONFIDENCE = 0.95

Curve = Callable[[Array], Array]


def _of(distribution: stats.rv_continuous) -> Curve:
    """Return the function from normal scores to values of a distribution, computed from the nearer tail."""

    def value(score: Array) -> Array:
        lower = score < 0
        found = np.empty_like(score)
        found[lower] = distribution.ppf(stats.norm.cdf(score[lower]))
        found[~lower] = distribution.isf(stats.norm.sf(score[~lower]))
        return found

    return value


def _mirrored(share_below: Curve, farthest: float) -> Curve:
    """Return the function from scores to values of a symmetric distribution, from its lower half up to `farthest`."""
    # The lower half only, which is mirrored: shares near 1 have no digits left for the upper tail.
    x = np.linspace(-farthest, 0.0, 4001)
    lower = stats.norm.ppf(share_below(x))
    interpolated = PchipInterpolator([*lower, *-lower[-2::-1]], [*x, *-x[-2::-1]])
    return lambda w: np.asarray(interpolated(w))


def _contaminated(share: float) -> Curve:
    """Return the curve of a normal distribution in which this share of the values is five times as wide."""
    return _mirrored(lambda x: (1 - share) * stats.norm.cdf(x) + share * stats.norm.cdf(x / 5), 70.0)


CURVES: dict[str, Curve] = {
    "normal": lambda w: w,
    "lognormal": lambda w: np.exp(0.5 * w),
    "gamma": _of(stats.gamma(16)),
    "t5": _of(stats.t(5)),
    "uniform": _of(stats.uniform()),
    # two normal distributions, 4 sigmas apart
    "bimodal": _mirrored(lambda x: stats.norm.cdf(x[:, None], (-2.0, 2.0)).mean(axis=1), 25.0),
    "0.3 % five times as wide": _contaminated(0.003),
    "1 % five times as wide": _contaminated(0.01),
    "normal cut at 2 sigmas": _of(stats.truncnorm(-2, 2)),
    "Gumbel": _of(stats.gumbel_r()),
    "t3": _of(stats.t(3)),
}


@dataclass(frozen=True)
class Production:
    """A production of values."""

    name: str  # column of the table
    shape: str  # key of `CURVES`
    lots: int = 0  # 0 for independent values
    between: float = 1.0  # sigma of the shifts of lots, relative to sigma within a lot
    growth: float = 1.0  # size of a lot relative to the previous lot
    # increase of the response if the first variable is above 1; then only first-order indices are known
    jump: float = 0.0

    @property
    def share_between(self) -> float:
        """Share of the score's variance that lies between lots."""
        return self.between**2 / (1 + self.between**2) if self.lots else 0.0

    def lot_of(self, n: int) -> np.ndarray | None:
        """Return the lot of each of n values in the order of production; None without lots."""
        if not self.lots:
            return None
        sizes = self.growth ** np.arange(self.lots)
        ends = np.round(n * np.cumsum(sizes) / sizes.sum())
        return np.asarray(np.searchsorted(ends, np.arange(n), side="right"))

    def variables(self, n: int, rng: np.random.Generator, lot: np.ndarray | None = None) -> Array:
        """Return n draws of the normal variables, shape (n, variables); values of a lot share a shift."""
        lot = self.lot_of(n) if lot is None else lot
        own = rng.standard_normal((n, len(SHARES)))
        if lot is None:
            return own
        shift = self.between * rng.standard_normal((int(lot[-1]) + 1, len(SHARES)))
        return np.asarray((own + shift[lot]) / np.hypot(1.0, self.between))

    def values(self, variables: Array) -> Array:
        """Return the response for draws of the variables."""
        return CURVES[self.shape](variables @ np.sqrt(SHARES)) + self.jump * (variables[:, 0] > 1)

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return n values of the response."""
        return self.values(self.variables(n, rng))


SHAPES = tuple(Production(shape, shape) for shape in list(CURVES)[:6])
# Shapes that mislead verdicts: a small second population, an end, a skew, a heavy tail.
JUDGED_SHAPES = tuple(Production(shape, shape) for shape in list(CURVES)[6:])
JUMPS = (Production("small jump", "normal", jump=1.5), Production("large jump", "normal", jump=6.0))
LOTS = (
    Production("20 lots", "normal", 20),
    Production("20 lots, 0.3", "normal", 20, between=0.3),
    Production("20 unequal lots", "normal", 20, growth=1.15),
    Production("5 lots", "normal", 5),
    Production("1 lot", "normal", 1),
    Production("20 lots, lognormal", "lognormal", 20),
)
# Productions that are sampled until a stopping rule ends them.
LOTS_IN_TURN = (
    *(Production(f"{shape}, in turn", shape) for shape in ("normal", "lognormal", "t5")),
    Production("lots of 50", "normal", 100),
    Production("lots of 50, 0.3", "normal", 100, between=0.3),
    Production("lots of 500, 0.3", "normal", 10, between=0.3),
)


@dataclass(frozen=True)
class Truth:
    """True values of a production whose score has any sigma."""

    mean: float
    std: float
    median: float
    low: float  # quantile at 0.135 %
    high: float  # quantile at 99.865 %
    below: float  # share out of limits [ppm]
    above: float  # share out of limits [ppm]
    lsl: float
    usl: float
    target: float

    @property
    def cpl(self) -> float:
        """Lower index."""
        return (self.mean - self.lsl) / (3 * self.std)

    @property
    def cpu(self) -> float:
        """Upper index."""
        return (self.usl - self.mean) / (3 * self.std)

    @property
    def cpk(self) -> float:
        """Smaller one of `cpl` and `cpu`."""
        return min(self.cpl, self.cpu)

    @property
    def cp(self) -> float:
        """Potential index."""
        return (self.usl - self.lsl) / (6 * self.std)

    @property
    def ppm(self) -> float:
        """Share out of limits on both sides."""
        return self.below + self.above


# Limits as scores: 233 ppm below, 1,350 ppm above.
LIMITS = (-3.5, 3.0)


@lru_cache(maxsize=256)
def moments(shape: str, spread: float = 1.0) -> tuple[float, float]:
    """Return mean and sigma of a shape whose score has a sigma of ``spread``."""
    values = CURVES[shape](spread * _SCORES)
    mean = float(values @ _DENSITY)
    return mean, float(np.sqrt((values - mean) ** 2 @ _DENSITY))


@lru_cache(maxsize=256)
def truth(shape: str, spread: float = 1.0, limits: tuple[float, float] = LIMITS) -> Truth:
    """Return the true values of a shape whose score has a sigma of ``spread``, with limits at scores of sigma 1."""
    mean, std = moments(shape, spread)
    usual_mean, usual_std = moments(shape)
    lsl, low, median, high, usl = CURVES[shape](np.array([limits[0], -3.0 * spread, 0.0, 3.0 * spread, limits[1]]))
    return Truth(
        mean=mean,
        std=std,
        median=float(median),
        low=float(low),
        high=float(high),
        below=1e6 * float(stats.norm.cdf(limits[0] / spread)),
        above=1e6 * float(stats.norm.sf(limits[1] / spread)),
        lsl=float(lsl),
        usl=float(usl),
        target=usual_mean + 0.3 * usual_std,
    )


def share_below(shape: str, value: float) -> float:
    """Return the share of a shape's values below a value."""
    return float(stats.norm.cdf(np.interp(value, CURVES[shape](_SCORES), _SCORES, -np.inf, np.inf)))


def first_order(production: Production) -> tuple[float, ...]:
    """Return the share of the response's variance that each variable explains alone."""
    if not production.jump:
        return tuple(explained(production.shape, share) for share in SHARES)
    jumped = stats.norm.sf(1)
    of_first = SHARES[0] + 2 * production.jump * SHARES[0] ** 0.5 * stats.norm.pdf(1)
    of_first += production.jump**2 * jumped * (1 - jumped)
    total = of_first + 1 - SHARES[0]
    return tuple(float(part) / total for part in (of_first, *SHARES[1:]))


@lru_cache(maxsize=64)
def explained(shape: str, share: float) -> float:
    """Return the share of a shape's variance explained by a part of its score with the share `share` of variance."""
    _, std = moments(shape)
    # Coarser, because the integral is over pairs of scores.
    scores, density = _SCORES[::10], 10 * _DENSITY[::10]
    both = np.sqrt(share) * scores[:, None] + np.sqrt(1 - share) * scores[None, :]
    expected = CURVES[shape](both.ravel()).reshape(both.shape) @ density
    mean = float(expected @ density)
    return float((expected - mean) ** 2 @ density) / std**2


@lru_cache(maxsize=16)
def distance_from_normal(shape: str) -> float:
    """Return the largest difference between the cumulative distributions of a shape and of a normal distribution."""
    mean, std = moments(shape)
    differences = stats.norm.cdf(_SCORES) - stats.norm.cdf((CURVES[shape](_SCORES) - mean) / std)
    return float(np.abs(differences).max())


def samples_of(production: Production, y: Array, variables: Array | None = None) -> Samples:
    """Return values as the rows of a campaign, all with status ok."""
    n = y.size
    columns = {} if variables is None else dict(zip(VARIABLES, variables.T, strict=True))
    return Samples(
        sample=np.arange(n),
        status=np.zeros(n, np.int16),
        statuses=("ok",),
        messages={},
        ok=np.ones(n, np.bool_),
        values={RESPONSE: y, **columns},
        max_residual=np.zeros(n),
        max_penetration=np.zeros(n),
        settled=np.ones(n, np.bool_),
        penetration_unit="mm",
        production_batch=production.lot_of(n),
        run_seconds=None,
    )


def request(production: Production, n: int, true: Truth, variables: tuple[str, ...] = ()) -> ReportSpec:
    """Return the request of a campaign of n samples with one response."""
    batch = -(-n // production.lots) if production.lots else 0
    return ReportSpec(
        title=production.name,
        campaign="study",
        header={},
        responses=(ResponseSpec(RESPONSE, "", "1", true.lsl, true.usl, true.target, "study"),),
        variables=tuple(VariableSpec(name, "1", "normal", None, None, 0.0, 1.0, (), batch=batch) for name in variables),
        provenance={},
        requested=n,
        production_batch_column=BATCH if production.lots else "",
    )


def page(production: Production, y: Array, true: Truth) -> Analysis:
    """Return the report's analysis of values."""
    return analyse(samples_of(production, y), request(production, y.size, true))


def warned_of_all(card: tuple[Check, ...]) -> bool:
    """Return whether the trust card says that the samples support no interval."""
    return any(
        (check.name == "Sampling" and check.level != "info")
        or (check.name == "Production lots" and "are needed" in check.text)
        for check in card
    )


def warned_of_normal(card: tuple[Check, ...]) -> bool:
    """Return whether the trust card says that shares of a normal distribution are, or may be, wrong."""
    (shape,) = (check for check in card if check.name == "Shape")
    return shape.level in ("attention", "bad") or "may be off" in shape.text
