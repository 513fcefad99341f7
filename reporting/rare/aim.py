"""Targets of importance sampling: the centres of the rejects, from the runs of another campaign.

The best centre of a normal component of unit spread is the centre of the rejects in production, E[z | reject]
(cross-entropy method: R. Rubinstein, D. Kroese, 2004). If the campaign has enough rejects, it is estimated from them
and their weights; if a few weights dominate, all are raised to a power below 1, which brings them closer together.
Otherwise a quadratic model of the response, fitted to all runs, replaces the mechanism: simulated runs are drawn from
widened scores, each with the value of the model plus one of its residuals, and their rejects are used. Rejects in
different directions get one component each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError

MOST = 12  # largest number of directions
MOST_POINTS = 2000
ROUNDS = 40  # of EM: centres need not be exact
LEAST_VARIANCE = 1.0  # variance of the components that draw the samples
LEAST_PART = 0.02  # of the rejects: smaller parts are left to the wide component

Parts = tuple[tuple[tuple[float, ...], float], ...]


FEWEST = 10  # rejects needed to estimate their centre
EVEN = 30  # effective rejects (or half of all) below which weights are raised to a power
OFTEN = 0.01  # of production: plain runs find such rejects, so no component aims there
NEVER = 1e-13  # of production: no component aims there either
AIMED, WIDE = 0.8, 0.1  # shares of the runs of aimed components, and of the wide one for other rejects
WIDE_SCALE = 2.0
SAME = 0.5  # standard scores: centres closer than this are merged
IMAGINED = 200_000  # simulated runs of the quadratic model, drawn in pieces
_PIECE = 20_000
_LARGEST = 8.0  # standard scores of a centre
_DECIMALS = 2  # of a centre


# Directions of rejects: a mixture of normal distributions with a common spread, fitted by EM; BIC sets their number.
#
# A. Dempster, N. Laird, D. Rubin, "Maximum likelihood from incomplete data via the EM algorithm", 1977; G. Schwarz,
# "Estimating the dimension of a model", 1978, with the effective number of weighted points as the sample size.


def directions(points: Array, weights: Array) -> Parts:
    """Return the centre of the points in each direction, and its share of the total weight.

    `points`, shape (m, d), are standard scores, m above 0; `weights`, shape (m,), are above 0.
    """
    rows = random_rows(weights.size)[:MOST_POINTS]
    x, w = points[rows], weights[rows] / weights[rows].sum()
    effective, d = 1.0 / float(w @ w), x.shape[1]
    centres, shares, least = (w @ x)[None], np.ones(1), np.inf
    best = centres, shares
    for k in range(1, min(MOST, x.shape[0]) + 1):
        if k > 1:
            # The new centre is the heaviest point far from all others, so that the result depends on no random start.
            distance = np.min(np.sum((x[:, None] - centres) ** 2, axis=2), axis=1)
            centres = np.vstack([centres, x[np.argmax(w * distance)]])
            shares = np.append(shares * (k - 1) / k, 1.0 / k)
        centres, shares, likelihood = _fitted(x, w, centres, shares)
        # Parameters: k centres, k - 1 shares and the common variance.
        criterion = -2.0 * effective * likelihood + k * (d + 1) * np.log(effective)
        if criterion < least:
            best, least = (centres, shares), criterion
    kept = best[1] >= LEAST_PART
    parts = best[1][kept] / best[1][kept].sum()
    return tuple((tuple(centre.tolist()), float(part)) for centre, part in zip(best[0][kept], parts, strict=True))


def _fitted(x: Array, w: Array, centres: Array, shares: Array) -> tuple[Array, Array, float]:
    """Return centres and shares after EM from the given ones, and the mean log-density."""
    d, variance, likelihood = x.shape[1], 1.0, -np.inf
    for _ in range(ROUNDS):
        squares = np.sum((x[:, None] - centres) ** 2, axis=2)
        logs = np.log(shares) - 0.5 * squares / variance - 0.5 * d * np.log(2.0 * np.pi * variance)
        largest = logs.max(axis=1, keepdims=True)
        density = np.exp(logs - largest)
        total = density.sum(axis=1, keepdims=True)
        likelihood = float(w @ (largest + np.log(total))[:, 0])
        belongs = w[:, None] * density / total
        shares = np.maximum(belongs.sum(axis=0), 1e-12)
        centres = belongs.T @ x / shares[:, None]
        variance = max(float(np.sum(belongs * squares)) / d, LEAST_VARIANCE)
    return centres, shares / shares.sum(), likelihood


@dataclass(frozen=True)
class Aim:
    """A component of importance sampling."""

    share: float  # of all runs
    scale: float  # standard deviation of the scores
    centre: tuple[float, ...]  # standard score of each variable
    source: str  # target of the component, and the evidence for it


@dataclass(frozen=True)
class Target:
    """Expected rejects beyond one limit."""

    name: str  # the limit in words
    ppm: float  # approximate share of production beyond it
    by: str  # source of the estimate: counted rejects, or the model
    centres: Parts  # of the rejects, each with its share of them; empty if no component should aim there


def find_targets(
    z: Array, weights: Array, responses: Mapping[str, Array], limits: Mapping[str, tuple[float | None, float | None]]
) -> tuple[Target, ...]:
    """Return the expected location of the rejects of each limit; raise ReportError if values are too few for a model.

    `z` are the standard scores of the variables, shape (n, d), independent in production; `weights`, shape (n,), are 1
    for plain runs; `responses`, shape (n,), are NaN where a run has none.
    """
    targets = []
    for name, (lsl, usl) in limits.items():
        y = responses[name]
        finite = np.isfinite(y)
        needed, known = 3 * (1 + z.shape[1]), int(np.count_nonzero(finite))
        if known < needed:
            raise ReportError(
                f"{known} values of {name} are too few for a model of {z.shape[1]} variables: {needed} are needed;"
                " compute more samples"
            )
        for limit, sign, words in ((lsl, -1.0, "below"), (usl, 1.0, "above")):
            if limit is not None:
                label = f"{name} {words} {limit:g}"
                targets.append(_target(label, z[finite], weights[finite], sign * (y[finite] - limit)))
    return tuple(targets)


def aims(targets: Sequence[Target], dimensions: int) -> tuple[Aim, ...]:
    """Return the components: the aimed runs are divided equally among the targets, and one wide component is added."""
    found = [target for target in targets if target.centres]
    parts = [
        Aim(AIMED * part / len(found), 1.0, centre, f"{t.name}: {t.by}") for t in found for centre, part in t.centres
    ]
    wide = Aim(WIDE if parts else AIMED + WIDE, WIDE_SCALE, (0.0,) * dimensions, "rejects that the others miss")
    return (*_merged(parts), wide)


def _target(name: str, z: Array, weights: Array, beyond: Array) -> Target:
    """Return the target of one limit; ``beyond`` is above 0 for rejects."""
    rejects = beyond > 0.0
    w = weights[rejects]
    share, by, points = float(w.sum()) / weights.size, f"{w.size} rejects", z[rejects]
    if w.size >= FEWEST:
        w = _tempered(w)
    else:
        model = _Model(z, beyond)
        points, w, share = model.rejects()
        by = f"quadratic model of {beyond.size} runs, R2 {model.determination:.3f}"
    if not NEVER < share < OFTEN:
        return Target(name, 1e6 * share, by, ())
    centres = tuple((_rounded(centre), part) for centre, part in directions(points, w))
    return Target(name, 1e6 * share, by, centres)


def _tempered(w: Array) -> Array:
    """Return the weights raised to the largest power, from 1 to 0, at which enough of them are effective."""
    powers = (w**power for power in np.linspace(1.0, 0.0, 21))
    return next(v for v in powers if v.sum() ** 2 / (v @ v) >= min(EVEN, 0.5 * w.size))


class _Model:
    """A quadratic model of a response, shape (n,), over the standard scores, shape (n, d), with its residuals."""

    def __init__(self, z: Array, y: Array) -> None:
        d = z.shape[1]
        # Three runs for each coefficient: the residuals of a model that fits exactly would be too small.
        self._interactions = y.size >= 3 * (1 + 2 * d + d * (d - 1) // 2)
        self._squares = y.size >= 3 * (1 + 2 * d)
        features = self._features(z)
        self._coefficients = np.linalg.lstsq(features, y, rcond=None)[0]
        self._residuals = y - features @ self._coefficients
        spread = float(np.var(y))
        self.determination = 1.0 - float(np.var(self._residuals)) / spread if spread > 0.0 else 0.0
        self._dimensions = d

    def rejects(self) -> tuple[Array, Array, float]:
        """Return standard scores and weights of simulated rejects, and their share of production."""
        # A fixed seed: the same runs always give the same targets.
        rng, d = np.random.Generator(np.random.PCG64(0)), self._dimensions
        found, weights = [np.zeros((0, d))], [np.zeros(0)]
        for _ in range(IMAGINED // _PIECE):
            z = WIDE_SCALE * rng.standard_normal((_PIECE, d))
            y = self._features(z) @ self._coefficients + rng.choice(self._residuals, _PIECE)
            z = z[y > 0.0]
            squares = np.sum(z * z, axis=1)
            found.append(z)
            weights.append(WIDE_SCALE**d * np.exp(-0.5 * squares * (1.0 - WIDE_SCALE**-2)))
        w = np.concatenate(weights)
        return np.concatenate(found), w, float(w.sum()) / IMAGINED

    def _features(self, z: Array) -> Array:
        """Return the columns of the model, shape (n, columns)."""
        first, second = np.triu_indices(z.shape[1], 1)
        columns = [np.ones((z.shape[0], 1)), z]
        columns += [z * z] if self._squares else []
        columns += [z[:, first] * z[:, second]] if self._interactions else []
        return np.hstack(columns)


def _rounded(centre: tuple[float, ...]) -> tuple[float, ...]:
    """Return a centre clipped and rounded as written into a file."""
    return tuple((np.round(np.clip(centre, -_LARGEST, _LARGEST), _DECIMALS) + 0.0).tolist())


def _merged(parts: Sequence[Aim]) -> tuple[Aim, ...]:
    """Return the components; those with nearly the same centre are merged."""
    result: list[Aim] = []
    for part in parts:
        near = next((i for i, other in enumerate(result) if _distance(part, other) < SAME), None)
        if near is None:
            result.append(part)
        else:
            other = result[near]
            result[near] = Aim(
                other.share + part.share,
                other.scale,
                other.centre,
                "; ".join(dict.fromkeys((other.source, part.source))),
            )
    return tuple(result)


def _distance(a: Aim, b: Aim) -> float:
    return float(np.linalg.norm(np.subtract(a.centre, b.centre)))
