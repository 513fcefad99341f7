"""Friction that differs along and across a grain: an ellipse of friction forces, as a cone in a metric of its own.

With coefficients mu_1 along T1 and mu_2 across it, mu the larger one, and l_k = mu_k / mu, let r_k = l_k r'_k and
u'_k = l_k u_k. Then (r_1 / mu_1)^2 + (r_2 / mu_2)^2 <= r_N^2 is Coulomb's cone |r'_T| <= mu r_N. Of all forces in the
ellipse the one that takes most from a sliding velocity, r_k ~ -mu_k^2 u_k, is opposite to it in these variables. So
Coulomb's law between r' and u' is the law of the ellipse, and r . u = r' . u'.

The frame of such a contact therefore has a T1 along the grain and of length l_1, and a T2 of length l_2. All that works
with the rows of the frame is right as it is. Only what reads a component in the surface by itself needs `lengths`.
"""

import numpy as np

from engine.jit import inner, not_inlined
from engine.kernels.vectors import CENTRED, cross, split, world_direction

NEARLY = 1e-4  # if less than this share of the grain lies in the surface, rounding is removed once more


@inner
def lengths(contacts, i):
    """Return the lengths of T1 and T2 of contact i."""
    if contacts.grain.shape[0] == 0:
        return 1.0, 1.0
    return contacts.grain[i, 4], contacts.grain[i, 5]


@not_inlined
def lay_along_grain(contacts, R, i, frame):
    """Turn T1 and T2 of contact i along and across its grain, and give them their lengths.

    Where the grain is normal to the surface it has no direction in it: T1 stays as it was.
    """
    row, N = contacts.grain[i], (frame[0, 0], frame[0, 1], frame[0, 2])
    if N[0] == 0.0 and N[1] == 0.0 and N[2] == 0.0:  # it is no contact, or cannot press in this pose
        return
    _, way = split(world_direction(R, int(row[3]), row, 0), N)
    size = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    if CENTRED < size < NEARLY:
        _, way = split(way, N)
        size = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    if size > CENTRED:
        for k in range(3):
            frame[1, k] = way[k] / size
        cross(frame[0], frame[1], frame[2])
    for k in range(3):
        frame[1, k] *= row[4]
        frame[2, k] *= row[5]
