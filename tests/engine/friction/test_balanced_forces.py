"""The forces nearest to given ones that balance a load within Coulomb's cones, which SciPy finds too."""

import numpy as np
import pytest
from scipy.optimize import minimize

from engine.friction.balanced_forces import nearest_balanced


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return effects of contacts, a load that they can carry, their friction, and forces to be near to."""
    draw = np.random.default_rng(seed)
    nc, n = int(draw.integers(1, 8)), int(draw.integers(3, 18))
    H, mu, carried = draw.normal(size=(3 * nc, n)), draw.choice([0.0, 0.1, 0.3, 1.0], nc), draw.normal(size=(nc, 3))
    carried[:, 0] = np.abs(carried[:, 0])
    within = 0.8 * mu * carried[:, 0] / np.hypot(carried[:, 1], carried[:, 2])
    carried[:, 1:] *= np.minimum(within, 1.0)[:, None]
    return H, H.T @ carried.ravel(), mu, draw.normal(size=(nc, 3)) * (seed % 2)


def test_the_forces_balance_and_are_in_their_cones():
    """To 1e-8 of the load, with redundant and with frictionless contacts."""
    for seed in range(60):
        H, load, mu, near = problem(seed)
        r = nearest_balanced(H, load, mu, near)
        assert r is not None, seed
        assert np.linalg.norm(H.T @ r.ravel() - load) <= 2e-8 * np.linalg.norm(load)
        assert np.all(np.hypot(r[:, 1], r[:, 2]) <= mu * r[:, 0] + 1e-7 * np.abs(r).max())


def test_no_others_are_nearer():
    """SciPy finds the same distance, where it finds any: it fails on some of these problems."""
    compared = 0
    for seed in range(20):
        H, load, mu, near = problem(seed)
        r = nearest_balanced(H, load, mu, near)
        assert r is not None
        cones = {"type": "ineq", "fun": lambda x, mu=mu: (mu * x[::3]) ** 2 - x[1::3] ** 2 - x[2::3] ** 2}
        pushes = {"type": "ineq", "fun": lambda x: x[::3]}
        u, s, v = np.linalg.svd(H.T, full_matrices=False)
        rank = s > 1e-10 * s[0]
        rows, right = v[rank], (u[:, rank].T @ load) / s[rank]
        balance = {"type": "eq", "fun": lambda x, rows=rows, right=right: rows @ x - right}
        found = minimize(
            lambda x, near=near: 0.5 * ((x - near.ravel()) ** 2).sum(),
            r.ravel() + 1e-3,
            constraints=[cones, pushes, balance],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-14},
        )
        if found.success:
            compared += 1
            assert np.linalg.norm(r - near) <= np.linalg.norm(found.x - near.ravel()) + 1e-5
    assert compared >= 5


@pytest.mark.parametrize("friction", [0.0, 0.3, 2.0])
def test_a_load_that_pulls_is_balanced_by_nothing(friction):
    """A floor carries what presses, and no more of what slides than friction allows."""
    H = np.eye(3)
    assert nearest_balanced(H, np.array([-1.0, 0, 0]), np.array([friction]), np.zeros((1, 3))) is None
    assert nearest_balanced(H, np.array([1.0, friction + 0.01, 0]), np.array([friction]), np.zeros((1, 3))) is None
    held = nearest_balanced(H, np.array([1.0, 0, 0.9 * friction]), np.array([friction]), np.zeros((1, 3)))
    np.testing.assert_allclose(held, [[1.0, 0, 0.9 * friction]], atol=1e-8)
