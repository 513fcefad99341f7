"""Coulomb's cone K = {|r_T| <= mu r_N} (eq. 3): its projection, and the residual of the friction problem."""

import numpy as np

from engine.jit import inner
from engine.jit.lanes import LANES, choose, larger, read, root, spread, total

GAIN = 100.0  # largest ratio of impulses to velocities in the scale of the data: impulses may grow without limit
TINY = 1e-300
LARGEST = 1e7  # above this ratio of impulses to velocities, the rounding error of u exceeds any tolerance


@inner
def project(mu, r0, r1, r2):
    """Return the projections of (r0, r1, r2) = (N, T1, T2) onto the cones of eight contacts."""
    t = root(r1 * r1 + r2 * r2)
    parts, inside = mu * t <= -r0, t <= mu * r0  # parts: inside the polar cone
    n = (r0 + mu * t) / (1 + mu * mu)
    f = mu * n / larger(t, TINY)
    return (
        choose(parts, 0.0, choose(inside, r0, n)),
        choose(parts, 0.0, choose(inside, r1, f * r1)),
        choose(parts, 0.0, choose(inside, r2, f * r2)),
    )


@inner
def residual(c, scale):
    """Return the relative natural-map residual of a friction problem from the lanes of its contacts.

    sqrt(sum_i |s r_i - P_K(s r_i - (u_i + mu_i |u_T,i| N))|^2) / max(V, min(|s r|, GAIN V)), V = max(|q|, |u|), where
    s = ``scale``, the mean diagonal of W = H M^-1 H', converts an impulse to a velocity. The residual does not depend
    on units. A problem of zeros has residual 0; a NaN is returned unchanged.

    The numerator bounds every violation of Coulomb's law: with e_i the difference inside it, s r_i - e_i lies in K,
    u_i + mu_i |u_T,i| N - e_i in K*, and they are orthogonal. So no contact approaches at more than
    sqrt(1 + mu^2) GAIN V times the residual, however large the impulses are. Where |s r| exceeds ``LARGEST`` V the
    residual is 1.
    """
    misses, impulses, speeds, loads = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for i in range(0, c.mu.shape[0], LANES):
        mu, one, many = read(c.mu, i), 1 / read(c.unit, i), scale * read(c.unit, i)
        u0, u1, u2 = one * read(c.u[0], i), one * read(c.u[1], i), one * read(c.u[2], i)
        r0, r1, r2 = many * read(c.r[0], i), many * read(c.r[1], i), many * read(c.r[2], i)
        q0, q1, q2 = one * read(c.q[0], i), one * read(c.q[1], i), one * read(c.q[2], i)
        slip2 = u1 * u1 + u2 * u2
        p0, p1, p2 = project(mu, r0 - u0 - mu * root(slip2), r1 - u1, r2 - u2)
        misses += (r0 - p0) * (r0 - p0) + (r1 - p1) * (r1 - p1) + (r2 - p2) * (r2 - p2)
        impulses += r0 * r0 + r1 * r1 + r2 * r2
        speeds += u0 * u0 + slip2
        loads += q0 * q0 + q1 * q1 + q2 * q2
    miss, r2, speed2 = total(misses), total(impulses), max(total(loads), total(speeds))
    if r2 > LARGEST * LARGEST * speed2:
        return 1.0
    size = max(speed2, min(r2, GAIN * GAIN * speed2))
    return 0.0 if size == 0.0 and miss == 0.0 else np.sqrt(miss / size)  # with a NaN the size may have stayed 0
