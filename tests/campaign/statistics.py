"""One statistical harness for everything that is drawn: bounds, moments, shape and correlation of samples.

Every check of a sound sampler fails with a probability of at most 1e-5 (moments and correlation: 4.5 standard errors,
7e-6 each; shape: p-values of 1e-5). Seeds are fixed, so a test that passed goes on passing: the rate says how probably
it was unlucky when it was written, and how far off a fault must be to be seen. Samples that are spread more evenly than
random ones pass all the more.
"""

import numpy as np
from scipy.stats import chisquare, kstest, spearmanr

SURE = 4.5  # standard errors
RARE = 1e-5  # p-value
LEAST_EXPECTED = 10.0  # draws of a class of the chi-square test


def check_sample(x, distribution):
    """Check independent values of shape (n,) against a distribution."""
    low, high = distribution.support()
    assert x.min() >= low
    assert x.max() <= high
    check_moments(x, distribution)
    points = np.array(distribution.density_points())
    if points.size:
        assert kstest(x, distribution.cdf).pvalue > RARE
    else:
        assert chi_square(x, distribution) > RARE


def check_moments(x, distribution):
    """Check mean and variance of independent values of shape (n,)."""
    mean, std = distribution.moments()
    n = len(x)
    assert abs(x.mean() - mean) <= SURE * std / np.sqrt(n)
    fourth = np.mean((x - mean) ** 4)
    assert abs(x.var() - std**2) <= SURE * np.sqrt(max(fourth - std**4, 0.0) / n) + 1e-12 * std**2


def chi_square(x, distribution):
    """Return the p-value of separate values of shape (n,): the rare ones are put together with their neighbours."""
    values, counts = np.unique(x, return_counts=True)
    assert np.isfinite(distribution.logpdf(values)).all(), "a value that has no probability"
    observed, expected, before = [], [], 0.0
    for value, count in zip(values, counts, strict=True):
        up_to = float(distribution.cdf(np.array([value]))[0]) * len(x)
        observed.append(count)
        expected.append(up_to - before)
        before = up_to
        if len(expected) > 1 and min(expected[-2:]) < LEAST_EXPECTED:
            observed[-2:], expected[-2:] = [sum(observed[-2:])], [sum(expected[-2:])]
    expected[-1] += len(x) - before
    return chisquare(observed, expected).pvalue if len(observed) > 1 else 1.0


def check_rank_correlation(x, y, rank):
    """Check Spearman's correlation of two columns of shape (n,) of independent samples."""
    # Fisher's transform; for ranks its variance is (1 + r^2 / 2) / (n - 3) (Bonett and Wright, 2000)
    error = np.sqrt((1.0 + rank**2 / 2.0) / (len(x) - 3))
    assert abs(np.arctanh(spearmanr(x, y).statistic) - np.arctanh(rank)) <= SURE * error


def strata(u, count):
    """Return how many numbers of shape (n,) lie in each of ``count`` equal strata of (0, 1)."""
    return np.bincount((u * count).astype(np.int64), minlength=count)
