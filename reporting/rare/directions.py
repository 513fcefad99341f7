"""Directions of rejects: a mixture of normal distributions with a common spread, fitted by EM; BIC sets their number.

A. Dempster, N. Laird, D. Rubin, "Maximum likelihood from incomplete data via the EM algorithm", 1977; G. Schwarz,
"Estimating the dimension of a model", 1978, with the effective number of weighted points as the sample size.
"""

import numpy as np

from reporting.arrays import Array, random_rows

MOST = 12  # largest number of directions
MOST_POINTS = 2000
ROUNDS = 40  # of EM: centres need not be exact
LEAST_VARIANCE = 1.0  # variance of the components that draw the samples
LEAST_PART = 0.02  # of the rejects: smaller parts are left to the wide component

Parts = tuple[tuple[tuple[float, ...], float], ...]


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
