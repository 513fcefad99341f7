"""Draws from posteriors that are known."""

import numpy as np
import pytest
from scipy.special import ndtr

from reporting.emulation.sequential_sampler import sample_posterior
from reporting.errors import ReportError


def test_a_normal_posterior():
    """A ridge a hundred times longer than wide, against its closed form."""
    rows, sigma = np.array([[1.0, 1.0, 0.0], [0.0, 0.1, 0.3]]), np.array([0.01, 0.05])
    data = np.array([1.5, -0.2])
    found = sample_posterior(lambda z: -0.5 * np.sum(((z @ rows.T - data) / sigma) ** 2, axis=1), 3, seed=1)
    covariance = np.linalg.inv(np.eye(3) + rows.T @ (rows / sigma[:, None] ** 2))
    mean = covariance @ (rows.T @ (data / sigma**2))
    std = np.sqrt(np.diag(covariance))
    assert found.draws.mean(axis=0) == pytest.approx(mean, abs=4 * std.max() / np.sqrt(2000))
    assert np.cov(found.draws.T) == pytest.approx(covariance, abs=0.1 * std.max() ** 2)
    assert (found.draws @ rows[0]).std() == pytest.approx(np.sqrt(rows[0] @ covariance @ rows[0]), rel=0.1)


def test_two_modes_and_a_bent_ridge():
    """Both signs of a square are found, and a product leaves its hyperbola."""
    square = sample_posterior(lambda z: -0.5 * ((z[:, 0] ** 2 - 1.0) / 0.02) ** 2, 1, seed=2).draws[:, 0]
    assert np.mean(square > 0) == pytest.approx(0.5, abs=0.08)
    assert np.abs(square).std() == pytest.approx(0.01, rel=0.15)
    product = sample_posterior(lambda z: -0.5 * (((2 + z[:, 0]) * (2 + z[:, 1]) - 4.0) / 0.02) ** 2, 2, seed=3).draws
    assert np.prod(2 + product, axis=1).std() == pytest.approx(0.02, rel=0.15)
    # the density along the hyperbola, by its formula on a grid
    a = np.linspace(0.2, 6.0, 4000)
    density = np.exp(-0.5 * (a - 2) ** 2 - 0.5 * (4 / a - 2) ** 2) / a
    middle = a[np.searchsorted(np.cumsum(density) / density.sum(), 0.5)]
    sound = 2 + product[:, 0] > 0
    assert np.median(2 + product[sound, 0]) == pytest.approx(middle, abs=0.12)


def test_what_is_impossible_and_what_tells_nothing():
    """A bound cuts the prior; without a likelihood the draws are the prior's; same seed, same draws."""
    bounded = sample_posterior(lambda z: np.where(z[:, 0] > 1.0, 0.0, -np.inf), 1, seed=4).draws[:, 0]
    assert bounded.min() > 1.0
    share = np.sort(ndtr(bounded) - ndtr(1.0)) / (1 - ndtr(1.0))
    assert np.abs(share - np.arange(2000) / 2000).max() < 0.06
    prior = sample_posterior(lambda z: np.zeros(len(z)), 2, seed=5)
    assert prior.draws.std() == pytest.approx(1.0, abs=0.05)
    assert (prior.draws == sample_posterior(lambda z: np.zeros(len(z)), 2, seed=5).draws).all()
    with pytest.raises(ReportError, match="widen the prior"):
        sample_posterior(lambda z: np.full(len(z), -np.inf), 1, seed=6)
