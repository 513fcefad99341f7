"""One statistical harness for everything that is drawn: bounds, moments and shape of a sample."""

import numpy as np
from scipy.stats import kstest

SURE = 4.5  # standard errors: a sound sampler fails one check in 150,000


def check_sample(x, distribution):
    """Check values of shape (n,) against a distribution."""
    low, high = distribution.support()
    assert x.min() >= low
    assert x.max() <= high
    mean, std = distribution.moments()
    n = len(x)
    assert abs(x.mean() - mean) <= SURE * std / np.sqrt(n)
    fourth = np.mean((x - mean) ** 4)
    assert abs(x.var() - std**2) <= SURE * np.sqrt((fourth - std**4) / n)
    assert kstest(x, distribution.cdf).pvalue > 1e-5
