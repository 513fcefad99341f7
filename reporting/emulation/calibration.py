"""Unknown constants of a mechanism from measured responses, with the emulators' and the model's own errors.

Constants c, the same for all specimens, measured values y_i of a response r(i) on a specimen s(i), at known values of
some variables; the other variables differ from specimen to specimen as the campaign says:

    y_i = f_r(c, known_i, others_s) + discrepancy_r(known_i) + error_i

f_r is an emulator, a Gaussian process. The others are taken to first order (by the emulator's gradient). The
discrepancy is what the model itself lacks (Kennedy and O'Hagan 2001): normal, with one standard deviation a response,
given or with a half-normal prior, and conditions as correlated as they are alike: exp(-d²/2), d their distance in
standard deviations of the known variables. Given the constants all is normal, so the likelihood is closed; draws of the
posterior come from sequential Monte Carlo on standard normal scores of the constants.

What the data tell is asked of the draws (spread after by spread before, along any direction of the scores), and of the
Fisher information of the emulated responses, whose eigenvectors are combinations of constants.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.emulation.gaussian_process import Emulator, Quality
from reporting.emulation.sequential_sampler import PARTICLES, sample_posterior
from reporting.errors import ReportError

Interval = tuple[float, float]
CONFIDENCE = 0.95
# A direction whose spread the data leave above this share of the prior's is not told by them.
NOT_TOLD, TOLD = 0.8, 0.5
NAMED = 0.3  # least weight of a constant that belongs to a direction
POOR_FIT = 3.0  # standard deviations
_MOST_NUMBERS = 4_000_000  # kernel values at a time
_STEP = 0.05  # of a score, for derivatives
_LEAST_SIGMA = 1e-5  # of a response's spread: repeated values of a specimen differ by sigma alone, however small
_BEYOND = 0.1  # share of draws outside the rows that is noted


@dataclass(frozen=True)
class Measured:
    """Measured values (m,)."""

    response: tuple[str, ...]
    value: Array
    sigma: Array  # standard uncertainty
    specimen: tuple[str, ...]
    known: Array  # values of the variables, shape (m, d); NaN for constants and what is not known


@dataclass(frozen=True)
class Prior:
    """What is assumed of the variables (d,) before the measurements."""

    variables: tuple[str, ...]
    constants: tuple[str, ...]  # of them
    values: Callable[[Array], Array]  # standard normal scores of the constants (p, k) to their values (p, k)
    mean: Array  # of each variable, shape (d,)
    std: Array  # of each variable, shape (d,)


@dataclass(frozen=True)
class Discrepancy:
    """The standard deviation of what the model lacks in a response, in its unit."""

    scale: float  # its value, or the scale of its half-normal prior
    estimated: bool


@dataclass(frozen=True)
class Constant:
    """A constant before and after."""

    name: str
    prior_mean: float
    prior_std: float
    mean: float
    std: float
    interval: Interval  # 95 %
    spread: float  # of its standard score after, by that before: 1 if the data tell nothing of it


@dataclass(frozen=True)
class Direction:
    """A combination of constants, an eigenvector of the Fisher information."""

    weights: dict[str, float]  # of the constants' standard scores; their squares add up to 1
    fisher: float  # standard deviation that the information leaves, by the prior's
    spread: float  # of the draws, by the prior's

    @property
    def text(self) -> str:
        """The combination in words, its main constants only."""
        parts = sorted(self.weights.items(), key=lambda each: -abs(each[1]))
        parts = [(name, w) for name, w in parts if abs(w) >= NAMED]
        if len(parts) == 1:
            return parts[0][0]
        sign = 1 if parts[0][1] > 0 else -1
        words = [f"{'+' if sign * w > 0 else '-'} {abs(w):.2f} {name}" for name, w in parts]
        return " ".join(words).removeprefix("+ ")


@dataclass(frozen=True)
class Fitted:
    """A measurement beside what the calibrated model says of it."""

    response: str
    specimen: str
    value: float
    predicted: float
    std: float  # of the difference: constants, other variables, emulator, discrepancy, measurement
    emulator_std: float  # the emulator's part
    score: float  # difference by its standard deviation


@dataclass(frozen=True)
class Calibration:
    """Constants from measurements; what the data tell comes first."""

    told: tuple[str, ...]  # sentences
    constants: tuple[Constant, ...]
    correlations: tuple[tuple[str, str, float], ...]  # of the draws of each two
    directions: tuple[Direction, ...]  # the best told first
    discrepancies: dict[str, tuple[float, Interval]]  # mean and 95 % interval of estimated ones, in the unit
    fitted: tuple[Fitted, ...]
    quality: dict[str, Quality]
    notes: tuple[str, ...]
    draws: dict[str, Array]  # of the constants, row by row, along their main direction
    units: dict[str, str] = field(default_factory=dict)  # of the responses

    def holds(self, values: Mapping[str, float], share: float = CONFIDENCE) -> bool:
        """Return whether values of the constants lie in the ellipsoid around the draws' mean that has this share."""
        x = np.column_stack(list(self.draws.values()))
        away = x - x.mean(axis=0)
        inverse = np.linalg.pinv(np.atleast_2d(np.cov(x.T)))
        asked = np.array([values[name] for name in self.draws]) - x.mean(axis=0)
        radius = np.quantile(np.einsum("ij,jk,ik->i", away, inverse, away), share)
        return bool(asked @ inverse @ asked <= radius)


class _Model:
    """Likelihood and predictions of the measurements, at standard scores of constants and discrepancies."""

    def __init__(
        self,
        emulators: Mapping[str, Emulator],
        measured: Measured,
        prior: Prior,
        discrepancies: Mapping[str, Discrepancy],
    ) -> None:
        self.emulators, self.measured, self.prior = emulators, measured, prior
        self.columns = [prior.variables.index(name) for name in prior.constants]
        self.responses = tuple(dict.fromkeys(measured.response))
        self.discrepancies = {name: discrepancies[name] for name in self.responses}
        self.estimated = [name for name, each in self.discrepancies.items() if each.estimated]
        self.dimension = len(self.columns) + len(self.estimated)
        self.rows = {
            name: np.array([i for i, each in enumerate(measured.response) if each == name]) for name in self.responses
        }

    @cached_property
    def same_specimen(self) -> NDArray[np.bool_]:
        names = np.array(self.measured.specimen)
        return np.asarray(names[:, None] == names[None, :])

    @cached_property
    def measurement_variance(self) -> Array:
        """The variances of the measurements (m,), never so small that a covariance is singular by rounding."""
        spread = [math.hypot(self.emulators[r].unit, self.discrepancies[r].scale) for r in self.measured.response]
        return np.asarray(self.measured.sigma**2 + (_LEAST_SIGMA * np.array(spread)) ** 2)

    @cached_property
    def apart(self) -> Array:
        """The squared distances of the conditions, in standard deviations of the variables, shape (m, m)."""
        std = np.where(self.prior.std > 0, self.prior.std, 1.0)
        place = np.nan_to_num((self.measured.known - self.prior.mean) / std)
        return np.asarray(np.sum((place[:, None, :] - place[None, :, :]) ** 2, axis=-1))

    def likelihood(self, scores: Array) -> Array:
        """Return the logarithm (p,) of the likelihood at scores (p, dimension), without its constant."""
        count = max(1, _MOST_NUMBERS // max(1, self.measured.value.size * max(e.x.shape[0] for e in self._used)))
        parts = [scores[first : first + count] for first in range(0, len(scores), count)]
        return np.concatenate([self._likelihood(part) for part in parts])

    def _likelihood(self, scores: Array) -> Array:
        mean, covariance = self.explain(scores)
        factor = np.linalg.cholesky(covariance)
        left = np.linalg.solve(factor, (self.measured.value - mean)[..., None])[..., 0]
        logarithm = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
        return np.asarray(-0.5 * np.sum(left**2, axis=-1) - logarithm)

    @property
    def _used(self) -> list[Emulator]:
        return [self.emulators[name] for name in self.responses]

    def explain(self, scores: Array) -> tuple[Array, Array]:
        """Return means (p, m) and covariances (p, m, m) of what is measured, with all that it may differ by."""
        mean, covariance, _ = self.predict(scores)
        return mean, covariance + self.lacking(scores) + np.diag(self.measurement_variance)

    def predict(self, scores: Array) -> tuple[Array, Array, Array]:
        """Return means (p, m), covariances (p, m, m) without discrepancies, and the emulators' own variances (p, m)."""
        known, prior = self.measured.known, self.prior
        p, m, d = len(scores), *known.shape
        open_ = np.isnan(known)
        x = np.broadcast_to(np.where(open_, prior.mean, known), (p, m, d)).copy()
        x[:, :, self.columns] = prior.values(scores[:, : len(self.columns)])[:, None, :]
        std = prior.std.copy()
        std[self.columns] = 0.0
        mean, covariance, slope = np.empty((p, m)), np.zeros((p, m, m)), np.empty((p, m, d))
        same = self.same_specimen & (self.apart == 0)
        for name, emulator in zip(self.responses, self._used, strict=True):
            at = self.rows[name]
            mean[:, at], own = emulator.predict(x[:, at])
            covariance[:, at[:, None], at] = own + emulator.scatter**2 * same[np.ix_(at, at)]
            slope[:, at] = emulator.gradient(x[:, at])
        own_variance = np.diagonal(covariance, axis1=-2, axis2=-1).copy()
        slope *= open_ * std
        covariance += (slope @ np.swapaxes(slope, -1, -2)) * self.same_specimen
        return mean, covariance, own_variance

    def lacking(self, scores: Array) -> Array:
        """Return the covariances of the discrepancies, shape (p, m, m)."""
        m = self.measured.value.size
        covariance = np.zeros((len(scores), m, m))
        for name, variance in self.lacking_std(scores).items():
            at = self.rows[name]
            covariance[:, at[:, None], at] = variance[:, None, None] ** 2 * np.exp(-0.5 * self.apart[np.ix_(at, at)])
        return covariance

    def lacking_std(self, scores: Array) -> dict[str, Array]:
        """Return the standard deviation of each response's discrepancy, shape (p,)."""
        found = {name: np.full(len(scores), each.scale) for name, each in self.discrepancies.items()}
        for j, name in enumerate(self.estimated, len(self.columns)):
            found[name] = self.discrepancies[name].scale * np.abs(scores[:, j])
        return found


def calibrate(
    emulators: Mapping[str, Emulator],
    measured: Measured,
    prior: Prior,
    discrepancies: Mapping[str, Discrepancy],
    *,
    seed: int = 0,
    particles: int = PARTICLES,
) -> Calibration:
    """Return the constants that the measurements suggest; ReportError: an emulator predicts too badly."""
    responses = dict.fromkeys(measured.response)
    refused = [f"{name}: {why}" for name in responses if (why := emulators[name].quality.refusal)]
    if refused:
        raise ReportError("\n  ".join(["the rows do not predict what was measured:", *refused]))
    model, k = _Model(emulators, measured, prior, discrepancies), len(prior.constants)
    found = sample_posterior(model.likelihood, model.dimension, seed, particles)
    scores = found.draws
    values = prior.values(scores[:, :k])
    order = np.argsort(_main_direction(scores[:, :k]), kind="stable")
    draws = {name: values[order, j] for j, name in enumerate(prior.constants)}
    directions = _directions(model, scores, k)
    constants = tuple(_constant(prior, j, values[:, j], scores[:, j]) for j in range(k))
    fitted = _fitted(model, scores)
    together = np.atleast_2d(np.corrcoef(values.T))
    return Calibration(
        told=tuple(_conclusions(constants, directions)),
        constants=constants,
        correlations=tuple(
            (prior.constants[i], prior.constants[j], float(together[i, j]))
            for i, j in zip(*np.triu_indices(k, 1), strict=True)
        ),
        directions=directions,
        discrepancies={
            name: (float(std.mean()), _interval(std))
            for name, std in model.lacking_std(scores).items()
            if name in model.estimated
        },
        fitted=fitted,
        quality={name: emulators[name].quality for name in model.responses},
        notes=tuple(_notes(model, values, fitted)),
        draws=draws,
    )


def _constant(prior: Prior, j: int, values: Array, scores: Array) -> Constant:
    column = prior.variables.index(prior.constants[j])
    return Constant(
        name=prior.constants[j],
        prior_mean=float(prior.mean[column]),
        prior_std=float(prior.std[column]),
        mean=float(values.mean()),
        std=float(values.std(ddof=1)),
        interval=_interval(values),
        spread=float(scores.std(ddof=1)),
    )


def _interval(values: Array) -> Interval:
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def _main_direction(scores: Array) -> Array:
    """Return the draws' places along the direction in which they differ most, shape (p,)."""
    away = scores - scores.mean(axis=0)
    direction = np.linalg.eigh(away.T @ away)[1][:, -1]
    return np.asarray(away @ (direction * np.sign(direction[np.argmax(np.abs(direction))])))


def _directions(model: _Model, scores: Array, k: int) -> tuple[Direction, ...]:
    """Return the eigenvectors of the Fisher information at the mean of the draws, the best determined first."""
    centre = scores.mean(axis=0)
    centre[k:] = np.sqrt(np.mean(scores[:, k:] ** 2, axis=0))  # signs of a half-normal scale mean nothing
    steps = np.zeros((k, centre.size))
    steps[:, :k] = _STEP * np.eye(k)
    mean, covariance = model.explain(np.concatenate([centre[None], centre + steps, centre - steps]))
    slope = (mean[1 : k + 1] - mean[k + 1 :]).T / (2 * _STEP)
    information = slope.T @ np.linalg.solve(covariance[0], slope)
    eigenvalues, vectors = np.linalg.eigh((information + information.T) / 2)
    return tuple(
        Direction(
            weights=dict(zip(model.prior.constants, map(float, vector), strict=True)),
            fisher=1 / math.sqrt(1 + max(float(eigenvalue), 0.0)),
            spread=float((scores[:, :k] @ vector).std(ddof=1)),
        )
        for eigenvalue, vector in zip(eigenvalues[::-1], vectors.T[::-1], strict=True)
    )


def _conclusions(constants: tuple[Constant, ...], directions: tuple[Direction, ...]) -> list[str]:
    """Return what the data tell, and what they cannot, in sentences."""
    words = []
    for each in directions:
        named = [name for name, w in each.weights.items() if abs(w) >= NAMED]
        left = f"{100 * min(each.spread, 1.0):.0f} % of its spread remains"
        if each.spread < NOT_TOLD:
            how = "" if each.spread <= TOLD else " a little"
            words.append(f"The data tell{how} {each.text}: {left}.")
        elif len(named) == 1:
            words.append(f"The data do not tell {each.text}: {left}; what is said of it is the campaign's assumption.")
        else:
            words.append(f"The data cannot tell {' and '.join(named)} apart: of {each.text}, {left}.")
    apart = [each.name for each in constants if each.spread >= NOT_TOLD]
    if len(constants) > 1 and apart:
        words.append(f"Not known better than before, each for itself: {', '.join(apart)}.")
    return words


def _fitted(model: _Model, scores: Array) -> tuple[Fitted, ...]:
    """Return each measurement beside its prediction over the draws."""
    chosen = scores[:: max(1, len(scores) // 200)]
    mean, covariance, own = model.predict(chosen)
    lacking = model.lacking(chosen)
    total = np.diagonal(covariance + lacking, axis1=-2, axis2=-1).mean(axis=0) + mean.var(axis=0)
    std, at = np.sqrt(total + model.measured.sigma**2), mean.mean(axis=0)
    own_std = np.sqrt(np.maximum(own.mean(axis=0), 0.0))
    data = model.measured
    columns = (data.response, data.specimen, data.value, at, std, own_std, (data.value - at) / std)
    return tuple(
        Fitted(response, specimen, *map(float, numbers)) for response, specimen, *numbers in zip(*columns, strict=True)
    )


def _notes(model: _Model, values: Array, fitted: tuple[Fitted, ...]) -> list[str]:
    """Return what to know about the numbers."""
    notes = []
    for each in fitted:
        if abs(each.score) > POOR_FIT:
            notes.append(
                f"{each.response} of specimen {each.specimen}: measured {each.value:.5g}, explained"
                f" {each.predicted:.5g} ± {each.std:.2g}: no value of the constants explains it; look at the"
                " measurement, and at the model"
            )
    blurred = sorted({each.response for each in fitted if each.emulator_std**2 > 0.5 * each.std**2})
    if blurred:
        notes.append(
            f"{', '.join(blurred)}: more than half of the uncertainty is the emulator's; more rows of the campaign"
            " would narrow the intervals"
        )
    for j, name in zip(model.columns, model.prior.constants, strict=True):
        rows = np.concatenate([e.centre[j] + e.scale[j] * e.x[:, j] for e in model._used])
        draws = values[:, model.columns.index(j)]
        share = float(np.mean((draws < rows.min()) | (draws > rows.max())))
        if share > _BEYOND:
            notes.append(
                f"{name}: {100 * share:.0f} % of the draws lie beyond the rows of the campaign; widen its distribution"
            )
    return notes
