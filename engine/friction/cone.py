"""Coulomb's cone K = {|r_T| <= mu r_N} (eq. 3): its projection, and the residual of the friction problem."""

import numpy as np

from engine.jit import inner

GAIN = 100.0  # impulses count as at most so many times the velocities: they may grow without end, a data scale may not
LARGEST = 1e7  # beyond so many times the velocities the rounding of u exceeds any tolerance


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

    sqrt(sum_i |s r_i - P_K(s r_i - (u_i + mu_i |u_T,i| N))|^2) / max(V, min(|s r|, GAIN V)), V = max(|q|, |u|), with
    s = ``scale`` the mean diagonal of W = H M^-1 H', which makes an impulse a velocity: the number does not depend on
    units. ``r, u, q`` have shape (nc, 3). A problem of zeros has residual 0; a NaN is returned as it is.

    The numerator bounds all that Coulomb's law asks for: with e_i the difference inside it, s r_i - e_i lies in K,
    u_i + mu_i |u_T,i| N - e_i in K*, and they are orthogonal. So no contact approaches at more than
    sqrt(1 + mu^2) GAIN V times the residual, however large the impulses are. Where |s r| is more than ``LARGEST`` V the
    residual is 1.
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
    speed2 = max(q2, u2)
    if r2 > LARGEST * LARGEST * speed2:
        return 1.0
    size = max(speed2, min(r2, GAIN * GAIN * speed2))
    return 0.0 if size == 0.0 else np.sqrt(miss / size)
