"""One contact's complementarity as an equation: the smoothed Fischer-Burmeister function on the second-order cone.

Coulomb's law (eq. 5) reads K* > u + mu |u_T| N  _|_  r < K. With a = (mu r_N, r_T) and b = (u_N + mu |u_T|, mu u_T),
both scaled by 1/max(1, mu), this is Lorentz > a _|_ b < Lorentz, and that is the root of

    phi(a, b) = a + b - (a o a + b o b + 2 tau^2 e)^(1/2),      tau -> 0,

where o is the Jordan product of the cone. The root z has the eigenvalues sqrt(l1), sqrt(l2) of w = a o a + b o b + 2 tau^2 e;
its derivative is L_z^-1, so d(phi) = (I - L_z^-1 L_a) da + (I - L_z^-1 L_b) db.

Impulses arrive multiplied by the contact's own Delassus scale: r and u are both velocities here.
"""

import numpy as np

from engine.kernels.jit import kernel


@kernel
def phi(mu, r0, r1, r2, u0, u1, u2, tau2):
    """Return the three components of phi."""
    c = 1 / max(1.0, mu)
    slip = np.sqrt(u1 * u1 + u2 * u2)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * slip), c * mu * u1, c * mu * u2
    z0, z1, z2, _ = jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    return a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2


@kernel
def jordan_root(a0, a1, a2, b0, b1, b2, tau2):
    """Return z = (a o a + b o b + 2 tau^2 e)^(1/2) and its determinant sqrt(l1 l2)."""
    w0 = a0 * a0 + a1 * a1 + a2 * a2 + b0 * b0 + b1 * b1 + b2 * b2 + 2 * tau2
    w1 = 2 * (a0 * a1 + b0 * b1)
    w2 = 2 * (a0 * a2 + b0 * b2)
    wt = np.sqrt(w1 * w1 + w2 * w2)
    root1 = np.sqrt(max(w0 - wt, 0.0))
    root2 = np.sqrt(w0 + wt)
    f = 0.0
    if wt > 0:
        f = 0.5 * (root2 - root1) / wt
    return 0.5 * (root1 + root2), f * w1, f * w2, root1 * root2


@kernel
def eliminate(mu, r0, r1, r2, u0, u1, u2, tau2, proximal, i, A, b):
    """Linearise phi = 0 and solve it for the impulse: dr = -b - A du.

    P dr + Q du = -phi is solved with P + proximal Q in the place of P, a proximal step on r: P alone is singular for a
    sticking contact, whose impulse is whatever the velocity asks for. ``A[i]`` (3, 3) and ``b[i]`` (3,) are written;
    returned is |phi|^2.
    """
    c = 1 / max(1.0, mu)
    slip = np.sqrt(u1 * u1 + u2 * u2)
    a0, a1, a2 = c * mu * r0, c * r1, c * r2
    b0, b1, b2 = c * (u0 + mu * slip), c * mu * u1, c * mu * u2
    z0, z1, z2, det = jordan_root(a0, a1, a2, b0, b1, b2, tau2)
    f0, f1, f2 = a0 + b0 - z0, a1 + b1 - z1, a2 + b2 - z2

    det = max(det, 1e-300)  # 0 only where a and b are both on the apex: any element of the generalised Jacobian
    k = 1 / max(z0, 1e-150)
    i00, i01, i02 = z0 / det, -z1 / det, -z2 / det  # L_z^-1
    i11, i12, i22 = k + z1 * z1 * k / det, z1 * z2 * k / det, k + z2 * z2 * k / det

    cm = c * mu  # P = (I - L_z^-1 L_a) diag(mu, 1, 1) c
    p00 = cm * (1 - (i00 * a0 + i01 * a1 + i02 * a2))
    p10 = -cm * (i01 * a0 + i11 * a1 + i12 * a2)
    p20 = -cm * (i02 * a0 + i12 * a1 + i22 * a2)
    p01, p02 = -c * (i00 * a1 + i01 * a0), -c * (i00 * a2 + i02 * a0)
    p11, p12 = c * (1 - (i01 * a1 + i11 * a0)), -c * (i01 * a2 + i12 * a0)
    p21, p22 = -c * (i02 * a1 + i12 * a0), c * (1 - (i02 * a2 + i22 * a0))

    t1, t2 = 0.0, 0.0  # Q = (I - L_z^-1 L_b) db/du, and d|u_T| = t . du_T
    if slip > 0:
        t1, t2 = u1 / slip, u2 / slip
    q00 = c * (1 - (i00 * b0 + i01 * b1 + i02 * b2))
    q10 = -c * (i01 * b0 + i11 * b1 + i12 * b2)
    q20 = -c * (i02 * b0 + i12 * b1 + i22 * b2)
    q01 = mu * q00 * t1 - cm * (i00 * b1 + i01 * b0)
    q02 = mu * q00 * t2 - cm * (i00 * b2 + i02 * b0)
    q11 = mu * q10 * t1 + cm * (1 - (i01 * b1 + i11 * b0))
    q12 = mu * q10 * t2 - cm * (i01 * b2 + i12 * b0)
    q21 = mu * q20 * t1 - cm * (i02 * b1 + i12 * b0)
    q22 = mu * q20 * t2 + cm * (1 - (i02 * b2 + i22 * b0))

    m00, m01, m02 = p00 + proximal * q00, p01 + proximal * q01, p02 + proximal * q02
    m10, m11, m12 = p10 + proximal * q10, p11 + proximal * q11, p12 + proximal * q12
    m20, m21, m22 = p20 + proximal * q20, p21 + proximal * q21, p22 + proximal * q22
    c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
    c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
    c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
    d = 1 / (m00 * c00 + m01 * c10 + m02 * c20)
    A[i, 0, 0] = d * (c00 * q00 + c01 * q10 + c02 * q20)
    A[i, 0, 1] = d * (c00 * q01 + c01 * q11 + c02 * q21)
    A[i, 0, 2] = d * (c00 * q02 + c01 * q12 + c02 * q22)
    A[i, 1, 0] = d * (c10 * q00 + c11 * q10 + c12 * q20)
    A[i, 1, 1] = d * (c10 * q01 + c11 * q11 + c12 * q21)
    A[i, 1, 2] = d * (c10 * q02 + c11 * q12 + c12 * q22)
    A[i, 2, 0] = d * (c20 * q00 + c21 * q10 + c22 * q20)
    A[i, 2, 1] = d * (c20 * q01 + c21 * q11 + c22 * q21)
    A[i, 2, 2] = d * (c20 * q02 + c21 * q12 + c22 * q22)
    b[i, 0] = d * (c00 * f0 + c01 * f1 + c02 * f2)
    b[i, 1] = d * (c10 * f0 + c11 * f1 + c12 * f2)
    b[i, 2] = d * (c20 * f0 + c21 * f1 + c22 * f2)
    return f0 * f0 + f1 * f1 + f2 * f2


@kernel
def phi_smooth_contact(r0, u0, tau2):
    """Return phi of a contact without friction: 0 <= u_N _|_ r_N >= 0."""
    return r0 + u0 - np.sqrt(r0 * r0 + u0 * u0 + 2 * tau2)


@kernel
def eliminate_smooth_contact(r0, r1, r2, u0, tau2, proximal, i, A, b):
    """Do for mu = 0 what `eliminate` does: one scalar equation; the tangential impulse goes to zero."""
    z = max(np.sqrt(r0 * r0 + u0 * u0 + 2 * tau2), 1e-150)
    f = r0 + u0 - z
    p, q = 1 - r0 / z, 1 - u0 / z
    d = 1 / (p + proximal * q)
    for k in range(3):
        A[i, k, 0], A[i, k, 1], A[i, k, 2] = 0.0, 0.0, 0.0
    A[i, 0, 0] = d * q
    b[i, 0], b[i, 1], b[i, 2] = d * f, r1, r2
    return f * f
