"""Functions of time: what a load is multiplied with, where a prescribed motion is."""

import numpy as np

from engine.kernels.jit import kernel


@kernel
def time_law(laws, i, t):
    """Return law i at time t: its cubic piece, constant before the first and after the last, plus its sine."""
    k, end = laws.first[i], laws.first[i + 1]
    last = end - 1
    while end - k > 1:  # bisection: the piece that began last
        middle = (k + end) // 2
        if laws.time[middle] <= t:
            k = middle
        else:
            end = middle
    s = max(t - laws.time[k], 0.0) if k < last else 0.0
    c, a, w, phi = laws.piece[k], laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    return c[0] + s * (c[1] + s * (c[2] + s * c[3])) + a * (np.sin(w * t + phi) - np.sin(phi))
