"""Capability under other distributions where the samples' weights carry no answer: by an emulator of the rows.

New samples of the variables are drawn, and the emulator says what their runs would give. Its errors at all of them
belong together. So functions are drawn from the process at some of them, and each gives all numbers there. And the
emulator is cross-validated where it is asked: without each tenth of the rows in turn it gives all numbers again
(jackknife). The larger of the two errors is added to the intervals of the samples.
"""

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from reporting.arrays import Array
from reporting.capability.shares import PPM
from reporting.emulation.gaussian_process import Emulator, fit_emulator
from reporting.errors import ReportError
from reporting.tolerance.reweighting import Change, widened
from reporting.tolerance.whatif import Estimate, WhatIf, what_if

NEW_SAMPLES = 8000
LEAST_VALUES = 50
# With a larger share of new values beyond those of the rows, or of rows without a value, there is no answer.
MOST_BEYOND, MOST_MISSING = 0.05, 0.01
_FUNCTIONS, _PLACES, _PARTS = 60, 1000, 10
_T_95 = 2.262157162740992  # Student's t with 9 degrees of freedom
_NORMAL_95 = 1.959963984540054
_SHARES = ("ppm", "ppm_below", "ppm_above")


def emulated_what_if(
    y: Array,
    old: Mapping[str, Array],
    new: Mapping[str, Array],
    limits: tuple[float | None, float | None],
    weighted: WhatIf,
    doubt: Array | None = None,
) -> WhatIf:
    """Return the answer by an emulator of rows (n,) at new samples (m,) of the same variables; else the old refusal.

    `doubt` is what the new distributions may be off by, at the new samples, as of `Change`.

    An answer has the reason why there is none by weights in `emulated`; without one, the notes say why.
    """
    try:
        refuse_values(y)
        refuse_beyond(old, new)
        emulator = fit_to_rows(y, old)
    except ReportError as error:
        return replace(weighted, notes=(*weighted.notes, f"No emulator either: {error}."))
    return emulated_answer(emulator, np.column_stack(list(new.values())), limits, weighted, doubt)


def refuse_values(y: Array) -> None:
    """Raise ReportError if too few rows (n,) have a value, or too many have none."""
    has = np.isfinite(y)
    if np.count_nonzero(has) < LEAST_VALUES:
        raise ReportError(f"{np.count_nonzero(has)} rows have a value; {LEAST_VALUES} are needed")
    if (missing := 1 - has.mean()) > MOST_MISSING:
        raise ReportError(
            f"{100 * missing:.3g} % of the rows have no value, and nothing tells how many new ones have none"
        )


def refuse_beyond(old: Mapping[str, Array], new: Mapping[str, Array]) -> None:
    """Raise ReportError if too many new values of a variable lie beyond those of the rows."""
    far = {name: beyond(x, new[name]) for name, x in old.items()}
    worst = max(far, key=far.__getitem__)
    if far[worst] > MOST_BEYOND:
        raise ReportError(f"{100 * far[worst]:.3g} % of the new values of {worst} lie beyond those of the rows")


def beyond(x: Array, new: Array) -> float:
    """Return the share of new values beyond the range of those of the rows."""
    return float(np.mean((new < x.min()) | (new > x.max())))


def fit_to_rows(y: Array, old: Mapping[str, Array]) -> Emulator:
    """Return the emulator of a response by rows (n,); ReportError: it knows too little to be used."""
    has = np.isfinite(y)
    emulator = fit_emulator(np.column_stack([x[has] for x in old.values()]), y[has])
    if refusal := emulator.quality.refusal:
        raise ReportError(refusal)
    return emulator


def emulated_answer(
    emulator: Emulator,
    x: Array,
    limits: tuple[float | None, float | None],
    weighted: WhatIf,
    doubt: Array | None = None,
) -> WhatIf:
    """Return the answer at new samples (m, d), with the emulator's error; `weighted` says why weights give none."""
    random = np.random.Generator(np.random.Philox(len(x)))
    smooth = emulator.mean(x)
    mean = smooth + emulator.scatter * random.standard_normal(len(x))
    base, places = what_if(mean, Change(np.zeros(len(x)), doubt=doubt), *limits), slice(0, _PLACES)
    same = Change(np.zeros(len(x[places])))
    of_mean = what_if(mean[places], same, *limits)
    deviations = sampled_deviations(emulator, x[places], _FUNCTIONS, random)
    others = [what_if(mean[places] + each, same, *limits) for each in deviations.T]
    fewer = [emulator.without(part, _PARTS).mean(x[places]) for part in range(_PARTS)]
    parts = [what_if(each + (mean - smooth)[places], same, *limits) for each in fewer]
    numbers: dict[str, Any] = {}
    for key in (field.name for field in fields(WhatIf)):
        estimate, here = getattr(base, key), getattr(of_mean, key)
        if isinstance(estimate, Estimate) and isinstance(here, Estimate):
            drawn, jackknifed = (
                np.array([found.value for each in group if (found := getattr(each, key)) is not None]) - here.value
                for group in (others, parts)
            )
            numbers[key] = _widened(estimate, drawn, jackknifed, is_share=key in _SHARES)
    quality = emulator.quality
    note = (
        f"Emulated from {quality.rows} rows: the emulator explains {100 * quality.q2:.2f} % of rows that it was not"
        f" given, and its 95 % intervals hold {100 * quality.coverage:.0f} % of them."
    )
    return replace(
        weighted,
        **numbers,
        ppm_expected=base.ppm_expected,
        missing=0.0,
        refusal="",
        emulated=weighted.refusal,
        effective=float(min((each.effective for each in numbers.values()), default=0.0)),
        runs=base.runs,
        notes=(*base.notes, note),
    )


def _widened(estimate: Estimate, drawn: Array, jackknifed: Array, *, is_share: bool) -> Estimate:
    """Return an estimate with its interval widened for the emulator's error, from functions and jackknife."""
    error = _NORMAL_95 * float(np.sqrt(np.mean(drawn**2)))
    error = max(error, _T_95 * float(jackknifed.std()) * math.sqrt(_PARTS - 1))
    low, high = estimate.interval
    half = (high - low) / 2
    low, high = widened(estimate.value, estimate.interval, error)
    share = half**2 / (half**2 + error**2) if half > 0 else 1.0
    interval = (max(low, 0.0), min(high, PPM)) if is_share else (low, high)
    return Estimate(estimate.value, interval, share * estimate.effective)


def sampled_deviations(emulator: Emulator, x: Array, count: int, random: np.random.Generator) -> Array:
    """Return what functions that the process holds for possible differ by from its mean at positions (m, d), (m, k)."""
    covariance = emulator.predict(x)[1]
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * random.standard_normal((len(x), count))))
