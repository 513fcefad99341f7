"""The smallest margin of the responses' Cpk over their targets, as a function of the factor on one spread.

It is what `reporting.tolerance.whatif` answers at that factor: by the weights of the samples, and where they carry no
answer by an emulator of the rows.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from reporting.arrays import Array
from reporting.errors import ReportError
from reporting.tolerance.reweighting import Change, LotLabels
from reporting.tolerance.whatif import WhatIf, what_if_all

_UP, _DOWN = 1.1, 0.85  # steps of the factor
_REFINEMENTS = 3  # of a crossing, and of the end of the range with answers
_HALVINGS = 4  # further ones of a crossing that is a jump from the weights' answer to the emulator's
# No change may make a larger share of runs fail, because this would matter more than any index of the others. If more
# runs fail already, at most a tenth more may fail.
MOST_FAILED, _MORE_FAILED = 0.01, 1.1
FAILURES = "runs without a value"
ROUNDING = 1e-9  # of a share

Limits = Mapping[str, tuple[float | None, float | None]]
# Low end, value and high end of Cpk by response.
Indices = dict[str, tuple[float, float, float]]
Ends = tuple[float, float]
# At a factor: the indices by reweighting and the answer with most missing runs, Cpk by an emulator, or why neither.
Found = tuple[Indices, WhatIf] | dict[str, float] | str


@dataclass(frozen=True)
class Moments:
    """A response at some tolerances, and how it changes with them."""

    mean: float
    variance: float
    # by variable, per unit of the square of the factor on its tolerance
    mean_slope: Mapping[str, float]
    variance_slope: Mapping[str, float]


class Emulation(Protocol):
    """The responses at tolerances multiplied by factors, by emulators of the rows; ReportError: why they give none."""

    def reach(self, variable: str, factor: float) -> float:
        """Return the largest factor, from 1 up to the given one, at which the rows still cover the variable."""

    def check(self, factors: Mapping[str, float]) -> None:
        """Raise ReportError if too many new values of a variable lie beyond those of the rows."""

    def moments(
        self, factors: Mapping[str, float], changed: Sequence[str], responses: Sequence[str] | None = None
    ) -> Mapping[str, Moments]:
        """Return all responses, or some, with slopes by the `changed` variables."""

    def answers(
        self, factors: Mapping[str, float], why: str, responses: Sequence[str] | None = None
    ) -> Mapping[str, WhatIf]:
        """Return all responses, or some, with their intervals; `why` the weights of the rows give none."""


@dataclass(frozen=True)
class Margin:
    """The smallest margin over the targets: of Cpk, and of the ends of its interval."""

    low: float  # of the lower end, the smallest over all responses; likewise the others
    value: float
    high: float
    response: str  # the one with the smallest margin, or "runs without a value"
    cpk: float | None  # of that response; None for runs without a value
    effective: float | None  # sample size; None by an emulator


@dataclass(frozen=True)
class Question:
    """Responses with limits and targets, and what gives their values at other spreads."""

    responses: Mapping[str, Array]  # shape (n,)
    limits: Limits
    targets: Mapping[str, float]
    confidence: float  # two-sided
    lots: LotLabels | None  # shape (n,)
    emulation: Emulation | None = None  # None where an emulator does not apply, as with lots

    def at(self, change: Change, factors: Mapping[str, float]) -> Found:
        """Return what a what-if finds at factors on spreads, whose effect on the weights is `change`."""
        weighted = self.weighted(change)
        if not isinstance(weighted, str) or set(factors.values()) == {1.0}:
            return weighted
        found = self.emulated(factors)
        return f"{weighted}; no emulator either: {found}" if isinstance(found, str) else found

    def margin(self, found: Found, errors: Mapping[str, Ends]) -> Margin | str:
        """Return the margin of what was found; `errors` are those of the emulator, as of `emulator_errors`."""
        if isinstance(found, str):
            return found
        if isinstance(found, tuple):
            return self._of_weights(*found)
        ends = {name: (abs(cpk) * end for end in errors.get(name, (0.0, 0.0))) for name, cpk in found.items()}
        return self._least(
            {name: (found[name] - below, found[name], found[name] + above) for name, (below, above) in ends.items()},
            None,
        )

    def weighted(self, change: Change) -> tuple[Indices, WhatIf] | str:
        """Return the indices by reweighting and the answer with most missing runs, or why there is none."""
        answers = what_if_all(self.responses, change, self.limits, self.confidence, self.lots)
        for answer in answers.values():
            if answer.refusal:
                return answer.refusal
        indices = {
            name: (answer.cpk.interval[0], answer.cpk.value, answer.cpk.interval[1])
            for name, answer in answers.items()
            if answer.cpk is not None  # a response without spread keeps its target
        }
        return indices, max(answers.values(), key=lambda answer: answer.missing or 0.0)

    def emulated(self, factors: Mapping[str, float]) -> dict[str, float] | str:
        """Return Cpk of each response with a spread by the emulator, or why there is none."""
        if self.emulation is None:
            return "there is none for these samples"
        if max(factors.values()) > 1 and not all(np.isfinite(y).all() for y in self.responses.values()):
            return "some runs have no value, and nothing tells how many more would have none"
        try:
            self.emulation.check(factors)
            moments = self.emulation.moments(factors, (), tuple(self.responses))
        except ReportError as error:
            return str(error)
        return {name: _cpk(found, self.limits[name]) for name, found in moments.items() if found.variance > 0}

    def emulator_errors(self, factors: Mapping[str, float]) -> dict[str, Ends]:
        """Return how far below and above Cpk its interval reaches, as parts of Cpk, at factors that are `emulated`."""
        if self.emulation is None:
            return {}
        answers = self.emulation.answers(factors, "", tuple(self.responses))
        found = {name: answer.cpk for name, answer in answers.items() if answer.cpk is not None and answer.cpk.value}
        return {
            name: ((cpk.value - cpk.interval[0]) / abs(cpk.value), (cpk.interval[1] - cpk.value) / abs(cpk.value))
            for name, cpk in found.items()
        }

    def _of_weights(self, indices: Indices, worst: WhatIf) -> Margin | str:
        """Return the margin by reweighting; runs without a value have one too."""
        # Their share must not exceed 1 %, or 1.1 times the present share.
        allowed = max(MOST_FAILED, _MORE_FAILED * worst.dropped / max(worst.n + worst.dropped, 1)) + ROUNDING
        return self._least(indices, worst.effective, allowed - (worst.missing or 0.0))

    def _least(self, indices: Indices, effective: float | None, spare: float = math.inf) -> Margin | str:
        """Return the smallest margins over the responses' low end, value and high end of Cpk, and over failures."""
        if not indices:
            return "no response has a spread"
        low, value, high = (
            min(ends[level] - self.targets[name] for name, ends in indices.items()) for level in range(3)
        )
        if spare < min(value, 0.0):  # a share is not an index: it counts only if it is exceeded
            return Margin(min(low, spare), spare, min(high, spare), FAILURES, None, effective)
        response = min(indices, key=lambda name: indices[name][1] - self.targets[name])
        return Margin(low, value, high, response, indices[response][1], effective)


class IndexCurve:
    """The margin at factors outwards from 1, by `ask`, until there is no answer or the targets are crossed."""

    def __init__(self, ask: Callable[[float], Margin | str], least: float, most: float) -> None:
        self._ask = ask
        now = ask(1.0)
        self.refusal = now if isinstance(now, str) else ""
        self._points: dict[float, Margin] = {} if isinstance(now, str) else {1.0: now}
        if not isinstance(now, str):
            if now.high >= 0:
                self._walk(_UP, most, lambda margin: margin.high < 0)
            if now.low < 0:
                self._walk(_DOWN, least, lambda margin: margin.low >= 0)

    @property
    def now(self) -> Margin:
        """The margin at the present spread."""
        return self._points[1.0]

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest factor with an answer."""
        return min(self._points), max(self._points)

    @property
    def emulated(self) -> float | None:
        """The factor nearest to 1 at which an emulator answers; None if none does."""
        found = [f for f, margin in self._points.items() if margin.effective is None]
        return min(found, key=lambda f: abs(f - 1), default=None)

    def at(self, factor: float) -> Margin:
        """Return the margin at a factor, or at the nearest factor towards 1 with an answer."""
        margin = self._ask(factor)
        if not isinstance(margin, str):
            return margin
        inward = [f for f in self._points if min(1.0, factor) <= f <= max(1.0, factor)]
        return self._points[min(inward, key=lambda f: abs(f - factor))]

    def crossing(self, level: str) -> float | None:
        """Return the factor nearest to 1 at which a level crosses zero; None if it does not."""
        above = getattr(self.now, level) >= 0
        outward = sorted((f for f in self._points if (f >= 1 if above else f <= 1)), reverse=not above)
        crossed = next((i for i, f in enumerate(outward) if (getattr(self._points[f], level) >= 0) != above), None)
        if crossed is None:
            return None
        near, far = ((f, self._points[f]) for f in outward[crossed - 1 : crossed + 1])
        for tried in range(_REFINEMENTS + _HALVINGS):
            jumps = (near[1].effective is None) != (far[1].effective is None)
            if tried >= _REFINEMENTS and not jumps:
                break
            between = (near[0] + far[0]) / 2 if jumps else _zero(near, far, level)
            margin = self._ask(between)
            if isinstance(margin, str):
                break
            if (getattr(margin, level) >= 0) == above:
                near = (between, margin)
            else:
                far = (between, margin)
        else:
            return near[0] if above else far[0]  # the level jumps over zero: the end that keeps it
        return _zero(near, far, level)

    def _walk(self, step: float, limit: float, crossed: Callable[[Margin], bool]) -> None:
        """Add points outwards from 1, until the limit, a refusal or a crossing."""
        inner = 1.0
        while inner != limit:
            outer = min(inner * step, limit) if step > 1 else max(inner * step, limit)
            margin = self._ask(outer)
            if isinstance(margin, str):
                self._approach(inner, outer)
                return
            self._points[outer] = margin
            if crossed(margin):
                return
            inner = outer

    def _approach(self, inner: float, outer: float) -> None:
        """Add points close to a refusal."""
        for _ in range(_REFINEMENTS):
            middle = math.sqrt(inner * outer)
            margin = self._ask(middle)
            if isinstance(margin, str):
                outer = middle
            else:
                self._points[middle] = margin
                inner = middle


def _zero(near: tuple[float, Margin], far: tuple[float, Margin], level: str) -> float:
    """Return the factor at which the line through a level at two factors is zero, between the two."""
    at_near, at_far = getattr(near[1], level), getattr(far[1], level)
    share = at_near / (at_near - at_far) if at_near != at_far else 0.5
    return near[0] + float(min(max(share, 0.0), 1.0)) * (far[0] - near[0])


def _cpk(found: Moments, limits: tuple[float | None, float | None]) -> float:
    lsl, usl = limits
    sides = [] if lsl is None else [found.mean - lsl]
    sides += [] if usl is None else [usl - found.mean]
    return min(sides) / (3 * math.sqrt(found.variance))
