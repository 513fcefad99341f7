"""The responses of a campaign at other tolerances, by emulators of its rows: what advice and allocation ask.

All tolerances are asked at the same random numbers, so that differences between them are those of the tolerances. The
samples fill the space evenly (Sobol): their mean and variance err far less than the intervals, those of as many random
samples, allow.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from reporting.arrays import Array
from reporting.emulation.emulated_what_if import (
    MOST_BEYOND,
    beyond,
    emulated_answer,
    fit_to_rows,
    refuse_beyond,
    refuse_values,
)
from reporting.emulation.gaussian_process import Emulator
from reporting.errors import ReportError
from reporting.tolerance.index_curve import Moments
from reporting.tolerance.reweighting import Change
from reporting.tolerance.whatif import WhatIf, what_if

NEW_SAMPLES = 8192  # a power of two, as evenly spread samples should be
_FOR_SLOPES = 2048  # of the new samples
_STEP = 0.95  # of a factor: downwards, because a distribution at its bounds cannot grow
_BISECTIONS = 12

Limits = Mapping[str, tuple[float | None, float | None]]


class EmulatedTolerances:
    """Emulators of responses (n,) by the variables of the same rows (n,), asked at new samples.

    `drawn` returns the new samples (m,) of each variable at tolerances multiplied by factors.
    """

    def __init__(
        self,
        rows: Mapping[str, Array],
        responses: Mapping[str, Array],
        limits: Limits,
        drawn: Callable[[Mapping[str, float]], Mapping[str, Array]],
    ) -> None:
        self._rows, self._responses, self._limits, self._drawn = rows, responses, limits, drawn
        self._fitted = dict[str, Emulator | ReportError]()

    def _emulator(self, name: str) -> Emulator:
        """Return the emulator of a response, fitted when it is first asked for; ReportError: there is none."""
        if name not in self._fitted:
            y = self._responses[name]
            try:
                refuse_values(y)
                self._fitted[name] = fit_to_rows(y, self._rows)
            except ReportError as error:
                self._fitted[name] = ReportError(f"{name}: {error}")
        found = self._fitted[name]
        if isinstance(found, ReportError):
            raise found
        return found

    def reach(self, variable: str, factor: float) -> float:
        """Return the largest factor, from 1 up to the given one, at which the rows cover the variable."""

        def is_covered(tried: float) -> bool:
            return beyond(self._rows[variable], self._drawn({variable: tried})[variable]) <= MOST_BEYOND

        if variable not in self._rows or is_covered(factor):
            return factor
        low, high = 1.0, factor
        for _ in range(_BISECTIONS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if is_covered(middle) else (low, middle)
        return low

    def check(self, factors: Mapping[str, float]) -> None:
        """Raise ReportError if too many new values of a variable lie beyond those of the rows."""
        refuse_beyond(self._rows, self._drawn(factors))

    def moments(
        self, factors: Mapping[str, float], changed: Sequence[str], responses: Sequence[str] | None = None
    ) -> dict[str, Moments]:
        """Return mean and variance of all responses, or some, with slopes by the squares of the `changed` factors."""
        emulators = {name: self._emulator(name) for name in responses or self._responses}
        at = self._positions(factors)[: None if changed else _FOR_SLOPES]  # advice asks often: a quarter will do
        stepped = {name: self._positions({**factors, name: _STEP * factors[name]})[:_FOR_SLOPES] for name in changed}
        found = {}
        for name, emulator in emulators.items():
            y = emulator.mean(at)
            near, slopes = y[:_FOR_SLOPES], dict[str, tuple[float, float]]()
            for variable, x in stepped.items():
                other = emulator.mean(x)
                rise = (1 - _STEP**2) * factors[variable] ** 2
                slopes[variable] = (near.mean() - other.mean()) / rise, (near.var() - other.var()) / rise
            found[name] = Moments(
                mean=float(y.mean()),
                variance=float(y.var()) + emulator.scatter**2,
                mean_slope={variable: float(slope) for variable, (slope, _) in slopes.items()},
                variance_slope={variable: float(slope) for variable, (_, slope) in slopes.items()},
            )
        return found

    def answers(
        self, factors: Mapping[str, float], why: str, responses: Sequence[str] | None = None
    ) -> dict[str, WhatIf]:
        """Return all responses, or some, with intervals that include the emulators' errors.

        ReportError: there is no emulator, or too many new values lie beyond those of the rows.
        """
        self.check(factors)
        emulators = {name: self._emulator(name) for name in responses or self._responses}
        x, found = self._positions(factors), {}
        for name, emulator in emulators.items():
            y = self._responses[name]
            weighted = replace(what_if(y, Change(np.zeros(y.size)), *self._limits[name]), refusal=why)
            found[name] = emulated_answer(emulator, x, self._limits[name], weighted)
        return found

    def _positions(self, factors: Mapping[str, float]) -> Array:
        new = self._drawn(factors)
        return np.column_stack([new[name] for name in self._rows])
