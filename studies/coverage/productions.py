"""Productions with known true values: a response of some shape, with or without lots, and its page in the report.

The score of a response (`studies.coverage.shapes`) is a weighted sum of independent normal variables, so the true
first-order indices, and the true values for changed variables, are integrals over scores. A draw is a synthetic
campaign in the form that the report takes: samples and request.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import stats

from engine.arrays import Array
from reporting import ReportSpec, ResponseSpec, VariableSpec
from reporting.analysis import Analysis, analyse
from reporting.samples import LIMITED, Largest, Samples
from reporting.trust.checks import Check
from studies.coverage.shapes import CURVES, Truth, explained
from studies.row_order import ALTERNATING, CORRELATED, Draw

SIZES = (50, 500, 5000)
# Shares of the score's variance due to the variables X1, X2, ...
SHARES = (0.5, 0.3, 0.15, 0.05, 0.0)
VARIABLES = tuple(f"X{i + 1}" for i in range(len(SHARES)))

RESPONSE, BATCH = "y", "production batch"
CONFIDENCE = 0.95


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
    together: bool = False  # the increase takes both of the first two variables above 0
    in_order: bool = False  # its values are those of `SERIES`, in the order in which they are made

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
        jumps = np.all(variables[:, :2] > 0, axis=1) if self.together else variables[:, 0] > 1
        return CURVES[self.shape](variables @ np.sqrt(SHARES)) + self.jump * jumps

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return n values of the response."""
        return SERIES[self.name](rng, n) if self.in_order else self.values(self.variables(n, rng))


def _bad_lots(production: Production, rng: np.random.Generator, n: int) -> Array:
    """Return n values in lots; in 5 % of them all values are larger by 3 of the sigmas within a lot."""
    bad = rng.random(production.lots) < 0.05
    return rng.standard_normal(n) + 3.0 * bad[production.lot_of(n)]


_OF_SHAPE = {shape: Production(shape, shape) for shape in CURVES}
SHAPES = tuple(_OF_SHAPE.values())[:6]
# Shapes that mislead verdicts: a small second population, an end, a skew, a heavy tail.
JUDGED_SHAPES = tuple(_OF_SHAPE.values())[6:11]
MORE_SHAPES = tuple(_OF_SHAPE.values())[6:-1]  # these, and others
JUMPS = (
    Production("small jump", "normal", jump=1.5),
    Production("large jump", "normal", jump=6.0),
    Production("joint jump", "normal", jump=3.0, together=True),
    _OF_SHAPE["lognormal (1)"],
)
LOTS = (
    Production("20 lots", "normal", 20),
    Production("20 lots, 0.3", "normal", 20, between=0.3),
    Production("20 unequal lots", "normal", 20, growth=1.15),
    Production("5 lots", "normal", 5),
    Production("1 lot", "normal", 1),
    Production("20 lots, lognormal", "lognormal", 20),
)
# Productions whose order matters, or whose lots differ as seldom as bad ones do.
_PROCESSES = (CORRELATED[0.4], CORRELATED[0.6], *ALTERNATING)
_BAD_LOTS = tuple(
    Production(f"{lots} lots, 5 % bad", "5 % shifted by 3 sigmas", lots, in_order=True) for lots in (8, 20, 50, 60)
)
_SPINDLES = ALTERNATING[0].name
IN_ORDER = (
    *(
        Production(each.name, "two normals 2 sigmas apart" if each.name == _SPINDLES else "normal", in_order=True)
        for each in _PROCESSES
    ),
    *_BAD_LOTS,
)
# By name, because a production goes to other processes, and these functions cannot.
SERIES: dict[str, Draw] = {
    **{each.name: each.draw for each in _PROCESSES},
    **{each.name: partial(_bad_lots, each) for each in _BAD_LOTS},
}
# Productions that are sampled until a stopping rule ends them.
LOTS_IN_TURN = (
    *(Production(f"{shape}, in turn", shape) for shape in ("normal", "lognormal", "t5")),
    Production("lots of 50", "normal", 100),
    Production("lots of 50, 0.3", "normal", 100, between=0.3),
    Production("lots of 500, 0.3", "normal", 10, between=0.3),
)


def first_order(production: Production) -> tuple[float, ...]:
    """Return the share of the response's variance that each variable explains alone."""
    if not production.jump:
        return tuple(explained(production.shape, share) for share in SHARES)
    where = 0.0 if production.together else 1.0
    jumped, others = stats.norm.sf(where), stats.norm.sf(where) if production.together else 1.0
    parts = [*SHARES]
    for of in range(2 if production.together else 1):
        mean = production.jump * others  # of the increase, if this variable is above its bar
        parts[of] += 2 * mean * SHARES[of] ** 0.5 * stats.norm.pdf(where) + mean**2 * jumped * (1 - jumped)
    both = jumped * others
    total = 1.0 + production.jump**2 * both * (1 - both)
    total += (
        2
        * production.jump
        * others
        * stats.norm.pdf(where)
        * sum(SHARES[of] ** 0.5 for of in range(1 + production.together))
    )
    return tuple(float(part) / total for part in parts)


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
        largest={name: Largest(0.0, 0, n) for name in LIMITED},
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
