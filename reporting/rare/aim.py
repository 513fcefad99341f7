"""Targets of importance sampling: the centres of the rejects, from the runs of another campaign.

The best centre of a normal component of unit spread is the centre of the rejects in production, E[z | reject]
(cross-entropy method: R. Rubinstein, D. Kroese, 2004). If the campaign has enough rejects, it is estimated from them
and their weights; if a few weights dominate, all are raised to a power below 1, which brings them closer together.
Otherwise a quadratic model of the response, fitted to all runs, replaces the mechanism, and its rejects are found level
by level (subset simulation: S.-K. Au, J. Beck, 2001): a tenth of the simulated runs reach the next level, and Markov
chains that start there keep to it, each run with the value of the model plus one of its residuals. It costs no run of
the mechanism, and finds rejects in any direction and any number of variables. Rejects in different directions get one
component each; if these are too many to be told apart, one component without a centre reaches as far as they lie.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reporting.arrays import Array, random_rows
from reporting.errors import ReportError

MOST = 40  # largest number of directions
MOST_AIMS = 90  # components of a campaign; the least of more are left out
NO_BETTER = 4  # numbers of directions in a row that no longer improve the criterion
MOST_POINTS = 2000
ROUNDS = 40  # of EM: centres need not be exact
LEAST_VARIANCE = 1.0  # variance of the components that draw the samples
LEAST_PART = 0.02  # of the rejects: smaller parts are left to the wide component

Parts = tuple[tuple[tuple[float, ...], float], ...]
Inputs = Callable[[Array], Array]
FEWEST = 10  # rejects needed to estimate their centre
EVEN = 30  # effective rejects (or half of all) below which weights are raised to a power
OFTEN = 0.01  # of production: plain runs find such rejects, so no component aims there
NEVER = 1e-13  # of production: no component aims there either
AIMED, WIDE = 0.8, 0.1  # shares of the runs of aimed components, and of the wide one for other rejects
WIDE_SCALE = 2.0
LOOSE = 1.5  # variance of the rejects around their centres above which the centres do not tell where they lie
SAME = 0.5  # standard scores: centres closer than this are merged
LEVEL_RUNS, LEVEL_SHARE = 10_000, 0.1  # simulated runs of a level, and how many of them reach the next one
STEPS = 10  # of each chain in a level
ACCEPTED = 0.4  # share of the steps that stay in the level; the length of the steps is adapted to it
_LARGEST = 8.0  # standard scores of a centre
_WIDEST = 5.0  # scale of a component
_DECIMALS = 2  # of a centre
_TINY = 1e-300  # least spread of a variable


# Directions of rejects: a mixture of normal distributions with a common spread, fitted by EM; BIC sets their number.
#
# A. Dempster, N. Laird, D. Rubin, "Maximum likelihood from incomplete data via the EM algorithm", 1977; G. Schwarz,
# "Estimating the dimension of a model", 1978, with the effective number of weighted points as the sample size.


def directions(points: Array, weights: Array) -> tuple[Parts, float]:
    """Return centre and share of weight of the points, (m, d), in each direction, and the variance around them."""
    rows = random_rows(weights.size)[:MOST_POINTS]
    x, w = points[rows], weights[rows] / weights[rows].sum()
    effective, d = 1.0 / float(w @ w), x.shape[1]
    centres, shares, least, best_k = (w @ x)[None], np.ones(1), np.inf, 1
    best = centres, shares, LEAST_VARIANCE
    for k in range(1, min(MOST, x.shape[0]) + 1):
        if k > 1:
            # The new centre is the heaviest point far from all others, so that the result depends on no random start.
            distance = np.min(_squares(x, centres), axis=1)
            centres = np.vstack([centres, x[np.argmax(w * distance)]])
            shares = np.append(shares * (k - 1) / k, 1.0 / k)
        centres, shares, variance, likelihood = _fitted(x, w, centres, shares)
        # Parameters: k centres, k - 1 shares and the common variance.
        criterion = -2.0 * effective * likelihood + k * (d + 1) * np.log(effective)
        if criterion < least:
            best, least, best_k = (centres, shares, variance), criterion, k
        elif k >= best_k + NO_BETTER:
            break
    kept = best[1] >= LEAST_PART
    parts = best[1][kept] / best[1][kept].sum()
    found = zip(best[0][kept], parts, strict=True)
    return tuple((tuple(centre.tolist()), float(part)) for centre, part in found), best[2]


def _squares(x: Array, centres: Array) -> Array:
    """Return the squared distance of each point from each centre, shape (n, k)."""
    products = np.sum(x * x, axis=1)[:, None] - 2.0 * x @ centres.T + np.sum(centres * centres, axis=1)
    return np.asarray(np.maximum(products, 0.0))


def _fitted(x: Array, w: Array, centres: Array, shares: Array) -> tuple[Array, Array, float, float]:
    """Return centres, shares and variance after EM from the given ones, and the mean log-density."""
    d, variance, likelihood = x.shape[1], 1.0, -np.inf
    for _ in range(ROUNDS):
        squares = _squares(x, centres)
        logs = np.log(shares) - 0.5 * squares / variance - 0.5 * d * np.log(2.0 * np.pi * variance)
        largest = logs.max(axis=1, keepdims=True)
        density = np.exp(logs - largest)
        total = density.sum(axis=1, keepdims=True)
        likelihood = float(w @ (largest + np.log(total))[:, 0])
        belongs = w[:, None] * density / total
        shares = np.maximum(belongs.sum(axis=0), 1e-12)
        centres = belongs.T @ x / shares[:, None]
        variance = max(float(np.sum(belongs * squares)) / d, LEAST_VARIANCE)
    return centres, shares / shares.sum(), variance, likelihood


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
    scale: float = 1.0  # spread of the scores around a centre
    part: float = 1.0  # of the runs for this response


def find_targets(
    z: Array,
    weights: Array,
    responses: Mapping[str, Array],
    limits: Mapping[str, tuple[float | None, float | None]],
    inputs: Inputs = np.asarray,
) -> tuple[Target, ...]:
    """Return the expected location of the rejects of each limit; raise ReportError if values are too few for a model.

    `z` are the standard scores of the variables, shape (n, d); `inputs` turns them into the values of the variables: a
    mechanism answers to these, so a model of them holds farther out. `responses` are NaN where a run has none.
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
        sides = [
            _target(f"{name} {words} {limit:g}", z[finite], weights[finite], sign * (y[finite] - limit), inputs)
            for limit, sign, words in ((lsl, -1.0, "below"), (usl, 1.0, "above"))
            if limit is not None
        ]
        # The worse side decides; the root leaves the other enough where the estimates are wrong by a factor.
        roots = [bool(side.centres) * side.ppm**0.5 for side in sides]
        targets += [replace(side, part=root / (sum(roots) or 1.0)) for side, root in zip(sides, roots, strict=True)]
    return tuple(targets)


def aims(targets: Sequence[Target], dimensions: int, wide_share: float = WIDE) -> tuple[Aim, ...]:
    """Return the components: aimed runs are divided equally among the responses, and a wide component is added."""
    found = [target for target in targets if target.centres]
    all_parts = sum(target.part for target in found)
    parts = [
        Aim((AIMED + WIDE - wide_share) * part * t.part / all_parts, t.scale, centre, f"{t.name}: {t.by}")
        for t in found
        for centre, part in t.centres
    ]
    wide = Aim(wide_share if parts else AIMED + WIDE, WIDE_SCALE, (0.0,) * dimensions, "rejects that the others miss")
    merged = _merged(parts)
    largest = sorted(merged, key=lambda aim: -aim.share)[:MOST_AIMS]
    rest = 1.0 + sum(aim.share for aim in merged if aim not in largest) / sum(aim.share for aim in largest or (wide,))
    return (*(replace(aim, share=aim.share * rest) for aim in merged if aim in largest), wide)


def _target(name: str, z: Array, weights: Array, beyond: Array, inputs: Inputs) -> Target:
    rejects = beyond > 0.0
    w = weights[rejects]
    share, by, points = float(w.sum()) / weights.size, f"{w.size} rejects", z[rejects]
    if w.size >= FEWEST:  # raised to the largest power, from 1 to 0, at which enough of them are effective
        powers = (w**power for power in np.linspace(1.0, 0.0, 21))
        w = next(v for v in powers if v.sum() ** 2 / (v @ v) >= min(EVEN, 0.5 * w.size))
    else:
        model = _Model(z, beyond, inputs)
        points, w, share = model.rejects()
        by = f"quadratic model of {beyond.size} runs, R2 {model.determination:.3f}"
    if not NEVER < share < OFTEN:
        return Target(name, 1e6 * share, by, ())
    parts, variance = directions(points, w)
    if variance > LOOSE:
        # As many runs inside the rejects as outside: the mean square of their scores is that of the component.
        scale = float(np.sqrt((w @ np.sum(points * points, axis=1)) / w.sum() / points.shape[1]))
        centre = (0.0,) * points.shape[1]
        return Target(name, 1e6 * share, f"{by}, in many directions", ((centre, 1.0),), round(min(scale, _WIDEST), 2))
    clipped = [np.round(np.clip(centre, -_LARGEST, _LARGEST), _DECIMALS) + 0.0 for centre, _ in parts]  # as in a file
    centres = zip(clipped, parts, strict=True)
    return Target(name, 1e6 * share, by, tuple((tuple(centre.tolist()), part) for centre, (_, part) in centres))


class _Model:
    """A quadratic model of a response, shape (n,), over the values of the variables, with its residuals."""

    def __init__(self, z: Array, y: Array, inputs: Inputs) -> None:
        d, x = z.shape[1], inputs(z)
        self._inputs, self._middle, self._spread = inputs, x.mean(axis=0), np.maximum(x.std(axis=0), _TINY)
        x = self._scaled(z)
        # Three runs for each coefficient: the residuals of a model that fits exactly would be too small.
        self._interactions = y.size >= 3 * (1 + 2 * d + d * (d - 1) // 2)
        self._squares = y.size >= 3 * (1 + 2 * d)
        columns, pairs = [np.ones((z.shape[0], 1)), x], np.triu_indices(d, 1)
        columns += [x * x] if self._squares else []
        columns += [x[:, pairs[0]] * x[:, pairs[1]]] if self._interactions else []
        coefficients = np.linalg.lstsq(np.hstack(columns), y, rcond=None)[0]
        self._constant, self._linear, rest = coefficients[0], coefficients[1 : d + 1], coefficients[d + 1 :]
        self._quadratic = np.diag(rest[:d]) if self._squares else np.zeros((d, d))
        if self._interactions:
            self._quadratic[pairs] = rest[d:]
        self._residuals = y - self._value(z)
        spread = float(np.var(y))
        self.determination = 1.0 - float(np.var(self._residuals)) / spread if spread > 0.0 else 0.0
        self._dimensions, self._length = d, 0.5

    def rejects(self) -> tuple[Array, Array, float]:
        """Return standard scores and weights of simulated rejects, and their share of production."""
        # A fixed seed: the same runs always give the same targets.
        rng, keep, share = np.random.Generator(np.random.PCG64(0)), round(LEVEL_SHARE * LEVEL_RUNS), 1.0
        z = rng.standard_normal((LEVEL_RUNS, self._dimensions))
        rest = rng.choice(self._residuals, LEVEL_RUNS)
        while True:
            y = self._value(z) + rest
            beyond = y > 0.0
            if np.count_nonzero(beyond) >= keep or share < NEVER:
                share *= float(np.mean(beyond))
                return z[beyond], np.ones(np.count_nonzero(beyond)), share
            best = np.argsort(-y, kind="stable")[:keep]
            share *= LEVEL_SHARE
            z, rest = self._chains(rng, z[best], rest[best], float(y[best].min()))

    def _chains(self, rng: np.random.Generator, z: Array, rest: Array, level: float) -> tuple[Array, Array]:
        """Return simulated runs of production at or above a level: states of chains that start from runs there."""
        states, rests = [], []
        for _ in range(STEPS):
            step = np.minimum(self._length * z.std(axis=0), 1.0)
            # Production is left as it is by z -> sqrt(1 - s^2) z + s xi, and its residuals by drawing another one.
            new = np.sqrt(1.0 - step * step) * z + step * rng.standard_normal(z.shape)
            other = np.where(rng.random(rest.size) < 0.5, rng.choice(self._residuals, rest.size), rest)
            kept = self._value(new) + other >= level
            self._length = min(self._length * float(np.exp(np.mean(kept) - ACCEPTED)), 1.0)
            z, rest = np.where(kept[:, None], new, z), np.where(kept, other, rest)
            states.append(z)
            rests.append(rest)
        return np.concatenate(states), np.concatenate(rests)

    def _value(self, z: Array) -> Array:
        """Return the model at scores, shape (n, d)."""
        x = self._scaled(z)
        return np.asarray(self._constant + x @ self._linear + np.sum((x @ self._quadratic) * x, axis=1))

    def _scaled(self, z: Array) -> Array:
        """Return the values of the variables at scores, in standard deviations from their means."""
        return np.asarray((self._inputs(z) - self._middle) / self._spread)


def _merged(parts: Sequence[Aim]) -> tuple[Aim, ...]:
    """Return the components; those with nearly the same centre are merged."""
    result: list[Aim] = []
    for part in parts:
        for i, other in enumerate(result):
            if other.scale == part.scale and np.linalg.norm(np.subtract(part.centre, other.centre)) < SAME:
                source = "; ".join(dict.fromkeys((other.source, part.source)))
                result[i] = replace(other, share=other.share + part.share, source=source)
                break
        else:
            result.append(part)
    return tuple(result)
