"""Compliant contacts: u = G w + C r + q, against springs that are velocities of their own."""

import numpy as np
import pytest

from engine.friction.arrays import CONVERGED
from engine.friction.blocks import BODY, ROW
from engine.friction.problem import FrictionProblem, solver_arrays
from engine.friction.solver import solve_friction
from tests.each import each
from tests.engine.friction.problems import random_problem

pytestmark = pytest.mark.bits

TOLERANCE = 1e-11


def arrays_of(problem, compliance=None):
    """Return the problem's arrays; with a compliance, as three more velocities of each contact."""
    nc, n = problem.mu.size, problem.M.shape[0]
    G = np.linalg.solve(np.linalg.cholesky(problem.M), problem.H.T).T.reshape(nc, 3, n)
    if compliance is not None:
        springs = np.zeros((nc, 3, 3 * nc))
        for i, c in enumerate(compliance):
            springs[i, :, 3 * i : 3 * i + 3] = np.sqrt(c) * np.eye(3)
        G, n = np.concatenate([G, springs], axis=2), n + 3 * nc
    arrays, white = solver_arrays(FrictionProblem(np.eye(n), G.reshape(3 * nc, n), problem.q, problem.mu))
    place = (ROW * white.number[:, None] + np.arange(BODY)).ravel()[:n]
    arrays.q[:], arrays.mu[:] = problem.q.reshape(nc, 3), problem.mu
    return place, nc, arrays


@each("start", [0.0, 1.0])
@each("kind", ["static", "moving"])
@each("size", [1e-4, 1e-2, 1.0])
def test_a_compliance_is_a_spring_of_its_own(kind, size, start):
    """The same impulses and velocities, with a third of the contacts rigid and some without friction."""
    for seed in range(4):
        problem = random_problem(seed, 12, bodies=4, kind=kind)
        rng = np.random.default_rng(seed)
        compliance = size * rng.uniform(0.5, 2.0, 12) * (np.arange(12) % 3 > 0)
        problem.mu[::5] = 0.0
        wide, nc, own = arrays_of(problem, np.maximum(compliance, 1e-30))
        place, _, inside = arrays_of(problem)
        inside.compliance[:] = compliance
        for arrays in (own, inside):
            arrays.r[:] = start * rng.standard_normal((nc, 3))
        assert solve_friction(nc, own, TOLERANCE)[0] == CONVERGED
        assert solve_friction(nc, inside, TOLERANCE)[0] == CONVERGED
        speed = np.abs(problem.q).max()
        np.testing.assert_allclose(inside.u, own.u, atol=1e-8 * speed)
        np.testing.assert_allclose(inside.w[place], own.w[wide[: place.size]], atol=1e-8 * speed)
