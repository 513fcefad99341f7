"""What a user writes in a campaign file, checked by models that name the key at fault."""

import math
from decimal import Decimal
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from campaign.distributions import Number, Spread, Variable

Name = Annotated[str, Field(min_length=1, max_length=100)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Simulation(_Table):
    """Settings of every run that replace the mechanism's own.

    Attributes
    ----------
    step : float or None
        Time step, in the mechanism's unit of time.
    horizon : float or None
        Longest simulated time, same unit.
    """

    step: Spread | None = None
    horizon: Spread | None = None


class Response(_Table):
    """Limits of one functional condition, in its unit; all optional.

    Attributes
    ----------
    lsl, usl : float or None
        Lower and upper limit.
    nominal, tolerance : float or None
        Instead of the limits: nominal - tolerance and nominal + tolerance, with the nominal as target.
    target : float or None
        What production aims at.
    source : str
        Where the limits come from; begins with "assumption" when nobody has published them.
    """

    lsl: Number | None = None
    usl: Number | None = None
    nominal: Number | None = None
    tolerance: Spread | None = None
    target: Number | None = None
    source: str = ""

    @model_validator(mode="after")
    def _limits_make_sense(self) -> Self:
        if (self.nominal is None) != (self.tolerance is None):
            raise ValueError("nominal and tolerance belong together; give both, or lsl and usl")
        if self.nominal is not None and (self.lsl is not None or self.usl is not None):
            raise ValueError("nominal and tolerance already say lsl and usl; give one pair or the other")
        if self.lsl is not None and self.usl is not None and not self.lsl < self.usl:
            raise ValueError(f"lsl = {self.lsl:g} is not below usl = {self.usl:g}; exchange or widen the limits")
        return self

    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Return lower limit, upper limit and target; None where there is none."""
        if self.nominal is None or self.tolerance is None:
            return self.lsl, self.usl, self.target
        target = self.nominal if self.target is None else self.target
        # as a drawing adds them: 2.11 - 0.25 is 1.86 and not 1.8599999999999999
        nominal, tolerance = Decimal(repr(self.nominal)), Decimal(repr(self.tolerance))
        return float(nominal - tolerance), float(nominal + tolerance), target


class CampaignSpec(_Table):
    """A campaign: which mechanism, which inputs vary and how, the limits of its responses, how many samples.

    Attributes
    ----------
    format : int
        Version of this file format.
    name : str
        Letters, digits, ``-`` and ``_``: the beginning of the campaign's id, which names its folder.
    title : str
        Title of the report.
    mechanism : str
        Name of a shipped mechanism, or path of a file relative to the campaign file.
    bench : str or None
        The test bench of the mechanism it is simulated on.
    samples : int
        Number of samples, the first of an endless sequence.
    seed : int
        Seed of that sequence.
    sampler : str
        How samples are drawn: ``random`` (independent), or ``worst_case`` (all corners of the variables' ranges, and
        their middle).
    simulation : Simulation
        Settings of every run that replace the mechanism's own.
    header : dict of str to str
        Free lines for the head of the report: part, author, revision, ...
    variables : dict of str to Distribution
        The inputs that vary. The name is the key of the mechanism it sets, unless ``target`` says another.
    responses : dict of str to Response
        Limits by name of the mechanism's response. Responses not named are reported without limits.
    """

    format: Literal[1]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$")]
    title: str = ""
    mechanism: Name
    bench: Name | None = None
    samples: Annotated[int, Field(ge=1, le=100_000_000)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    sampler: Literal["random", "worst_case"] = "random"
    simulation: Simulation = Simulation()
    header: dict[str, str] = {}
    variables: Annotated[dict[Name, Variable], Field(min_length=1)]
    responses: dict[Name, Response] = {}

    @model_validator(mode="after")
    def _corners(self) -> Self:
        if self.sampler != "worst_case":
            return self
        endless = [name for name, v in self.variables.items() if not all(map(math.isfinite, v.support()))]
        if endless:
            raise ValueError(
                f"sampler worst_case needs both ends of every variable; {', '.join(endless)} has none; "
                "give lower and upper"
            )
        corners = 2 ** len(self.variables) + 1
        if self.samples != corners:
            raise ValueError(
                f"sampler worst_case: {len(self.variables)} variables have {corners - 1} corners and a middle; "
                f"write samples = {corners}"
            )
        return self

    def targets(self) -> dict[str, str]:
        """Return which key of the mechanism each variable sets, by variable name."""
        return {name: variable.target or name for name, variable in self.variables.items()}


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return CampaignSpec.model_json_schema()
