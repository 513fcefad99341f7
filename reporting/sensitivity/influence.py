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
    """The influence of one variable on one response; a number is None where it is undefined.

    Attributes
    ----------
    variable : str
    coefficient, coefficient_interval : float, (float, float)
        Standardised regression coefficient.
    contribution, contribution_interval : float, (float, float)
        Share of the variance in linear regression, averaged over all orders (LMG); None above 10 variables.
    inflation : float
        Variance inflation; None if the other variables determine this one.
    spearman, spearman_interval : float, (float, float)
        Rank correlation.
    rank_coefficient : float
        Standardised coefficient of the regression of ranks.
    first_order, first_order_interval : float, (float, float)
        First-order Sobol' index; the interval includes what the estimator may have missed.
    estimator : str
        "polynomial", or "ranks" where the polynomial misses a structure, such as a jump.
    carriers : float
        Number of samples that carry the first-order index; if it is small, the interval is too narrow.
    total, total_interval : float, (float, float)
        Total-order Sobol' index, which includes all interactions; None without a design. Measured scatter is
        subtracted.
    interactions, interactions_interval : float, (float, float)
        Total-order minus first-order index, both from the design: the share of the variable's interactions.
    shapley, shapley_interval : float, (float, float)
        Shapley effect; None for independent variables. The interval includes what the regression does not explain.
    own, own_interval : float, (float, float)
        Effect of the variable with all others fixed, as a share of the variance; above 1 if the others compensate it;
        None for independent variables.
    through : tuple of str
        For an "only correlated" variable: the acting variables it is correlated with, the strongest first.
    low, high : float
        Smallest and largest conditional expectation of the response for values of the variable from its 5th to its
        95th percentile, in the unit of the response: the bar of a tornado chart.
    swing_interval : (float, float)
        Interval of ``high - low``.
    curve : tuple of (float, float)
        Points (variable, expected response) from the 5th to the 95th percentile.
    significant : bool
        Whether the linear coefficient or a Sobol' index differs from 0 (Bonferroni over the variables).
    verdict : str
        "critical", "not critical", "only correlated" or "open".
    """

    variable: str
    coefficient: float | None = None
    coefficient_interval: Interval | None = None
    contribution: float | None = None
    contribution_interval: Interval | None = None
    inflation: float | None = None
    spearman: float | None = None
    spearman_interval: Interval | None = None
    rank_coefficient: float | None = None
    first_order: float | None = None
    first_order_interval: Interval | None = None
    estimator: str | None = None
    carriers: float | None = None
    total: float | None = None
    total_interval: Interval | None = None
    interactions: float | None = None
    interactions_interval: Interval | None = None
    shapley: float | None = None
    shapley_interval: Interval | None = None
    own: float | None = None
    own_interval: Interval | None = None
    through: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    swing_interval: Interval | None = None
    curve: tuple[tuple[float, float], ...] = ()
    significant: bool | None = None
    verdict: str = OPEN

    @property
    def share(self) -> float | None:
        """Share of the variance: Shapley effect or total-order index if known, else the first-order index."""
        known = [share for share in (self.shapley, self.total) if share is not None]
        return known[0] if known else self.first_order


@dataclass(frozen=True)
class ResponseSensitivity:
    """The sensitivity of one response to the variables.

    Attributes
    ----------
    response : str
    n : int
        Number of samples with a value; regressions and indices use at most 200,000 of them, drawn at random.
    independent : bool or None
        Whether no correlation of the variables is requested or beyond chance; otherwise first-order indices overlap.
    degree : int or None
        Degree of the polynomials used for the first-order indices.
    r2, r2_rank : float or None
        Share of the variance explained by linear regression (adjusted), and by the regression of ranks.
    interaction, interaction_interval : float, (float, float), or None
        Share of the variance that is not a sum of functions of single variables, scatter included.
    influences : tuple of Influence
        One influence per variable, in the order of the variables.
    verdict : str
        "critical" if a variable is; "not critical" if none is and less than a tenth of the variance remains for
        interactions that total-order indices do not cover; else "open".
    rejects : RejectCauses or None
    worst : tuple of WorstSample
    notes : tuple of str
        Why numbers are None, and cautions.
    attribution : RejectAttribution or None
        Parts of the reject share by variable; None without a reject.
    scatter, scatter_interval : float, (float, float), or None
        Part of `interaction` that is scatter between runs of the same sample with different steps, which no input
        causes; None if no repeat measures it.
    rest, rest_interval : float, (float, float), or None
        `interaction` without the scatter: interactions of variables, and jumps; None if scatter is not measured.
    """

    response: str
    n: int
    independent: bool | None
    degree: int | None
    r2: float | None
    r2_rank: float | None
    interaction: float | None
    interaction_interval: Interval | None
    influences: tuple[Influence, ...]
    verdict: str
    rejects: RejectCauses | None
    worst: tuple[WorstSample, ...]
    notes: tuple[str, ...]
    attribution: RejectAttribution | None = None
    scatter: float | None = None
    scatter_interval: Interval | None = None
    rest: float | None = None
    rest_interval: Interval | None = None

    @property
    def ranked(self) -> tuple[Influence, ...]:
        """The influences in decreasing order of their shares."""
        return tuple(sorted(self.influences, key=lambda i: -(i.share or 0.0)))


@dataclass(frozen=True)
class Sensitivity:
    """The sensitivity of all responses to all variables.

    Attributes
    ----------
    variables : tuple of str
    responses : tuple of ResponseSensitivity
    """

    variables: tuple[str, ...]
    responses: tuple[ResponseSensitivity, ...]

    def never_critical(self) -> tuple[str, ...]:
        """Return the variables that are "not critical" or "only correlated" for every response."""
        verdicts = {v: {r.influences[i].verdict for r in self.responses} for i, v in enumerate(self.variables)}
        return tuple(name for name, seen in verdicts.items() if seen and seen <= {NOT_CRITICAL, CORRELATED})
