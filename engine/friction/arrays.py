"""The arrays of a friction problem, and the operations that all solvers share.

The problem, whitened (M = I), with bilateral rows J (ideal joints, drives):  w' = (v, l), B w = G' r,
u = G w + C r + q, and Coulomb's law between each r_i and u_i. Without bilateral rows B is the identity, see
`engine.friction.bilateral`. C is diagonal with one compliance per contact, and 0 between rigid bodies.
"""

from typing import NamedTuple

import numpy as np

from engine.arrays import Array, Integers, aligned_zeros
from engine.friction.bilateral import BilateralSystem, solve_bilateral
from engine.friction.blocks import BODY, PIECE, ROW, Elimination, clear
from engine.jit import by_address, inner
from engine.jit.lanes import LANES, fused, read, spread, total, write

CONVERGED = 0
NOT_CONVERGED = 1


@by_address
class ContactRows(NamedTuple):
    """The rows of G: contact i acts on the unknowns of the nodes ``node[i]``; -1: no node."""

    node: np.ndarray  # (nc, runs) int64
    pair: np.ndarray  # (nc, runs, runs) int64, first piece of the system for each pair of nodes, see `blocks`
    G: np.ndarray  # (nc, 3, 8 runs) rows (N, T1, T2): six columns and two zeros per node


@by_address
class ContactLanes(NamedTuple):
    """The numbers of the contacts, eight contacts side by side; entries past the last contact are 0."""

    present: np.ndarray  # (m,) 1 for a contact, 0 past the last one
    mu: np.ndarray  # (m,)
    compliance: np.ndarray  # (m,)
    scale: np.ndarray  # (m,) mean diagonal of the contact's own Delassus block
    unit: np.ndarray  # (m,) the contact's unit of velocity, see `solver`
    q: np.ndarray  # (3, m)
    r: np.ndarray  # (3, m)
    u: np.ndarray  # (3, m)
    x: np.ndarray  # (3, m) scaled impulses
    y: np.ndarray  # (3, m) scaled shifted velocities
    miss: np.ndarray  # (3, m) residual of the definition of y
    dr: np.ndarray  # (3, m)
    du: np.ndarray  # (3, m)
    b: np.ndarray  # (3, m)
    A: np.ndarray  # (9, m) eliminated block: dr = -b - A G dw
    Q: np.ndarray  # (9, m) derivative of the contact's equation with respect to u; in the interior-point method W
    yielding: np.ndarray  # (9, m) (I + C A)^-1 of the interior-point method
    best: np.ndarray  # (3, m) impulses with the smallest residual within an attempt
    base: np.ndarray  # (3, m) impulses to continue from if the natural map fails
    kept: np.ndarray  # (3, m) impulses of the best attempt
    given: np.ndarray  # (3, m) impulses given to start from


@by_address
class FrictionArrays(NamedTuple):
    """A whitened friction problem with at most ``nc`` contacts and ``n`` unknowns, and its workspace.

    The unknowns w are grouped in nodes of six plus two zeros: the velocities of a body, or multipliers of bilateral
    rows.
    """

    rows: ContactRows
    system: Elimination
    bilateral: BilateralSystem
    q: np.ndarray  # (nc, 3) relative velocity without impulses, plus the shift of the impact law
    mu: np.ndarray  # (nc,)
    compliance: np.ndarray  # (nc,) velocity at which a contact yields under an impulse of 1
    r: np.ndarray  # (nc, 3) impulses: starting values on entry, solution on return
    u: np.ndarray  # (nc, 3) relative velocities of the solution
    w: np.ndarray  # (n,) velocity change of the solution
    dw: np.ndarray  # (n,)
    K: np.ndarray  # (48 pieces,) system, see `blocks`
    F: np.ndarray  # (48 nodes,) multipliers, and inverses of the diagonal, of its diagonal pieces
    contacts: ContactLanes


def friction_arrays(system: Elimination, nc: int, runs: int = 2, bilateral: int = 0) -> FrictionArrays:
    """Allocate a problem of ``nc`` contacts, each with at most ``runs`` nodes, and ``bilateral`` rows."""
    nodes, pairs = system.begin.size, system.pair.size
    # m: contacts in whole groups of eight lanes
    n, m, pieces = ROW * nodes, -(-nc // LANES) * LANES, PIECE * (nodes + 2 * pairs)
    per_contact, G, numbers, ones, threes, nines, w, dw, K, F, integers = aligned_zeros(
        (3, nc, 3),
        (nc, 3, ROW * runs),
        (2, nc),
        (5, m),
        (13, 3, m),
        (3, 9, m),
        n,
        n,
        pieces,
        PIECE * nodes,
        nc * runs * (1 + runs),
    )
    node, pair = integers.view(np.int64)[: nc * runs], integers.view(np.int64)[nc * runs :]
    node[:] = -1
    lanes = ContactLanes(*ones, *threes[:9], *nines, *threes[9:])
    lanes.unit[:] = 1.0  # as `solver.restore` leaves it: the residual may be needed before anything is solved
    q, r, u = per_contact
    mu, compliance = numbers
    return FrictionArrays(
        ContactRows(node.reshape(nc, runs), pair.reshape(nc, runs, runs), G),
        system,
        _bilateral_rows(n, pieces, PIECE * nodes, bilateral) if bilateral else NO_ROWS,
        q=q,
        mu=mu,
        compliance=compliance,
        r=r,
        u=u,
        w=w,
        dw=dw,
        K=K,
        F=F,
        contacts=lanes,
    )


def _bilateral_rows(n: int, pieces: int, diagonal: int, bilateral: int) -> BilateralSystem:
    """Allocate bilateral rows and their system with ``n`` unknowns."""
    sizes = (bilateral, 2 * ROW), bilateral, bilateral, pieces, diagonal, n, n, (BODY, BODY)
    J, length, ease, K, F, right, miss, left = aligned_zeros(*sizes)
    at, pair, node = np.zeros(bilateral, np.int64), np.zeros((bilateral, 2), np.int64), np.full((bilateral, 2), -1)
    return BilateralSystem(at, node, pair, J, length, ease, K, F, right, miss, np.full(n, -1), left)


NO_ROWS = _bilateral_rows(0, 0, 0, 0)  # never written to, so all problems without such rows share it


def dense_rows(node: Integers, rows: Array, n: int) -> Array:
    """Return rows stored node by node, shape (m, j, 8 runs), as dense rows, shape (m, j, n)."""
    dense = np.zeros((*rows.shape[:2], n))
    for i, s in np.argwhere(node >= 0):
        at = ROW * node[i, s]
        dense[i, :, at : at + BODY] = rows[i, :, ROW * s : ROW * s + BODY]
    return dense


class Goal(NamedTuple):
    """The condition for a problem to count as solved."""

    tolerance: float  # relative residual to reach
    scale: float  # mean diagonal of the Delassus operator, which converts impulses to velocities


class Effort(NamedTuple):
    """The number of steps allowed to a method."""

    least: int
    most: int
    patience: int  # number of consecutive poor steps after which the method is abandoned


@inner
def take_contacts(nc, p):
    """Copy the problem to the lanes, compute each contact's mean Delassus diagonal, and return the mean of all.

    The diagonal is computed without regard to bilateral rows.
    """
    c, mean = p.contacts, 0.0
    for i in range(c.mu.shape[0]):
        there = i < nc
        c.present[i] = 1.0 if there else 0.0
        c.mu[i] = p.mu[i] if there else 0.0
        c.compliance[i] = p.compliance[i] if there else 0.0
        for k in range(3):
            c.q[k, i] = p.q[i, k] if there else 0.0
            c.r[k, i] = p.r[i, k] if there else 0.0
        s = 0.0
        if there:
            s = 3 * p.compliance[i] + square(p.rows, i)
            mean += s
        c.scale[i] = s / 3 if s > 0.0 else 1.0
    mean /= max(3 * nc, 1)
    return mean if mean > 0.0 else 1.0


@inner
def square(rows, i):
    """Return the sum of squares of contact i's rows."""
    squares = spread(0.0)
    for k in range(3):
        for s in range(rows.node.shape[1]):
            if rows.node[i, s] >= 0:
                g = read(rows.G[i, k], ROW * s)
                squares = fused(g, g, squares)
    return total(squares)


@inner
def give_contacts(nc, p):
    """Copy the impulses and velocities back from the lanes."""
    for i in range(nc):
        for k in range(3):
            p.r[i, k] = p.contacts.r[k, i]
            p.u[i, k] = p.contacts.u[k, i]


@inner
def copy(source, target):
    """Copy three numbers per contact."""
    for k in range(3):
        for i in range(0, source.shape[1], LANES):
            write(read(source[k], i), target[k], i)


@inner
def add_impulse(rows, i, r0, r1, r2, w):
    """Add G_i' r to a vector of unknowns."""
    for s in range(rows.node.shape[1]):
        if rows.node[i, s] >= 0:
            at, k = ROW * rows.node[i, s], ROW * s
            g0, g1, g2 = read(rows.G[i, 0], k), read(rows.G[i, 1], k), read(rows.G[i, 2], k)
            write(fused(r0, g0, fused(r1, g1, fused(r2, g2, read(w, at)))), w, at)


@inner
def relative(rows, i, w, u):
    """Write the three components of G_i w, column i of ``u``."""
    u0, u1, u2 = spread(0.0), spread(0.0), spread(0.0)
    for s in range(rows.node.shape[1]):
        if rows.node[i, s] >= 0:
            y, k = read(w, ROW * rows.node[i, s]), ROW * s
            u0 = fused(read(rows.G[i, 0], k), y, u0)
            u1 = fused(read(rows.G[i, 1], k), y, u1)
            u2 = fused(read(rows.G[i, 2], k), y, u2)
    u[0, i], u[1, i], u[2, i] = total(u0), total(u1), total(u2)


@inner
def all_relative(nc, rows, w, u):
    """Write G w, eight contacts side by side, with zeros past the last contact."""
    for i in range(nc):
        relative(rows, i, w, u)
    for i in range(nc, u.shape[1]):
        u[0, i], u[1, i], u[2, i] = 0.0, 0.0, 0.0


@inner
def finish(nc, p):
    """Write the velocities w and u that result from the impulses r."""
    c = p.contacts
    clear(p.w)
    for i in range(nc):
        add_impulse(p.rows, i, c.r[0, i], c.r[1, i], c.r[2, i], p.w)
    solve_bilateral(p.system, p.bilateral, p.w)
    all_relative(nc, p.rows, p.w, c.u)
    for k in range(3):
        for i in range(0, nc, LANES):
            given = read(c.compliance, i) * read(c.r[k], i)
            write(read(c.q[k], i) + read(c.u[k], i) + given, c.u[k], i)
