"""Tables of the campaign file about failed runs, stopping, and the cost of a run."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from engine.mechanism.base import PositiveNumber, TableModel

RETRIED = ("not_at_rest", "not_converged", "jammed", "diverged", "timeout")
"""Statuses that other settings could avoid. An ``invalid`` run is a result, and settings do not cause a crash."""

FIRST_RUNS = 100  # if all fail, so will the others: with 5 % success, the first 100 all fail in 0.6 % of cases
GROWTH = 4  # from a checkpoint of n samples the next one is n / GROWTH samples away


class SimulationSettings(TableModel, strict=True):
    """Settings of every run that replace the mechanism's own."""

    step: PositiveNumber | None = Field(
        default=None, description="Time step, in the mechanism's unit of time, above 0; the mechanism's own if absent."
    )
    horizon: PositiveNumber | None = Field(
        default=None,
        description="Longest simulated time, in the mechanism's unit of time, above 0; the mechanism's own if absent.",
    )
    tolerance: Annotated[float | None, Field(gt=0.0, le=1e-3, allow_inf_nan=False)] = Field(
        default=None,
        description="Relative residual of the friction problems, above 0, at most 1e-3; the mechanism's own if absent.",
    )

    def values(self) -> dict[str, float]:
        """Return the given settings that are keys of the mechanism."""
        return {} if self.tolerance is None else {"simulation.tolerance": self.tolerance}

    def text(self) -> str:
        """Return the settings in words."""
        given = self.model_dump(exclude_none=True)
        return ", ".join(f"{key} {value:g}" for key, value in given.items()) or "settings of the mechanism"


class Failures(TableModel, strict=True):
    """What happens if runs fail."""

    retry: Annotated[tuple[SimulationSettings, ...], Field(max_length=10, strict=False)] = Field(
        default=(),
        description="Settings of further attempts at a run that did not come to rest or converge, jammed, diverged or"
        " took too long, in the order of the attempts; at most 10.",
    )
    max_failed: Annotated[int, Field(ge=0)] | Annotated[float, Field(ge=0.0, lt=1.0)] | None = Field(
        default=None,
        description="The campaign stops as soon as more rows than this have failed: a number of rows or, below 1, a"
        f" share of all samples. If absent, it stops only when its first {FIRST_RUNS} runs have all failed.",
    )
    min_ok: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.99,
        description="Least share of ok runs of all that are done, from 0 to 1. With fewer, failed runs may decide every"
        " verdict: the report gives none, and the command ends with exit status 1.",
    )

    def most_failed(self, samples: int) -> float:
        """Return the number of rows that may fail in a campaign of ``samples`` samples; infinite without a limit."""
        if self.max_failed is None:
            return float("inf")
        return self.max_failed if isinstance(self.max_failed, int) else self.max_failed * samples

    def is_hopeless(self, ok: int, done: int) -> bool:
        """Return whether enough runs are done, all of them failed, to stop the campaign."""
        return self.max_failed is None and ok == 0 and done >= FIRST_RUNS


class RepeatSettings(TableModel, strict=True):
    """Samples that are simulated a second time, with half the step, to see how far results depend on it."""

    share: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = Field(
        description="Share of the samples to repeat, from 0 (none) to 1 (all). A repeat takes about twice the time of"
        " its run, and enters no statistic but the report's repeatability."
    )


class Execution(TableModel, strict=True):
    """What one run may cost."""

    time_limit: PositiveNumber | None = Field(
        default=None,
        description="Longest wall-clock time of a run [s], above 0; the mechanism's simulation.wall_limit if absent.",
    )
    memory_limit: Annotated[float, Field(ge=0.5, allow_inf_nan=False)] = Field(
        default=4.0, description="Largest memory of a process that simulates [GiB], at least 0.5."
    )

    def values(self) -> dict[str, float]:
        """Return the given limits that are keys of the mechanism."""
        return {} if self.time_limit is None else {"simulation.wall_limit": self.time_limit}


class Stop(TableModel, strict=True):
    """The campaign stops as soon as a statistic is precise enough, and computes no further samples.

    The rule is evaluated at checkpoints, which are numbers of samples. At a checkpoint n it takes the first n samples
    and stops the campaign if the confidence interval of the statistic is narrow enough. So the end of a campaign
    depends neither on the number of workers nor on the order in which rows arrive. With production batches, at least
    five must be complete, as intervals rest on the differences between them.
    """

    response: Annotated[str, Field(min_length=1)] = Field(description="Name of the response that the rule is about.")
    statistic: Literal["mean", "std", "cp", "cpk", "ppm"] = Field(
        description="Statistic of the response: mean, std, cp, cpk, or ppm (the observed share out of limits)."
    )
    half_width: PositiveNumber = Field(
        description="Half the width of the statistic's confidence interval at which the campaign stops, in its unit,"
        " above 0."
    )
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=0.95, description="Confidence of the two-sided interval, between 0 and 1."
    )
    min_samples: Annotated[int, Field(ge=2, le=100_000_000)] = Field(
        default=100, description="First checkpoint, at least 2 samples; each later one has a quarter more samples."
    )
    max_samples: Annotated[int | None, Field(ge=2, le=100_000_000)] = Field(
        default=None,
        description="Number of samples at which the campaign ends at the latest, at least min_samples; the campaign's"
        " samples if absent.",
    )

    @model_validator(mode="after")
    def _least_and_most(self) -> Self:
        if self.max_samples is not None and self.max_samples < self.min_samples:
            raise ValueError(
                f"max_samples = {self.max_samples} is less than min_samples = {self.min_samples}; exchange them"
            )
        return self

    def checkpoints(self, samples: int) -> tuple[int, ...]:
        """Return the numbers of samples at which the rule is evaluated; the last is ``samples``."""
        points, n = [], self.min_samples
        while n < samples:
            points.append(n)
            n += max(n // GROWTH, 1)
        return (*points, samples)
