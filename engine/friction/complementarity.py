"""The contact law as an equation f(r, u) = 0, its derivatives P and Q, and its elimination: eight contacts at a time.

First Coulomb's cone K = {|r_T| <= mu r_N} (eq. 3): its projection, and the residual of the friction problem.

Coulomb's law (eq. 5) reads K* > u + mu |u_T| N  _|_  r < K. Impulses are passed in multiplied by the contact's own
Delassus scale s, so that r and u are both velocities here, and f' = P s dr + Q du. Two equations are equivalent to it:

- the natural map r - P_K(r - (u + mu |u_T| N)), piecewise smooth: one or two Newton steps from a nearby start;
- the smoothed Fischer-Burmeister function. With a = (mu r_N, r_T) and b = (u_N + mu |u_T|, mu u_T), both scaled by
  1/max(1, mu), the law is Lorentz > a _|_ b < Lorentz, which is the root of phi = a + b - z for tau -> 0,
  z = (a o a + b o b + 2 tau^2 e)^(1/2) with the Jordan product o of the cone. It is smooth and works from any start.

Each formula treats eight contacts that may stick, slide or be open independently: computing the derivatives for all
cases costs less than branching. Contacts without friction have only a normal equation; their others are r_T = 0.
"""

import numpy as np

from engine.jit import inner
from engine.jit.lanes import LANES, choose, larger, read, root, spread, total, write

GAIN = 100.0  # largest ratio of impulses to velocities in the scale of the data: impulses may grow without limit
LARGEST = 1e10  # above this ratio of impulses to velocities, the rounding error of u exceeds any tolerance

TINY = 1e-300


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
def residual(c, scale, share):
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
        p0, p1, p2 = project(mu, r0 - u0 - share * mu * root(slip2), r1 - u1, r2 - u2)
        misses += (r0 - p0) * (r0 - p0) + (r1 - p1) * (r1 - p1) + (r2 - p2) * (r2 - p2)
        impulses += r0 * r0 + r1 * r1 + r2 * r2
        speeds += u0 * u0 + slip2
        loads += q0 * q0 + q1 * q1 + q2 * q2
    miss, r2, speed2 = total(misses), total(impulses), max(total(loads), total(speeds))
    if r2 > LARGEST * LARGEST * speed2:
        return 1.0
    size = max(speed2, min(r2, GAIN * GAIN * speed2))
    return 0.0 if size == 0.0 and miss == 0.0 else np.sqrt(miss / size)  # with a NaN the size may have stayed 0


@inner
def natural_mismatch(mu, r0, r1, r2, u0, u1, u2):
    """Return |f|^2 of the natural map."""
    f0, f1, f2 = project(mu, r0 - u0 - mu * root(u1 * u1 + u2 * u2), r1 - u1, r2 - u2)
    return (r0 - f0) * (r0 - f0) + (r1 - f1) * (r1 - f1) + (r2 - f2) * (r2 - f2)


@inner
def smoothed_mismatch(mu, r0, r1, r2, u0, u1, u2, tau2):
    """Return |phi|^2 of the smoothed Fischer-Burmeister function."""
    c = 1 / larger(mu, 1.0)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * root(u1 * u1 + u2 * u2)), c * mu * u1, c * mu * u2
    z0, z1, z2, _ = _jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    f0, f1, f2 = a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2
    g0 = r0 + u0 - root(r0 * r0 + u0 * u0 + 2 * tau2)
    return choose(mu > 0.0, f0 * f0 + f1 * f1 + f2 * f2, g0 * g0)


@inner
def natural_map(i, mu, r0, r1, r2, u0, u1, u2, P, Q, f):
    """Write the natural map of eight contacts from i on and its derivatives, P = I - D and Q = D E; return |f|^2.

    D is the derivative of the projection, E that of the shifted velocity u + mu |u_T| N.
    """
    slip = root(u1 * u1 + u2 * u2)
    p0, p1, p2 = r0 - u0 - mu * slip, r1 - u1, r2 - u2
    t = root(p1 * p1 + p2 * p2)
    parts = mu * t <= -p0  # inside the polar cone: the contact opens
    sticks = (t <= mu * p0) & (mu > 0.0)  # inside the cone; outside both cones the contact slides
    k = 1 / (1 + mu * mu)
    n = k * (p0 + mu * t)
    length = 1 / larger(t, TINY)
    e1, e2, c = p1 * length, p2 * length, mu * n * length
    s1, s2 = k * mu * e1, k * mu * e2
    d00 = choose(parts, 0.0, choose(sticks, 1.0, k))
    d01 = choose(parts, 0.0, choose(sticks, 0.0, s1))
    d02 = choose(parts, 0.0, choose(sticks, 0.0, s2))
    d11 = choose(parts, 0.0, choose(sticks, 1.0, mu * e1 * s1 + c * (1 - e1 * e1)))
    d12 = choose(parts, 0.0, choose(sticks, 0.0, mu * e1 * s2 - c * e1 * e2))
    d22 = choose(parts, 0.0, choose(sticks, 1.0, mu * e2 * s2 + c * (1 - e2 * e2)))
    f0 = r0 - choose(parts, 0.0, choose(sticks, p0, n))
    f1 = r1 - choose(parts, 0.0, choose(sticks, p1, mu * n * e1))
    f2 = r2 - choose(parts, 0.0, choose(sticks, p2, mu * n * e2))
    way = mu / larger(slip, TINY)
    t1, t2 = way * u1, way * u2
    write_matrix(P, i, 1 - d00, -d01, -d02, -d01, 1 - d11, -d12, -d02, -d12, 1 - d22)
    q1, q2 = (d01 + d00 * t1, d11 + d01 * t1, d12 + d02 * t1), (d02 + d00 * t2, d12 + d01 * t2, d22 + d02 * t2)
    write_matrix(Q, i, d00, q1[0], q2[0], d01, q1[1], q2[1], d02, q1[2], q2[2])
    write(f0, f[0], i)
    write(f1, f[1], i)
    write(f2, f[2], i)
    return f0 * f0 + f1 * f1 + f2 * f2


@inner
def fischer_burmeister(i, mu, r0, r1, r2, u0, u1, u2, tau2, P, Q, f):
    """Write phi of eight contacts from i on and its derivatives; return |phi|^2.

    The derivatives are (I - L_z^-1 L_a) da/dr and (I - L_z^-1 L_b) db/du.
    """
    c = 1 / larger(mu, 1.0)
    slip = root(u1 * u1 + u2 * u2)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * slip), c * mu * u1, c * mu * u2
    z0, z1, z2, det = _jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    f0, f1, f2 = a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2
    d, k = 1 / larger(det, TINY), 1 / larger(z0, TINY)  # det 0: a and b are both at the apex
    i00, i01, i02 = z0 * d, -z1 * d, -z2 * d  # L_z^-1
    i11, i12, i22 = k + z1 * z1 * k * d, z1 * z2 * k * d, k + z2 * z2 * k * d
    g = c * mu
    p00 = g * (1 - (i00 * a0 + i01 * a1 + i02 * a2))
    p10, p20 = -g * (i01 * a0 + i11 * a1 + i12 * a2), -g * (i02 * a0 + i12 * a1 + i22 * a2)
    p01, p02 = -c * (i00 * a1 + i01 * a0), -c * (i00 * a2 + i02 * a0)
    p11, p12 = c * (1 - (i01 * a1 + i11 * a0)), -c * (i01 * a2 + i12 * a0)
    p21, p22 = -c * (i02 * a1 + i12 * a0), c * (1 - (i02 * a2 + i22 * a0))
    way = mu / larger(slip, TINY)
    t1, t2 = way * u1, way * u2
    q0 = c * (1 - (i00 * b0 + i01 * b1 + i02 * b2))
    q1, q2 = -c * (i01 * b0 + i11 * b1 + i12 * b2), -c * (i02 * b0 + i12 * b1 + i22 * b2)
    q01, q02 = q0 * t1 - g * (i00 * b1 + i01 * b0), q0 * t2 - g * (i00 * b2 + i02 * b0)
    q11, q12 = q1 * t1 + g * (1 - (i01 * b1 + i11 * b0)), q1 * t2 - g * (i01 * b2 + i12 * b0)
    q21, q22 = q2 * t1 - g * (i02 * b1 + i12 * b0), q2 * t2 + g * (1 - (i02 * b2 + i22 * b0))

    rough = mu > 0.0  # without friction: 0 <= u_N _|_ r_N >= 0, and the tangential impulse goes to zero
    z = larger(root(r0 * r0 + u0 * u0 + 2 * tau2), TINY)
    g0 = r0 + u0 - z
    p00, p11, p22 = choose(rough, p00, 1 - r0 / z), choose(rough, p11, 1.0), choose(rough, p22, 1.0)
    p01, p02, p12 = choose(rough, p01, 0.0), choose(rough, p02, 0.0), choose(rough, p12, 0.0)
    p10, p20, p21 = choose(rough, p10, 0.0), choose(rough, p20, 0.0), choose(rough, p21, 0.0)
    write_matrix(P, i, p00, p01, p02, p10, p11, p12, p20, p21, p22)
    q0, q1, q2 = choose(rough, q0, 1 - u0 / z), choose(rough, q1, 0.0), choose(rough, q2, 0.0)
    q01, q11, q21 = choose(rough, q01, 0.0), choose(rough, q11, 0.0), choose(rough, q21, 0.0)
    q02, q12, q22 = choose(rough, q02, 0.0), choose(rough, q12, 0.0), choose(rough, q22, 0.0)
    write_matrix(Q, i, q0, q01, q02, q1, q11, q12, q2, q21, q22)
    write(choose(rough, f0, g0), f[0], i)
    write(choose(rough, f1, r1), f[1], i)
    write(choose(rough, f2, r2), f[2], i)
    return choose(rough, f0 * f0 + f1 * f1 + f2 * f2, g0 * g0)


@inner
def _jordan_root(a0, a1, a2, b0, b1, b2, tau2):
    """Return z = (a o a + b o b + 2 tau^2 e)^(1/2) and its determinant."""
    w0 = a0 * a0 + a1 * a1 + a2 * a2 + b0 * b0 + b1 * b1 + b2 * b2 + 2 * tau2
    w1, w2 = 2 * (a0 * a1 + b0 * b1), 2 * (a0 * a2 + b0 * b2)
    wt = root(w1 * w1 + w2 * w2)
    root1, root2 = root(larger(w0 - wt, 0.0)), root(w0 + wt)
    f = 1 / larger(root1 + root2, TINY)  # (root2 - root1) / (2 wt)
    return 0.5 * (root1 + root2), f * w1, f * w2, root1 * root2


@inner
def eliminate(i, s, yielding, P, Q, f):
    """Solve P s dr + Q (G dw + yielding s dr) = -f for the impulse dr = -b - A G dw; A overwrites P, b overwrites f.

    ``yielding`` is the contact's compliance in units of s plus a proximal step on r. P alone is singular for a sticking
    contact, whose impulse is determined only by the velocities.
    """
    f0, f1, f2 = read(f[0], i), read(f[1], i), read(f[2], i)
    q00, q01, q02, q10, q11, q12, q20, q21, q22 = read_matrix(Q, i)
    p00, p01, p02, p10, p11, p12, p20, p21, p22 = read_matrix(P, i)
    m00, m01, m02 = p00 + yielding * q00, p01 + yielding * q01, p02 + yielding * q02
    m10, m11, m12 = p10 + yielding * q10, p11 + yielding * q11, p12 + yielding * q12
    m20, m21, m22 = p20 + yielding * q20, p21 + yielding * q21, p22 + yielding * q22
    c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
    c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
    c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
    d = 1 / (s * (m00 * c00 + m01 * c10 + m02 * c20))
    write(d * (c00 * q00 + c01 * q10 + c02 * q20), P[0], i)
    write(d * (c00 * q01 + c01 * q11 + c02 * q21), P[1], i)
    write(d * (c00 * q02 + c01 * q12 + c02 * q22), P[2], i)
    write(d * (c10 * q00 + c11 * q10 + c12 * q20), P[3], i)
    write(d * (c10 * q01 + c11 * q11 + c12 * q21), P[4], i)
    write(d * (c10 * q02 + c11 * q12 + c12 * q22), P[5], i)
    write(d * (c20 * q00 + c21 * q10 + c22 * q20), P[6], i)
    write(d * (c20 * q01 + c21 * q11 + c22 * q21), P[7], i)
    write(d * (c20 * q02 + c21 * q12 + c22 * q22), P[8], i)
    write(d * (c00 * f0 + c01 * f1 + c02 * f2), f[0], i)
    write(d * (c10 * f0 + c11 * f1 + c12 * f2), f[1], i)
    write(d * (c20 * f0 + c21 * f1 + c22 * f2), f[2], i)


@inner
def read_matrix(A, i):
    """Return the nine entries of eight 3 x 3 blocks from contact i on, row by row."""
    return (
        read(A[0], i),
        read(A[1], i),
        read(A[2], i),
        read(A[3], i),
        read(A[4], i),
        read(A[5], i),
        read(A[6], i),
        read(A[7], i),
        read(A[8], i),
    )


@inner
def write_matrix(A, i, a00, a01, a02, a10, a11, a12, a20, a21, a22):
    """Write the nine entries of eight 3 x 3 blocks from contact i on, row by row."""
    write(a00, A[0], i)
    write(a01, A[1], i)
    write(a02, A[2], i)
    write(a10, A[3], i)
    write(a11, A[4], i)
    write(a12, A[5], i)
    write(a20, A[6], i)
    write(a21, A[7], i)
    write(a22, A[8], i)
