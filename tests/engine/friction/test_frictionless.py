"""Contacts without friction, by their own small system: the conditions that define the solution, and another solver."""

import numpy as np
import pytest

from engine.friction.arrays import CONVERGED, NOT_CONVERGED, dense_rows
from engine.friction.frictionless import fits, solve_frictionless
from engine.friction.problem import FrictionProblem, solver_arrays
from engine.friction.solver import solve_friction
from engine.jit import kernel
from tests.engine.friction.problems import random_problem

pytestmark = pytest.mark.bits

TIGHT = 1e-12


@kernel
def solved(nc, p, tolerance):
    """Call what only kernels can call."""
    return solve_frictionless(nc, p, tolerance) if fits(nc, p) else -1


def projected(seed):
    """Return a displacement problem: gaps of both signs that a displacement can open, some contacts twice; its rows."""
    rng = np.random.default_rng(seed)
    bodies = int(rng.integers(1, 9))
    # as many contacts as fit into the system of the bodies, see `fits`
    once = random_problem(seed, int(rng.integers(1, 4 if bodies == 1 else 12)), bodies, mass_ratio=1e3)
    copies = rng.integers(0, once.mu.size, int(rng.integers(0, 3)))
    rows = np.concatenate([np.arange(once.mu.size), copies])
    H = once.H.reshape(-1, 3, 6 * bodies)[rows].reshape(-1, 6 * bodies)
    arrays, _ = solver_arrays(FrictionProblem(once.M, H, np.zeros(len(H)), np.zeros(rows.size)))
    N = dense_rows(arrays.rows.node, arrays.rows.G[:, :1], arrays.w.size)[:, 0]
    size = 10.0 ** rng.uniform(-12, 0)
    open_by = rng.uniform(0, 1, once.mu.size)[rows] * (rng.random(once.mu.size) < 0.5)[rows]
    arrays.q[:, 0] = size * (open_by - N @ rng.standard_normal(arrays.w.size))
    arrays.r[:, 0] = np.maximum(-arrays.q[:, 0], 0.0) / np.maximum((N * N).sum(axis=1), 1e-300)
    return arrays, N


def test_the_solution_meets_its_conditions_and_is_that_of_the_general_solver():
    """No contact closes or pulls, one that opens does not push: nearly always at once, else the status says so."""
    failed, taken = 0, 0
    for seed in range(600):
        arrays, N = projected(seed)
        nc, given = len(N), arrays.r.copy()
        status = solved(nc, arrays, TIGHT)
        np.testing.assert_array_equal(arrays.r, given)
        taken += status >= 0
        failed += status == NOT_CONVERGED
        if status != CONVERGED:
            continue
        w, r, q = arrays.w.copy(), arrays.contacts.r[0, :nc].copy(), arrays.q[:, 0]
        u, scale = N @ w + q, max(-q.min(), 1e-300)
        assert r.min() >= 0.0
        assert u.min() >= -1e-8 * scale, seed
        assert np.abs(u[r > 0]).max(initial=0.0) <= 1e-8 * scale, seed
        np.testing.assert_allclose(N.T @ r, w, atol=1e-12 * max(np.abs(N).max() * np.abs(r).max(), 1e-300))
        assert solve_friction(nc, arrays, 1e-11)[0] == CONVERGED
        np.testing.assert_allclose(w, arrays.w, atol=1e-7 * max(np.abs(w).max(), 1e-300), err_msg=str(seed))
    assert taken > 500
    assert failed < 0.02 * taken


def test_what_no_displacement_opens_is_not_solved():
    """A body between two walls that are too close: no guess is confirmed."""
    H = np.zeros((6, 6))
    H[0, 0], H[3, 0] = 1.0, -1.0
    for gaps in ([-1.0, -1.0], [-1.0, 0.5], [-1e-9, -2e-9], [-1.0, 1.0 - 1e-3]):
        arrays, _ = solver_arrays(FrictionProblem(np.eye(6), H, np.zeros(6), np.zeros(2)))
        arrays.q[:, 0] = gaps
        assert solved(2, arrays, 1e-4) == NOT_CONVERGED


def test_more_contacts_than_fit_are_left_to_the_other_solvers():
    problem = random_problem(0, 20, 1)
    assert solved(20, solver_arrays(problem)[0], TIGHT) == -1
