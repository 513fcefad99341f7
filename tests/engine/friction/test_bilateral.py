"""Tied rows: against the dense solution by a null space, redundant rows, long chains, with contacts."""

import numpy as np
import pytest

from engine.friction.arrays import CONVERGED
from engine.friction.bilateral import factorise_bilateral, hold_bilateral
from engine.friction.solver import solve_friction
from tests.each import each
from tests.engine.friction.chains import dense_bilateral, dense_rows, tied_bodies
from tests.engine.friction.problems import project_cone

pytestmark = pytest.mark.bits

CASES = [
    {"links": 1, "joint": 3},
    {"links": 6},
    {"links": 8, "tree": True},
    {"links": 8, "tree": True, "redundant": True},
    {"links": 12, "joint": 3, "redundant": True},
]


def impulse_of(rows, w, i):
    """Return the impulse of row i: J' times it is what the row adds to the velocities."""
    return -w[rows.at[i]] / rows.length[i] if rows.length[i] > 0 else 0.0


def free_directions(J):
    """Return an orthonormal basis of the velocities that the ties allow."""
    _, s, V = np.linalg.svd(J)
    return V[np.sum(s > 1e-9 * s[0]) :].T


@each("case", CASES)
@each("seed", range(3))
def test_ties_hold_by_the_least_change_of_the_velocities(case, seed):
    """J w + c = 0 with the w of least norm, as numpy's least squares give it; redundant rows included."""
    p, n = tied_bodies(seed, **case)
    J = dense_bilateral(p, n)
    c = J @ np.random.default_rng(seed).standard_normal(n)
    factorise_bilateral(p.system, p.bilateral)
    hold_bilateral(p.system, p.bilateral, c, p.w)
    expected = np.linalg.lstsq(J, -c, rcond=1e-12)[0]
    w = p.w.copy()
    impulse = np.array([impulse_of(p.bilateral, w, i) for i in range(len(J))])
    w[p.bilateral.at] = 0
    scale = np.abs(expected).max()
    assert np.abs(J @ w + c).max() <= 1e-11 * np.abs(J).max() * scale
    np.testing.assert_allclose(w, expected, atol=1e-9 * scale)
    np.testing.assert_allclose(J.T @ impulse, w, atol=1e-9 * scale)


@each("case", CASES)
@each("seed", range(3))
def test_contacts_between_tied_bodies(case, seed):
    """Coulomb's law holds with the velocities of the projected problem, w = P G' r, P onto what the ties allow."""
    p, n = tied_bodies(seed, contacts=2 * case["links"], **case)
    nc, G, J = len(p.q), dense_rows(p, n), dense_bilateral(p, n)
    Z = free_directions(J)
    p.q[:] = (G @ Z @ np.random.default_rng(seed).standard_normal(Z.shape[1])).reshape(nc, 3)
    factorise_bilateral(p.system, p.bilateral)
    status, _, _ = solve_friction(nc, p, 1e-8)
    assert status == CONVERGED
    velocities = np.setdiff1d(np.arange(n), p.bilateral.at)
    w = Z @ (Z.T @ (G.T @ p.r.ravel()))
    size = max(np.abs(p.q).max(), np.abs(p.u).max())
    np.testing.assert_allclose(p.w[velocities], w[velocities], atol=1e-8 * size)
    np.testing.assert_allclose(p.u.ravel(), G @ w + p.q.ravel(), atol=1e-8 * size)
    for mu, r, u in zip(p.mu, p.r, p.u, strict=True):
        shifted = u + np.array([mu * np.hypot(u[1], u[2]), 0, 0])
        np.testing.assert_allclose(r, project_cone(mu, r - shifted), atol=1e-6 * max(size, np.abs(p.r).max()))
    impulse = np.array([impulse_of(p.bilateral, p.w, i) for i in range(len(J))])
    np.testing.assert_allclose((G.T @ p.r.ravel() + J.T @ impulse)[velocities], w[velocities], atol=1e-7 * size)


def test_a_row_of_zeros_ties_nothing():
    """A drive that is switched off: the rest is as if the row were not there."""
    p, n = tied_bodies(0, 4)
    p.bilateral.J[7] = 0
    J = dense_bilateral(p, n)
    c = J @ np.random.default_rng(0).standard_normal(n)
    factorise_bilateral(p.system, p.bilateral)
    hold_bilateral(p.system, p.bilateral, c, p.w)
    assert impulse_of(p.bilateral, p.w, 7) == 0.0
    p.w[p.bilateral.at] = 0
    np.testing.assert_allclose(p.w, np.linalg.lstsq(J, -c, rcond=1e-12)[0], atol=1e-10)


def hanging_chain(links):
    """Return arrays and size of a straight chain of links of length 1, pinned end to end by three rows each."""
    p, n = tied_bodies(0, links, joint=3)
    for body in range(links):
        for k in range(3):
            row = p.bilateral.J[3 * body + k]
            row[:] = 0
            row[k], row[8 + k] = 1.0, -1.0  # the link's upper end meets the lower end of the one before
            other = (k + 1) % 3
            if k != 2:  # an arm of half a length along the third axis, gyration sqrt(1/12)
                sign = 1.0 if k == 0 else -1.0
                row[3 + other if k == 0 else 3 + 0] = sign * 0.5 * np.sqrt(12)
                row[11 + other if k == 0 else 11 + 0] = sign * 0.5 * np.sqrt(12)
    return p, n


@pytest.mark.slow
def test_a_chain_of_hundreds_of_links_is_held_exactly():
    """The rows of 400 links, ill-conditioned as the square of their number, hold to 1e-11."""
    p, n = hanging_chain(400)
    J = dense_bilateral(p, n)
    c = J @ np.random.default_rng(1).standard_normal(n)
    factorise_bilateral(p.system, p.bilateral)
    hold_bilateral(p.system, p.bilateral, c, p.w)
    w = p.w.copy()
    w[p.bilateral.at] = 0
    assert np.abs(J @ w + c).max() <= 1e-11 * np.abs(c).max()
    np.testing.assert_allclose(w, np.linalg.lstsq(J, -c, rcond=None)[0], atol=1e-8 * np.abs(w).max())
