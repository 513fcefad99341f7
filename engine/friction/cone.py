"""Coulomb's cone K = {|r_T| <= mu r_N} (eq. 3): its projection, and the residual of the friction problem."""

import numpy as np

from engine.jit import inner

LARGEST = 1e7


@inner
def project(mu, r0, r1, r2):
    """Return the point of Coulomb's cone nearest to (r0, r1, r2) = (N, T1, T2)."""
    t = np.sqrt(r1 * r1 + r2 * r2)
    if mu * t <= -r0:  # first: without friction and tangential part only this distinguishes tension from pressure
        return 0.0, 0.0, 0.0
    if t <= mu * r0:
        return r0, r1, r2
    n = (r0 + mu * t) / (1 + mu * mu)
    f = mu * n / t
    return n, f * r1, f * r2


@inner
def residual(nc, mu, r, u, q, scale):
    """Return the relative natural-map residual of a friction problem.

    sqrt(sum_i |s r_i - P_K(s r_i - (u_i + mu_i |u_T,i| N))|^2) / max(|q|, |s r|, |u|), with s = ``scale`` the mean
    diagonal of W = H M^-1 H', which makes an impulse a velocity: the number does not depend on units.
    ``r, u, q`` have shape (nc, 3). A problem of zeros has residual 0; a NaN is returned as it is. Where |s r| is more
    than ``LARGEST`` times |q| and |u| the residual is 1: impulses that grow without end, as they do where there is no
    solution, make the velocities negligible and would meet any tolerance.
    """
    miss, q2, r2, u2 = 0.0, 0.0, 0.0, 0.0
    for i in range(nc):
        slip2 = u[i, 1] * u[i, 1] + u[i, 2] * u[i, 2]
        a, b, c = scale * r[i, 0], scale * r[i, 1], scale * r[i, 2]
        pa, pb, pc = project(mu[i], a - u[i, 0] - mu[i] * np.sqrt(slip2), b - u[i, 1], c - u[i, 2])
        miss += (a - pa) * (a - pa) + (b - pb) * (b - pb) + (c - pc) * (c - pc)
        r2 += a * a + b * b + c * c
        u2 += u[i, 0] * u[i, 0] + slip2
        q2 += q[i, 0] * q[i, 0] + q[i, 1] * q[i, 1] + q[i, 2] * q[i, 2]
    size = max(q2, r2, u2)
    if size == 0.0:
        return 0.0
    if r2 > LARGEST * LARGEST * max(q2, u2):
        return 1.0
    return np.sqrt(miss / size)
