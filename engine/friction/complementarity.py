"""One contact's law as an equation f(r, u) = 0, its derivatives P and Q, and its elimination from the problem.

Coulomb's law (eq. 5) reads K* > u + mu |u_T| N  _|_  r < K. Impulses arrive multiplied by the contact's own Delassus
scale s: r and u are both velocities here, and f' = P s dr + Q du. Two equations say the same:

- the natural map r - P_K(r - (u + mu |u_T| N)), piecewise smooth: one or two Newton steps from a near start;
- the smoothed Fischer-Burmeister function. With a = (mu r_N, r_T) and b = (u_N + mu |u_T|, mu u_T), both scaled by
  1/max(1, mu), the law is Lorentz > a _|_ b < Lorentz, and that is the root of phi = a + b - z for tau -> 0,
  z = (a o a + b o b + 2 tau^2 e)^(1/2) with the Jordan product o of the cone. It is smooth and good from any start.
"""

import numpy as np

from engine.friction.cone import project
from engine.jit import inner

TINY = 1e-300


@inner
def mismatch(mu, r0, r1, r2, u0, u1, u2, tau2):
    """Return |f|^2: of the natural map if ``tau2`` is 0, otherwise of the smoothed Fischer-Burmeister function."""
    slip = np.sqrt(u1 * u1 + u2 * u2)
    if tau2 == 0.0:
        f0, f1, f2 = project(mu, r0 - u0 - mu * slip, r1 - u1, r2 - u2)
        return (r0 - f0) * (r0 - f0) + (r1 - f1) * (r1 - f1) + (r2 - f2) * (r2 - f2)
    if mu == 0.0:
        f0 = r0 + u0 - np.sqrt(r0 * r0 + u0 * u0 + 2 * tau2)
        return f0 * f0
    c = 1 / max(1.0, mu)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * slip), c * mu * u1, c * mu * u2
    z0, z1, z2, _ = _jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    f0, f1, f2 = a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2
    return f0 * f0 + f1 * f1 + f2 * f2


@inner
def natural_map(i, mu, r0, r1, r2, u0, u1, u2, P, Q, f):
    """Write the natural map of contact i and its derivatives, P = I - D and Q = D E; return |f|^2.

    D is the derivative of the projection, E that of the shifted velocity u + mu |u_T| N.
    """
    slip = np.sqrt(u1 * u1 + u2 * u2)
    p0, p1, p2 = r0 - u0 - mu * slip, r1 - u1, r2 - u2
    t = np.sqrt(p1 * p1 + p2 * p2)
    d00, d01, d02, d11, d12, d22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    f0, f1, f2 = r0, r1, r2
    if t <= mu * p0 and mu > 0.0:  # inside the cone: sticking
        d00, d11, d22 = 1.0, 1.0, 1.0
        f0, f1, f2 = r0 - p0, r1 - p1, r2 - p2
    elif mu * t > -p0:  # beside it: sliding; else inside the polar cone: open
        k = 1 / (1 + mu * mu)
        n = k * (p0 + mu * t)
        e1, e2 = p1 / max(t, TINY), p2 / max(t, TINY)
        c = mu * n / max(t, TINY)
        f0, f1, f2 = r0 - n, r1 - mu * n * e1, r2 - mu * n * e2
        d00, d01, d02 = k, k * mu * e1, k * mu * e2
        d11, d12 = mu * e1 * d01 + c * (1 - e1 * e1), mu * e1 * d02 - c * e1 * e2
        d22 = mu * e2 * d02 + c * (1 - e2 * e2)
    t1, t2 = mu * u1 / max(slip, TINY), mu * u2 / max(slip, TINY)
    P[i, 0, 0], P[i, 0, 1], P[i, 0, 2] = 1 - d00, -d01, -d02
    P[i, 1, 0], P[i, 1, 1], P[i, 1, 2] = -d01, 1 - d11, -d12
    P[i, 2, 0], P[i, 2, 1], P[i, 2, 2] = -d02, -d12, 1 - d22
    Q[i, 0, 0], Q[i, 0, 1], Q[i, 0, 2] = d00, d01 + d00 * t1, d02 + d00 * t2
    Q[i, 1, 0], Q[i, 1, 1], Q[i, 1, 2] = d01, d11 + d01 * t1, d12 + d01 * t2
    Q[i, 2, 0], Q[i, 2, 1], Q[i, 2, 2] = d02, d12 + d02 * t1, d22 + d02 * t2
    f[i, 0], f[i, 1], f[i, 2] = f0, f1, f2
    return f0 * f0 + f1 * f1 + f2 * f2


@inner
def fischer_burmeister(i, mu, r0, r1, r2, u0, u1, u2, tau2, P, Q, f):
    """Write phi of contact i and its derivatives, (I - L_z^-1 L_a) da/dr and (I - L_z^-1 L_b) db/du; return |phi|^2."""
    if mu == 0.0:
        return _without_friction(i, r0, r1, r2, u0, tau2, P, Q, f)
    c = 1 / max(1.0, mu)
    slip = np.sqrt(u1 * u1 + u2 * u2)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * slip), c * mu * u1, c * mu * u2
    z0, z1, z2, det = _jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    f0, f1, f2 = a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2
    d, k = 1 / max(det, TINY), 1 / max(z0, TINY)  # det 0: a and b both on the apex
    i00, i01, i02 = z0 * d, -z1 * d, -z2 * d  # L_z^-1
    i11, i12, i22 = k + z1 * z1 * k * d, z1 * z2 * k * d, k + z2 * z2 * k * d
    g = c * mu
    P[i, 0, 0] = g * (1 - (i00 * a0 + i01 * a1 + i02 * a2))
    P[i, 1, 0] = -g * (i01 * a0 + i11 * a1 + i12 * a2)
    P[i, 2, 0] = -g * (i02 * a0 + i12 * a1 + i22 * a2)
    P[i, 0, 1], P[i, 0, 2] = -c * (i00 * a1 + i01 * a0), -c * (i00 * a2 + i02 * a0)
    P[i, 1, 1], P[i, 1, 2] = c * (1 - (i01 * a1 + i11 * a0)), -c * (i01 * a2 + i12 * a0)
    P[i, 2, 1], P[i, 2, 2] = -c * (i02 * a1 + i12 * a0), c * (1 - (i02 * a2 + i22 * a0))
    t1, t2 = mu * u1 / max(slip, TINY), mu * u2 / max(slip, TINY)
    q0 = c * (1 - (i00 * b0 + i01 * b1 + i02 * b2))
    q1 = -c * (i01 * b0 + i11 * b1 + i12 * b2)
    q2 = -c * (i02 * b0 + i12 * b1 + i22 * b2)
    Q[i, 0, 0], Q[i, 1, 0], Q[i, 2, 0] = q0, q1, q2
    Q[i, 0, 1], Q[i, 0, 2] = q0 * t1 - g * (i00 * b1 + i01 * b0), q0 * t2 - g * (i00 * b2 + i02 * b0)
    Q[i, 1, 1], Q[i, 1, 2] = q1 * t1 + g * (1 - (i01 * b1 + i11 * b0)), q1 * t2 - g * (i01 * b2 + i12 * b0)
    Q[i, 2, 1], Q[i, 2, 2] = q2 * t1 - g * (i02 * b1 + i12 * b0), q2 * t2 + g * (1 - (i02 * b2 + i22 * b0))
    f[i, 0], f[i, 1], f[i, 2] = f0, f1, f2
    return f0 * f0 + f1 * f1 + f2 * f2


@inner
def _jordan_root(a0, a1, a2, b0, b1, b2, tau2):
    """Return z = (a o a + b o b + 2 tau^2 e)^(1/2) and its determinant."""
    w0 = a0 * a0 + a1 * a1 + a2 * a2 + b0 * b0 + b1 * b1 + b2 * b2 + 2 * tau2
    w1, w2 = 2 * (a0 * a1 + b0 * b1), 2 * (a0 * a2 + b0 * b2)
    wt = np.sqrt(w1 * w1 + w2 * w2)
    root1, root2 = np.sqrt(max(w0 - wt, 0.0)), np.sqrt(w0 + wt)
    f = 1 / max(root1 + root2, TINY)  # (root2 - root1) / (2 wt)
    return 0.5 * (root1 + root2), f * w1, f * w2, root1 * root2


@inner
def _without_friction(i, r0, r1, r2, u0, tau2, P, Q, f):
    """Do for mu = 0 what `fischer_burmeister` does: 0 <= u_N _|_ r_N >= 0; the tangential impulse goes to zero."""
    z = max(np.sqrt(r0 * r0 + u0 * u0 + 2 * tau2), TINY)
    f0 = r0 + u0 - z
    for k in range(3):
        P[i, k, 0], P[i, k, 1], P[i, k, 2] = 0.0, 0.0, 0.0
        Q[i, k, 0], Q[i, k, 1], Q[i, k, 2] = 0.0, 0.0, 0.0
    P[i, 0, 0], P[i, 1, 1], P[i, 2, 2], Q[i, 0, 0] = 1 - r0 / z, 1.0, 1.0, 1 - u0 / z
    f[i, 0], f[i, 1], f[i, 2] = f0, r1, r2
    return f0 * f0


@inner
def eliminate(i, s, proximal, P, Q, f):
    """Solve P s dr + Q du = -f for the impulse, dr = -b - A du: A is written over P and b over f.

    P + ``proximal`` Q takes the place of P, a proximal step on r: P alone is singular for a contact that sticks, whose
    impulse is whatever the velocity asks for.
    """
    f0, f1, f2 = f[i, 0], f[i, 1], f[i, 2]
    q00, q01, q02 = Q[i, 0, 0], Q[i, 0, 1], Q[i, 0, 2]
    q10, q11, q12 = Q[i, 1, 0], Q[i, 1, 1], Q[i, 1, 2]
    q20, q21, q22 = Q[i, 2, 0], Q[i, 2, 1], Q[i, 2, 2]
    m00, m01, m02 = P[i, 0, 0] + proximal * q00, P[i, 0, 1] + proximal * q01, P[i, 0, 2] + proximal * q02
    m10, m11, m12 = P[i, 1, 0] + proximal * q10, P[i, 1, 1] + proximal * q11, P[i, 1, 2] + proximal * q12
    m20, m21, m22 = P[i, 2, 0] + proximal * q20, P[i, 2, 1] + proximal * q21, P[i, 2, 2] + proximal * q22
    c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
    c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
    c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
    d = 1 / (s * (m00 * c00 + m01 * c10 + m02 * c20))
    P[i, 0, 0] = d * (c00 * q00 + c01 * q10 + c02 * q20)
    P[i, 0, 1] = d * (c00 * q01 + c01 * q11 + c02 * q21)
    P[i, 0, 2] = d * (c00 * q02 + c01 * q12 + c02 * q22)
    P[i, 1, 0] = d * (c10 * q00 + c11 * q10 + c12 * q20)
    P[i, 1, 1] = d * (c10 * q01 + c11 * q11 + c12 * q21)
    P[i, 1, 2] = d * (c10 * q02 + c11 * q12 + c12 * q22)
    P[i, 2, 0] = d * (c20 * q00 + c21 * q10 + c22 * q20)
    P[i, 2, 1] = d * (c20 * q01 + c21 * q11 + c22 * q21)
    P[i, 2, 2] = d * (c20 * q02 + c21 * q12 + c22 * q22)
    f[i, 0] = d * (c00 * f0 + c01 * f1 + c02 * f2)
    f[i, 1] = d * (c10 * f0 + c11 * f1 + c12 * f2)
    f[i, 2] = d * (c20 * f0 + c21 * f1 + c22 * f2)
