"""Data classes for the sensitivity of responses to variables; `reporting.sensitivity.criticality` has the verdicts."""

from dataclasses import dataclass

from reporting.capability.intervals import Interval
from reporting.sensitivity.reject_attribution import RejectAttribution
from reporting.sensitivity.rejects import RejectCauses, WorstSample

CRITICAL_SHARE = 0.10
NEGLIGIBLE_SHARE = 0.001
FEWEST_CARRIERS = 12
CRITICAL, NOT_CRITICAL, OPEN, CORRELATED = "critical", "not critical", "open", "only correlated"
OWN_EFFECT = 0.01  # share of the variance from which on a variable acts itself
POLYNOMIAL, RANKS = "polynomial", "ranks"


@dataclass(frozen=True)
class Influence:
    """The influence of one variable on one response; a number is None where it is undefined."""

    variable: str
    coefficient: float | None = None  # of the regression on standardised variables
    coefficient_interval: Interval | None = None
    # share of the variance in linear regression, averaged over all orders (LMG); None above 10 variables
    contribution: float | None = None
    contribution_interval: Interval | None = None
    inflation: float | None = None  # of the variance; None if the other variables determine this one
    spearman: float | None = None  # rank correlation
    spearman_interval: Interval | None = None
    rank_coefficient: float | None = None  # of the regression of standardised ranks
    first_order: float | None = None  # Sobol' index
    first_order_interval: Interval | None = None  # includes what the estimator may have missed
    estimator: str | None = None  # "polynomial", or "ranks" where the polynomial misses a structure, such as a jump
    carriers: float | None = None  # samples that carry the first-order index; if few, the interval is too narrow
    # Sobol' index with all interactions; None without a design. Measured scatter is subtracted.
    total: float | None = None
    total_interval: Interval | None = None
    interactions: float | None = None  # total-order minus first-order index, both from the design
    interactions_interval: Interval | None = None
    shapley: float | None = None  # effect; None for independent variables
    shapley_interval: Interval | None = None  # includes what the regression does not explain
    # Effect of the variable with all others fixed, as a share of the variance; above 1 if the others compensate it;
    # None for independent variables.
    own: float | None = None
    own_interval: Interval | None = None
    # of an "only correlated" variable: the acting ones it is correlated with, strongest first
    through: tuple[str, ...] = ()
    # Smallest and largest conditional expectation of the response for values of the variable from its 5th to its 95th
    # percentile, in the unit of the response: the bar of a tornado chart.
    low: float | None = None
    high: float | None = None
    swing_interval: Interval | None = None  # of ``high - low``
    curve: tuple[tuple[float, float], ...] = ()  # (variable, expected response) from the 5th to the 95th percentile
    # the linear coefficient or a Sobol' index differs from 0 (Bonferroni over the variables)
    significant: bool | None = None
    verdict: str = OPEN  # "critical", "not critical", "only correlated" or "open"

    @property
    def share(self) -> float | None:
        """Share of the variance: Shapley effect or total-order index if known, else the first-order index."""
        known = [share for share in (self.shapley, self.total) if share is not None]
        return known[0] if known else self.first_order


@dataclass(frozen=True)
class ResponseSensitivity:
    """The sensitivity of one response to the variables."""

    response: str
    n: int  # samples with a value; regressions and indices use at most 200,000 of them, drawn at random
    independent: bool | None  # no correlation is requested or beyond chance; otherwise first-order indices overlap
    degree: int | None  # of the polynomials used for the first-order indices
    r2: float | None  # share of the variance explained by linear regression (adjusted)
    r2_rank: float | None  # by the regression of ranks
    # share of the variance that is not a sum of functions of single variables, scatter included
    interaction: float | None
    interaction_interval: Interval | None
    influences: tuple[Influence, ...]  # one per variable, in the order of the variables
    # "critical" if a variable is; "not critical" if none is and less than a tenth of the variance remains for
    # interactions that total-order indices do not cover; else "open".
    verdict: str
    rejects: RejectCauses | None
    worst: tuple[WorstSample, ...]
    notes: tuple[str, ...]  # why numbers are None, and cautions
    attribution: RejectAttribution | None = None  # parts of the reject share by variable; None without a reject
    # Part of `interaction` that is scatter between runs of the same sample with different steps, which no input causes;
    # None if no repeat measures it.
    scatter: float | None = None
    scatter_interval: Interval | None = None
    # `interaction` without the scatter: interactions, and jumps; None if scatter is not measured
    rest: float | None = None
    rest_interval: Interval | None = None

    @property
    def ranked(self) -> tuple[Influence, ...]:
        """The influences in decreasing order of their shares."""
        return tuple(sorted(self.influences, key=lambda i: -(i.share or 0.0)))


@dataclass(frozen=True)
class Sensitivity:
    """The sensitivity of all responses to all variables."""

    variables: tuple[str, ...]
    responses: tuple[ResponseSensitivity, ...]

    def never_critical(self) -> tuple[str, ...]:
        """Return the variables that are "not critical" or "only correlated" for every response."""
        verdicts = {v: {r.influences[i].verdict for r in self.responses} for i, v in enumerate(self.variables)}
        return tuple(name for name, seen in verdicts.items() if seen and seen <= {NOT_CRITICAL, CORRELATED})
