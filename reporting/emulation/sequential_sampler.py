"""Draws from a posterior whose prior is standard normal, by sequential Monte Carlo.

Particles drawn from the prior pass a sequence of distributions, prior times likelihood^t, from t = 0 to 1 (Del Moral,
Doucet and Jasra 2006). Each t is as large as half of the effective number of particles allows (Jasra et al. 2011); the
particles are then resampled, and moved by Metropolis steps that leave the distribution unchanged: independent proposals
from the particles' own normal distribution (Chopin 2002), which suit a posterior close to normal, and random walks,
which suit any other, in turn. Nothing has to be tuned, and several modes and bent ridges are found as the prior finds
them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array
from reporting.errors import ReportError

PARTICLES = 2000
_KEPT = 0.5  # share of the effective particles that a larger exponent keeps
_WIDER = 1.3  # factor on the standard deviations of independent proposals, so that they reach the tails
_WALK = 2.38  # Roberts, Gelman and Gilks 1997: the best length of a step, by the root of the dimensions
_REFRESHED, _REFRESHED_LAST = 1.5, 5.0  # accepted moves a particle, on average, at each exponent and at the last
_MOST_PAIRS, _MOST_EXPONENTS = 25, 200


@dataclass(frozen=True)
class Posterior:
    """Draws of equal weight, and how they came about."""

    draws: Array  # standard scores, shape (particles, dimension)
    exponents: int  # distributions between prior and posterior
    accepted: float  # accepted moves a particle, at the last exponent


def sample_posterior(
    log_likelihood: Callable[[Array], Array], dimension: int, seed: int, particles: int = PARTICLES
) -> Posterior:
    """Return draws; the likelihood takes scores (p, dimension) and gives (p,). ReportError: no particle is possible."""
    random = np.random.Generator(np.random.Philox(seed))
    z = random.standard_normal((particles, dimension))
    value = _finite(log_likelihood(z))
    if not np.any(value > -np.inf):
        raise ReportError("no value of the constants that the prior allows explains the measurements; widen the prior")
    t, count, accepted, step = 0.0, 0, 0.0, _WALK / math.sqrt(dimension)
    while t < 1 and count < _MOST_EXPONENTS:
        rise = _largest_rise(value, 1 - t)
        weight = _weights(rise * value)
        t, count = min(t + rise, 1.0), count + 1
        centre = weight @ z
        away = z - centre
        spread = away.T @ (weight[:, None] * away) + 1e-10 * np.eye(dimension)
        factor = np.asarray(np.linalg.cholesky(spread), np.float64)
        chosen = _resampled(weight, random.random())
        z, value, accepted = z[chosen], value[chosen], 0.0
        for _ in range(_MOST_PAIRS):
            if accepted >= (_REFRESHED if t < 1 else _REFRESHED_LAST):
                break
            for walks in (False, True):
                noise = random.standard_normal((particles, dimension)) @ factor.T
                proposed = z + step * noise if walks else centre + _WIDER * noise
                new = _finite(log_likelihood(proposed))
                gain = t * (new - value) + 0.5 * (np.sum(z**2, axis=1) - np.sum(proposed**2, axis=1))
                if not walks:
                    gain = gain + (_log_normal(z, centre, factor) - _log_normal(proposed, centre, factor))
                taken = np.log(random.random(particles)) < gain
                z, value = np.where(taken[:, None], proposed, z), np.where(taken, new, value)
                share = float(taken.mean())
                accepted += share
                if walks:
                    step *= math.exp(share - 0.3)
    if t < 1:
        raise ReportError(f"the posterior is not reached in {count} steps; give the measurements larger uncertainties")
    return Posterior(z, count, accepted)


def _finite(value: Array) -> Array:
    return np.where(np.isnan(value), -np.inf, value)


def _weights(logarithm: Array) -> Array:
    """Return normalised weights."""
    raw = np.exp(logarithm - logarithm.max())
    return np.asarray(raw / raw.sum())


def _largest_rise(value: Array, most: float) -> float:
    """Return the largest rise of the exponent, up to `most`, that keeps half of the particles effective."""
    possible = np.where(value > -np.inf, value, -1e300)
    least = _KEPT * np.count_nonzero(value > -np.inf)

    def effective(rise: float) -> float:
        return float(1 / np.sum(_weights(np.maximum(rise * possible, -1e300)) ** 2))

    if effective(most) >= least:
        return most
    low, high = math.log(1e-300), math.log(most)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(math.exp(middle)) >= least else (low, middle)
    return math.exp(low)


def _resampled(weight: Array, start: float) -> "np.ndarray[tuple[int], np.dtype[np.intp]]":
    """Return the particles that go on, by systematic resampling."""
    places = (np.arange(weight.size) + start) / weight.size
    return np.minimum(np.searchsorted(np.cumsum(weight), places), weight.size - 1)


def _log_normal(z: Array, centre: Array, factor: Array) -> Array:
    """Return the logarithm of the density of independent proposals, without its constant."""
    away = np.linalg.solve(factor, (z - centre).T)
    return np.asarray(-0.5 * np.sum(away**2, axis=0) / _WIDER**2)
