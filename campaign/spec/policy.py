"""What a campaign does about failed runs, when it stops, and what a run may cost: tables of the campaign file."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from campaign.inputs.distributions import PositiveNumber
from engine.mechanism.base import TableModel

RETRIED = ("not_converged", "diverged", "timeout")
"""Statuses that other settings could mend; an ``invalid`` run is a result, and a crash comes from elsewhere."""

GROWTH = 4  # the next checkpoint of a stopping rule is a quarter further on


class SimulationSettings(TableModel, strict=True):
    """Settings of every run that replace the mechanism's own.

    Attributes
    ----------
    step : float or None
        Time step, in the mechanism's unit of time.
    horizon : float or None
        Longest simulated time, same unit.
    tolerance : float or None
        Relative residual of the friction problems, 0 to 1e-3.
    """

    step: PositiveNumber | None = None
    horizon: PositiveNumber | None = None
    tolerance: Annotated[float | None, Field(gt=0.0, le=1e-3, allow_inf_nan=False)] = None

    def values(self) -> dict[str, float]:
        """Return those settings that are set as keys of the mechanism."""
        return {} if self.tolerance is None else {"simulation.tolerance": self.tolerance}

    def text(self) -> str:
        """Return the settings in words."""
        given = self.model_dump(exclude_none=True)
        return ", ".join(f"{key} {value:g}" for key, value in given.items()) or "settings of the mechanism"


class Failures(TableModel, strict=True):
    """What to do about runs that fail.

    Attributes
    ----------
    retry : tuple of SimulationSettings
        Settings of further attempts at a run that did not converge, diverged or took too long, in turn.
    max_failed : int or float or None
        The campaign ends as failed once more rows than this have failed: a number of rows, or, below 1, a share
        of all samples.
    min_ok : float
        Least share of good rows of a campaign that ends well.
    """

    retry: Annotated[tuple[SimulationSettings, ...], Field(max_length=10, strict=False)] = ()
    max_failed: Annotated[int, Field(ge=0)] | Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    min_ok: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    def most_failed(self, samples: int) -> float:
        """Return how many of ``samples`` rows may fail."""
        if self.max_failed is None:
            return float("inf")
        return self.max_failed if isinstance(self.max_failed, int) else self.max_failed * samples


class Execution(TableModel, strict=True):
    """What one run may cost.

    Attributes
    ----------
    time_limit : float or None
        Longest real time of a run [s]; default: the mechanism's ``simulation.wall_limit``.
    memory_limit : float
        Most memory of a process that simulates [GiB].
    """

    time_limit: PositiveNumber | None = None
    memory_limit: Annotated[float, Field(ge=0.5, allow_inf_nan=False)] = 4.0

    def values(self) -> dict[str, float]:
        """Return those limits that are set as keys of the mechanism."""
        return {} if self.time_limit is None else {"simulation.wall_limit": self.time_limit}


class Stop(TableModel, strict=True):
    """Stop when sure: the campaign ends at the first checkpoint where an interval is narrow enough.

    Checkpoints are numbers of samples, and the rule looks at the first so many samples: where a campaign stops
    does not depend on how many workers computed it, nor on the order in which rows arrived.

    Attributes
    ----------
    response : str
        Which response.
    statistic : str
        Which number of it: ``mean``, ``std``, ``cp``, ``cpk``, or ``ppm`` (the observed share out of limits).
    half_width : float
        Half the width of its confidence interval, in the statistic's unit, at which the campaign stops.
    confidence : float
        Of that interval, two-sided.
    min_samples : int
        The first checkpoint; each later one is a quarter further on.
    max_samples : int or None
        Where the campaign ends at the latest; default: its ``samples``.
    """

    response: Annotated[str, Field(min_length=1)]
    statistic: Literal["mean", "std", "cp", "cpk", "ppm"]
    half_width: PositiveNumber
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.95
    min_samples: Annotated[int, Field(ge=2)] = 100
    max_samples: Annotated[int | None, Field(ge=2)] = None

    @model_validator(mode="after")
    def _least_and_most(self) -> Self:
        if self.max_samples is not None and self.max_samples < self.min_samples:
            raise ValueError(
                f"max_samples = {self.max_samples} is less than min_samples = {self.min_samples}; exchange them"
            )
        return self

    def checkpoints(self, samples: int) -> tuple[int, ...]:
        """Return the numbers of samples at which the rule is asked, the last of them ``samples``."""
        points, n = [], self.min_samples
        while n < samples:
            points.append(n)
            n += max(n // GROWTH, 1)
        return (*points, samples)
