"""The conclusions of a report for the list of campaigns; only these fields of the large document become objects."""

from collections.abc import Mapping

from pydantic import BaseModel, Field

Interval = tuple[float, float]


class Weakest(BaseModel):
    """The response with the smallest Cpk."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval | None = Field(None, examples=[(1.18, 1.24)])


class BelowTarget(BaseModel):
    """A response whose Cpk is below the target with its whole interval."""

    response: str = Field(examples=["FC-1"])
    cpk: float = Field(examples=[1.21])
    interval: Interval = Field(examples=[(1.18, 1.24)])
    target: float = Field(examples=[1.33])


class _Spec(BaseModel):
    name: str


class _Capability(BaseModel):
    cpk: float | None
    cpk_interval: tuple[float | None, float | None] | None

    @property
    def interval(self) -> Interval | None:
        """The interval of Cpk; None if it lacks an end."""
        low, high = self.cpk_interval or (None, None)
        return None if low is None or high is None else (low, high)


class _Response(BaseModel):
    spec: _Spec
    capability: _Capability


class _Yield(BaseModel):
    share: float


class _ProductYield(BaseModel):
    with_failures: _Yield | None
    counted: _Yield


class _Thresholds(BaseModel):
    capable: float


class Conclusions(BaseModel):
    """The conclusions of a report, read from its ``capability.json``."""

    headline: str
    responses: list[_Response]
    product: _ProductYield | None
    thresholds: _Thresholds

    @property
    def weakest(self) -> Weakest | None:
        """The response with the smallest Cpk; None if no response has a Cpk."""
        return weakest_of({r.spec.name: (r.capability.cpk, r.capability.interval) for r in self.responses})

    @property
    def below_target(self) -> list[BelowTarget]:
        """The responses whose Cpk is below the target with its whole interval."""
        target = self.thresholds.capable
        known = [(r.spec.name, r.capability.cpk, r.capability.interval) for r in self.responses]
        return [
            BelowTarget(response=name, cpk=cpk, interval=interval, target=target)
            for name, cpk, interval in known
            if cpk is not None and interval is not None and interval[1] < target
        ]

    @property
    def share_ok(self) -> float | None:
        """Share of the product within all limits; failed runs count as outside if the report has that share."""
        return None if self.product is None else (self.product.with_failures or self.product.counted).share


def weakest_of(indices: Mapping[str, tuple[float | None, Interval | None]]) -> Weakest | None:
    """Return the response with the smallest Cpk of those given with their intervals; None if no response has a Cpk."""
    known = [(cpk, name, interval) for name, (cpk, interval) in indices.items() if cpk is not None]
    if not known:
        return None
    cpk, name, interval = min(known, key=lambda each: each[0])
    return Weakest(response=name, cpk=cpk, interval=interval)
