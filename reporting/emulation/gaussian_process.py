"""A Gaussian process through the rows of a campaign, with its error cross-validated.

The response, standardised, is a sum of a linear function of the standardised variables with wide prior coefficients, a
smooth function with a Matérn 5/2 covariance and a length for each variable, and the scatter of rows about both:

    cov(y, y') = w (1 + x·x') + s (1 + r + r² / 3) exp(-r) + noise [same row],   r² = 5 Σ (x_j - x'_j)² / l_j²

Lengths, s and noise maximise the marginal likelihood (Rasmussen and Williams, "Gaussian Processes for Machine
Learning", 2006, section 5.4), times a weak prior of the lengths. The error of each row as the others predict it has a
closed form (Dubrule 1983); rows beyond those that are fitted are predicted, too. If these errors are larger than the
process says, of all rows or of the tenth of which it is least sure, its standard deviations are multiplied by what is
missing: far from the rows a process that is right on average says too little.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from reporting import format_numbers
from reporting.arrays import ROUNDING, Array
from reporting.errors import ReportError

FITTED_ROWS = 400  # more would cost more than they gain; the others check
TRIED_ROWS = 150  # of them the lengths are chosen with
CHECKED_ROWS = 2000
LEAST_ROWS = 20
# An emulator that explains less of the variance, or whose 95 % intervals hold less often, is not used.
LEAST_EXPLAINED = 0.9
LEAST_COVERAGE = 0.85
SLOWEST_GAIN = 0.1  # exponent of the error by the number of rows below which more rows are no remedy
WIDE = 10.0  # variance of the linear coefficients, of standardised numbers
_SHORTEST, _LONGEST = math.log(0.1), math.log(100.0)
_LENGTH, _LENGTH_SPREAD = math.log(3.0), 1.5  # prior of the logarithm of a length
_SMOOTH, _NOISE = (math.log(1e-6), math.log(1e2)), (math.log(1e-6), math.log(1.0))
_MOST_STEPS = 80
_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Quality:
    """How well an emulator predicts rows that it was not given."""

    rows: int  # fitted
    checked: int  # predicted: each fitted row from the others, and rows beyond
    q2: float  # explained share of the variance of predicted rows
    coverage: float  # share of predicted rows within their 95 % intervals
    error: float  # root mean square error of predicted rows, in the unit of the response
    needed: int | None  # rows for q2 of 0.9; None if it has it, 0 if more rows are no remedy

    @property
    def refusal(self) -> str:
        """Why the emulator is not used; empty if it is."""
        what = ""
        if self.q2 < LEAST_EXPLAINED:
            what = f"explains {100 * max(self.q2, 0.0):.0f} % of the variance of rows that it was not given"
            what += f"; {100 * LEAST_EXPLAINED:.0f} % are needed"
        elif self.coverage < LEAST_COVERAGE:
            what = f"holds {100 * self.coverage:.0f} % of such rows within its 95 % intervals"
            what += f"; {100 * LEAST_COVERAGE:.0f} % are needed"
        if not what:
            return ""
        more = self.needed or 2 * self.rows
        remedy = "more rows would not help, as the response is not smooth or scatters" if self.needed == 0 else ""
        return f"the emulator {what}: {remedy or f'compute about {format_numbers.grouped(more - self.rows)} more'}"


@dataclass(frozen=True)
class Emulator:
    """A process conditioned on rows; positions and predictions are in the units of variables and response."""

    x: Array  # standardised rows, shape (n, d)
    centre: Array  # of the variables, and their scales, shape (d,)
    scale: Array
    level: float  # of the response, and its scale
    unit: float
    length: Array  # of the standardised variables, shape (d,)
    smooth: float  # variances of the standardised response
    noise: float
    factor: Array  # lower Cholesky factor of the rows' covariance, shape (n, n)
    weights: Array  # inverse covariance times standardised response, shape (n,)
    inflation: float  # factor on standard deviations by cross-validation, at least 1
    quality: Quality

    def without(self, part: int, parts: int) -> "Emulator":
        """Return the emulator of the rows but each `parts`-th from `part` on, with the same lengths."""
        kept = np.arange(len(self.x)) % parts != part
        v = _covariance(self.x, self.x, self.length, self.smooth) @ self.weights + self.noise * self.weights
        factor, weights = _conditioned(self.x[kept], v[kept], (self.length, self.smooth, self.noise))
        return replace(self, x=self.x[kept], factor=factor, weights=weights)

    @property
    def scatter(self) -> float:
        """The standard deviation of a row about the smooth function, in the unit of the response."""
        return self.inflation * math.sqrt(self.noise) * self.unit

    def standard(self, position: Array) -> Array:
        """Return positions (..., d) in standard units of the rows."""
        return np.asarray((position - self.centre) / self.scale)

    def predict(self, position: Array) -> tuple[Array, Array]:
        """Return the means (..., m) at positions (..., m, d), and their covariances (..., m, m), without scatter."""
        z = self.standard(position)
        across = self.covariance(z.reshape(-1, z.shape[-1]), self.x)
        mean = self.level + self.unit * (across @ self.weights).reshape(z.shape[:-1])
        half = solve_triangular(self.factor, across.T, lower=True, check_finite=False).T.reshape(*z.shape[:-1], -1)
        own = _covariance(z, z, self.length, self.smooth)
        return mean, (self.inflation * self.unit) ** 2 * (own - half @ np.swapaxes(half, -1, -2))

    def mean(self, position: Array) -> Array:
        """Return the means (...) at positions (..., d)."""
        z = self.standard(position)
        across = self.covariance(z.reshape(-1, z.shape[-1]), self.x)
        return np.asarray(self.level + self.unit * (across @ self.weights).reshape(z.shape[:-1]))

    def gradient(self, position: Array) -> Array:
        """Return the derivatives (..., d) of the mean by the variables at positions (..., d)."""
        z = self.standard(position)
        flat = z.reshape(-1, z.shape[-1])
        r = _distance(flat, self.x, self.length)
        pull = (5 / 3) * self.smooth * (1 + r) * np.exp(-r) * self.weights
        slope = (pull @ self.x - flat * pull.sum(axis=1)[:, None]) / self.length**2 + WIDE * (self.weights @ self.x)
        return np.asarray((self.unit * slope / self.scale).reshape(z.shape))

    def covariance(self, z: Array, other: Array) -> Array:
        """Return the covariances (m, n) of the standardised function at standardised positions."""
        return _covariance(z, other, self.length, self.smooth)


def fit_emulator(x: Array, y: Array) -> Emulator:
    """Return the emulator of one response (n,) by variables (n, d) that vary; ReportError: too few rows, no spread."""
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    n, d = x.shape
    least = max(LEAST_ROWS, 2 * d)
    if n < least:
        raise ReportError(f"{n} rows have a value; an emulator of {d} variables needs {least}: compute more")
    if not y.std() > ROUNDING * np.abs(y).max():
        raise ReportError("all values are equal, so that they tell nothing; leave the response out")
    fitted = min(n, FITTED_ROWS)
    centre, scale = x[:fitted].mean(axis=0), x[:fitted].std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    level, unit = float(y[:fitted].mean()), float(y[:fitted].std()) or 1.0
    z, v = (x - centre) / scale, (y - level) / unit
    length, smooth, noise = _most_likely(z[:fitted][:TRIED_ROWS], v[:fitted][:TRIED_ROWS])
    fit = _conditioned(z[:fitted], v[:fitted], (length, smooth, noise))
    quality = Quality(fitted, 0, 1.0, 1.0, 0.0, None)
    emulator = Emulator(
        z[:fitted], centre, scale, level, unit, length, smooth, noise, *fit, inflation=1.0, quality=quality
    )
    return _checked(emulator, z, v)


def _checked(emulator: Emulator, z: Array, v: Array) -> Emulator:
    """Return an emulator with its cross-validated quality and inflation; all rows and values are standardised."""
    n, fitted = v.size, emulator.quality.rows
    inverse = cho_solve((emulator.factor, True), np.eye(fitted), check_finite=False)
    variance = 1 / np.diag(inverse)
    error = [emulator.weights * variance]
    sigma = [np.sqrt(variance)]
    if n > fitted:
        beyond = slice(fitted, min(n, fitted + CHECKED_ROWS))
        mean, deviation = _predicted(emulator, z[beyond])
        error.append(v[beyond] - mean)
        sigma.append(deviation)
    errors, sigmas = np.concatenate(error), np.concatenate(sigma)
    relative = (errors / sigmas) ** 2
    unsure = relative[np.argsort(sigmas, kind="stable")[-max(relative.size // 10, 5) :]]
    inflation = max(1.0, math.sqrt(float(relative.mean())), math.sqrt(float(unsure.mean())))
    squares = float(np.mean(errors**2))
    q2 = 1 - squares / float(np.var(v[: errors.size]))
    coverage = float(np.mean(np.abs(errors) <= _NORMAL_95 * inflation * sigmas))
    found = Quality(fitted, errors.size, q2, coverage, emulator.unit * math.sqrt(squares), None)
    if q2 < LEAST_EXPLAINED:
        found = replace(found, needed=_needed(emulator, z, v, q2))
    return replace(emulator, inflation=inflation, quality=found)


def _predicted(emulator: Emulator, z: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation of new rows, all standardised, shape (m,) each."""
    across = _covariance(z, emulator.x, emulator.length, emulator.smooth)
    half = solve_triangular(emulator.factor, across.T, lower=True, check_finite=False)
    own = WIDE * (1 + np.sum(z * z, axis=1)) + emulator.smooth + emulator.noise
    return across @ emulator.weights, np.sqrt(np.maximum(own - np.sum(half**2, axis=0), emulator.noise))


def _needed(emulator: Emulator, z: Array, v: Array, q2: float) -> int:
    """Return the rows for the least explained share, by what half of the rows explain of the others; 0: no number."""
    n, kernel = emulator.quality.rows, (emulator.length, emulator.smooth, emulator.noise)
    half = n // 2
    if half < LEAST_ROWS // 2:
        return 2 * n
    weights = _conditioned(z[:half], v[:half], kernel)[1]
    left = v[half:n] - _covariance(z[half:n], z[:half], *kernel[:2]) @ weights
    unexplained = float(np.mean(left**2) / np.var(v[half:n]))
    gain = math.log(unexplained / (1 - q2)) / math.log(n / half) if unexplained > 0 else 0.0
    if gain < SLOWEST_GAIN:
        return 0
    return int(n * ((1 - q2) / (1 - LEAST_EXPLAINED)) ** (1 / gain)) + 1


def _conditioned(z: Array, v: Array, kernel: tuple[Array, float, float]) -> tuple[Array, Array]:
    """Return Cholesky factor and weights of standardised rows."""
    length, smooth, noise = kernel
    covariance = _covariance(z, z, length, smooth)
    covariance[np.diag_indices_from(covariance)] += noise
    factor = np.asarray(cholesky(covariance, lower=True, check_finite=False))
    return factor, np.asarray(cho_solve((factor, True), v, check_finite=False))


def _most_likely(z: Array, v: Array) -> tuple[Array, float, float]:
    """Return lengths, variance of the smooth function and noise by maximum likelihood, from two starts."""
    n, d = z.shape
    steps = [np.square(z[:, None, j] - z[None, :, j]) for j in range(d)]
    linear = WIDE * (1 + z @ z.T)

    def loss(parameters: Array) -> tuple[float, Array]:
        weight = np.exp(-2 * parameters[:d])
        smooth, noise = np.exp(parameters[d:])
        r = np.sqrt(5 * sum(w * step for w, step in zip(weight, steps, strict=True)))
        decay = np.exp(-r)
        shape = smooth * (1 + r + r * r / 3) * decay
        covariance = linear + shape
        covariance[np.diag_indices(n)] += noise
        try:
            factor = cholesky(covariance, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return 1e25, np.zeros(d + 2)
        inverse = cho_solve((factor, True), np.eye(n), check_finite=False)
        alpha = inverse @ v
        outer = inverse - alpha[:, None] * alpha  # twice the gradient of the loss by the covariance
        bend = outer * (smooth * (5 / 3) * (1 + r) * decay)
        slopes = [0.5 * w * float(np.sum(bend * step)) for w, step in zip(weight, steps, strict=True)]
        slopes += [0.5 * float(np.sum(outer * shape)), 0.5 * noise * float(np.trace(outer))]
        far = (parameters[:d] - _LENGTH) / _LENGTH_SPREAD
        value = 0.5 * float(v @ alpha) + float(np.sum(np.log(np.diag(factor)))) + 0.5 * float(far @ far)
        return value, np.array(slopes) + np.append(far / _LENGTH_SPREAD, [0.0, 0.0])

    bounds = [(_SHORTEST, _LONGEST)] * d + [_SMOOTH, _NOISE]
    starts = (np.r_[np.full(d, math.log(2.0)), 0.0, math.log(1e-2)], np.r_[np.full(d, math.log(6.0)), 2.0, -11.0])
    found = [
        minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _MOST_STEPS})
        for start in starts
    ]
    best = min(found, key=lambda each: float(each.fun)).x
    return np.exp(best[:d]), float(np.exp(best[d])), float(np.exp(best[d + 1]))


def _distance(z: Array, other: Array, length: Array) -> Array:
    """Return sqrt(5) times the scaled distances of positions (..., m, d) and (..., n, d), shape (..., m, n)."""
    a, b = z / length, other / length
    squares = np.sum(a * a, axis=-1)[..., :, None] + np.sum(b * b, axis=-1)[..., None, :]
    return np.asarray(np.sqrt(np.maximum(5 * (squares - 2 * a @ np.swapaxes(b, -1, -2)), 0.0)))


def _covariance(z: Array, other: Array, length: Array, smooth: float) -> Array:
    """Return the covariances of the function at standardised positions (..., m, d) and (..., n, d)."""
    r = _distance(z, other, length)
    return np.asarray(
        WIDE * (1 + z @ np.swapaxes(other, -1, -2)) + smooth * (1 + r + r * r / 3) * np.exp(-r), np.float64
    )
