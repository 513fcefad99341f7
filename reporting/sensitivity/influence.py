"""The sensitivity of responses to variables, as data.

A variable is *critical* for a response when it explains at least a tenth of its variance and that is no chance
(Bonferroni over the variables); *not critical* when its interval ends below a tenth; *open* between, where more
samples decide. What it explains is its total index where a design gives one, otherwise what it explains alone.
"""

from dataclasses import dataclass

from reporting.capability.intervals import Interval
from reporting.sensitivity.rejects import RejectCauses, WorstSample

CRITICAL_SHARE = 0.10
NEGLIGIBLE_SHARE = 0.001
CRITICAL, NOT_CRITICAL, OPEN = "critical", "not critical", "open"


@dataclass(frozen=True)
class Influence:
    """One variable on one response; None where the response says nothing or the variable does not vary.

    Attributes
    ----------
    variable : str
    coefficient, coefficient_interval : float, (float, float)
        Standardised regression coefficient.
    contribution, contribution_interval : float, (float, float)
        Share of the variance in linear regression, averaged over all orders of entering (LMG); None above 10 variables.
    inflation : float
        Variance inflation; None where the other variables determine this one.
    spearman, spearman_interval : float, (float, float)
        Rank correlation.
    rank_coefficient : float
        Standardised coefficient of the regression of ranks.
    first_order, first_order_interval : float, (float, float)
        First-order Sobol' index.
    total, total_interval : float, (float, float)
        Total Sobol' index: with all interactions; None without a design.
    interactions, interactions_interval : float, (float, float)
        Total less first-order index, both from the design: the share of the interactions the variable has part in.
    low, high : float
        Least and largest expected response while the variable goes from its 5th to its 95th percentile, others
        varying as they do; in the response's unit. The bar of a tornado.
    swing_interval : (float, float)
        Of ``high - low``.
    curve : tuple of (float, float)
        Points (variable, expected response) from the 5th to the 95th percentile.
    significant : bool
        Linear coefficient or Sobol' index differ from 0, Bonferroni over the variables.
    verdict : str
        "critical", "not critical" or "open".
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
    total: float | None = None
    total_interval: Interval | None = None
    interactions: float | None = None
    interactions_interval: Interval | None = None
    low: float | None = None
    high: float | None = None
    swing_interval: Interval | None = None
    curve: tuple[tuple[float, float], ...] = ()
    significant: bool | None = None
    verdict: str = OPEN

    @property
    def share(self) -> float | None:
        """Return what the variable explains: with its interactions where that is known, otherwise alone."""
        return self.first_order if self.total is None else self.total


@dataclass(frozen=True)
class ResponseSensitivity:
    """What moves one response.

    Attributes
    ----------
    response : str
    n : int
        Samples with a value; of more than 200,000, regressions and indices use as many, drawn at random.
    independent : bool or None
        The variables show no correlation; without that, the first-order indices do not add up.
    degree : int or None
        Of the polynomials behind the first-order indices.
    r2, r2_rank : float or None
        Share explained by linear regression (adjusted), and by the regression of ranks.
    interaction, interaction_interval : float, (float, float), or None
        Share of the variance that no sum of functions of single variables explains.
    influences : tuple of Influence
        One a variable, in their order.
    verdict : str
        "critical" if any variable is, "not critical" if none is and no more than a tenth is left to
        interactions that total indices do not count, else "open".
    rejects : RejectCauses or None
    worst : tuple of WorstSample
    notes : tuple of str
        Why numbers are None, and what to mind.
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

    @property
    def ranked(self) -> tuple[Influence, ...]:
        """The influences, the largest share first."""
        return tuple(sorted(self.influences, key=lambda i: -(i.share or 0.0)))


@dataclass(frozen=True)
class Sensitivity:
    """All responses over all variables.

    Attributes
    ----------
    variables : tuple of str
    responses : tuple of ResponseSensitivity
    """

    variables: tuple[str, ...]
    responses: tuple[ResponseSensitivity, ...]

    def never_critical(self) -> tuple[str, ...]:
        """Return the variables that are critical for no response, with nothing left open."""
        verdicts = {v: {r.influences[i].verdict for r in self.responses} for i, v in enumerate(self.variables)}
        return tuple(name for name, seen in verdicts.items() if seen == {NOT_CRITICAL})
