"""Units for each contact in which the Delassus scales of all contacts are nearly equal.

Coulomb's law holds in any unit: with rows d_i G_i and velocities d_i q_i the impulses are r_i / d_i. Where a light body
and a heavy one touch other bodies, the Delassus scales s_i = |G_i|^2 / 3 of their contacts differ as their masses do,
and so does the significance of one unit of velocity. With d_i = (s / s_i)^(1/2), s the mean, speeds are weighted as in
the kinetic energy, and smoothing and line search treat all contacts alike. The factors are powers of two, which change
no digit.
"""

import math

from engine.friction.blocks import ROW
from engine.jit import inner
from engine.jit.lanes import read, write


@inner
def even_out(nc, p, mean):
    """Give each contact the unit in which its Delassus scale is nearly ``mean``; `restore` undoes it.

    The rows of p and the lanes of its contacts are changed.
    """
    c = p.contacts
    for i in range(c.unit.shape[0]):
        c.unit[i] = 1.0
    for i in range(nc):
        share = mean / c.scale[i]
        if 0.5 <= share <= 2.0 or not 1e-200 < share < 1e200:
            continue
        _, exponent = math.frexp(share)
        unit = math.ldexp(1.0, exponent >> 1)
        c.unit[i] = unit
        c.scale[i] *= unit * unit
        c.compliance[i] *= unit * unit
        for k in range(3):
            c.q[k, i] *= unit
            c.r[k, i] /= unit
        _multiply(p.rows, i, unit)


@inner
def restore(nc, p):
    """Undo `even_out`."""
    c = p.contacts
    for i in range(nc):
        unit = c.unit[i]
        if unit != 1.0:
            c.scale[i] /= unit * unit
            c.compliance[i] /= unit * unit
            for k in range(3):
                c.q[k, i] /= unit
                c.r[k, i] *= unit
                c.u[k, i] /= unit
            _multiply(p.rows, i, 1 / unit)
            c.unit[i] = 1.0


@inner
def _multiply(rows, i, factor):
    """Multiply the rows of contact i."""
    for k in range(3):
        for s in range(rows.node.shape[1]):
            write(factor * read(rows.G[i, k], ROW * s), rows.G[i, k], ROW * s)
