"""Block Gauss-Seidel: one contact after the other gets the impulses that fit its own velocities.

It never fails and hardly ever ends: a hundred sweeps leave about a thousandth of the load, ten times as many a tenth of
that. So it is the last word on problems on which Newton's methods fail, and, now and then, a start from which they do
not. A sweep costs a small share of a step of theirs, because nothing is factorised. With bilateral rows each impulse
would move all bodies that they connect: there the method does nothing.

The impulses of a contact are found by a few steps of the fixed point r = P_K(r - rho (u + mu |u_T| N)) with its own
Delassus block, rho the inverse of the largest row sum of that block (Jourdan, Alart, Jean, Comput. Methods Appl. Mech.
Engrg. 155, 1998).
"""

import numpy as np

from engine.friction.arrays import add_impulse, finish, relative
from engine.friction.blocks import BODY, ROW
from engine.friction.complementarity import residual
from engine.jit import inner

FIXED_POINT_STEPS = 5  # a contact: more gain nothing, because the next contact changes its velocities again


@inner
def gauss_seidel(nc, p, goal, sweeps):
    """Improve the impulses by sweeps over all contacts; return the residual, infinite with bilateral rows."""
    if p.bilateral.length.shape[0] > 0:
        return np.inf
    c = p.contacts
    _own_blocks(nc, p)
    finish(nc, p)
    for _ in range(sweeps):
        for i in range(nc):
            relative(p.rows, i, p.w, c.u)
            _balance(i, c)
            add_impulse(p.rows, i, c.dr[0, i], c.dr[1, i], c.dr[2, i], p.w)
    finish(nc, p)
    return residual(c, goal.scale, 1.0)


@inner
def _own_blocks(nc, p):
    """Write each contact's Delassus block into A, and the inverse of its largest row sum into x[0]."""
    c = p.contacts
    for i in range(nc):
        largest = 0.0
        for a in range(3):
            row = 0.0
            for b in range(3):
                s = c.compliance[i] if a == b else 0.0
                for run in range(p.rows.node.shape[1]):
                    if p.rows.node[i, run] >= 0:
                        for k in range(ROW * run, ROW * run + BODY):
                            s += p.rows.G[i, a, k] * p.rows.G[i, b, k]
                c.A[3 * a + b, i] = s
                row += abs(s)
            largest = max(largest, row)
        c.x[0, i] = 1.0 / largest if largest > 0.0 else 0.0


@inner
def _balance(i, c):
    """Write into dr how far the impulses of contact i change; u[:, i] holds G w."""
    mu, rho, give = c.mu[i], c.x[0, i], c.compliance[i]
    r0, r1, r2 = c.r[0, i], c.r[1, i], c.r[2, i]
    u0, u1, u2 = c.q[0, i] + c.u[0, i] + give * r0, c.q[1, i] + c.u[1, i] + give * r1, c.q[2, i] + c.u[2, i] + give * r2
    for _ in range(FIXED_POINT_STEPS):
        d0, d1, d2 = r0 - rho * (u0 + mu * np.sqrt(u1 * u1 + u2 * u2)), r1 - rho * u1, r2 - rho * u2
        pull = np.sqrt(d1 * d1 + d2 * d2)
        if mu * pull <= -d0:
            d0, d1, d2 = 0.0, 0.0, 0.0
        elif pull > mu * d0:
            d0 = (d0 + mu * pull) / (1.0 + mu * mu)
            d1, d2 = d1 * (mu * d0 / pull), d2 * (mu * d0 / pull)
        d0, d1, d2 = d0 - r0, d1 - r1, d2 - r2
        r0, r1, r2 = r0 + d0, r1 + d1, r2 + d2
        u0 += c.A[0, i] * d0 + c.A[1, i] * d1 + c.A[2, i] * d2
        u1 += c.A[3, i] * d0 + c.A[4, i] * d1 + c.A[5, i] * d2
        u2 += c.A[6, i] * d0 + c.A[7, i] * d1 + c.A[8, i] * d2
    c.dr[0, i], c.dr[1, i], c.dr[2, i] = r0 - c.r[0, i], r1 - c.r[1, i], r2 - c.r[2, i]
    c.r[0, i], c.r[1, i], c.r[2, i] = r0, r1, r2
