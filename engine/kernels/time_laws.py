"""Time laws: factors of loads, and targets of prescribed motions."""

import numpy as np

from engine.jit import inner, kernel


@kernel
def time_law(laws, i, t):
    """Return law i at time t: its cubic piece, constant before the first and after the last, plus its sine.

    ``t`` is the time since the start of the run.
    """
    t = _since(laws, i, t)
    if t == -np.inf:
        t = 0.0
    k = _piece(laws, i, t)
    s = max(t - laws.time[k], 0.0) if k < laws.first[i + 1] - 1 else 0.0
    c, a, w, phi = laws.piece[k], laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    return c[0] + s * (c[1] + s * (c[2] + s * c[3])) + a * (np.sin(w * t + phi) - np.sin(phi))


@kernel
def time_law_rate(laws, i, t):
    """Return the right-hand derivative of law i at time t."""
    t = _since(laws, i, t)
    if t == -np.inf:
        return 0.0
    k = _piece(laws, i, t)
    s, c, a, w, phi = t - laws.time[k], laws.piece[k], laws.sine[i, 0], laws.sine[i, 1], laws.sine[i, 2]
    rate = c[1] + s * (2 * c[2] + 3 * s * c[3]) if k < laws.first[i + 1] - 1 and s >= 0.0 else 0.0
    return rate + a * w * np.cos(w * t + phi)


@inner
def _since(laws, i, t):
    """Return the time since law i's phase began; -inf before it has begun."""
    return t - laws.begun[laws.since[i]]


@inner
def _piece(laws, i, t):
    """Return the last piece of law i that has begun by time t, by bisection."""
    k, end = laws.first[i], laws.first[i + 1]
    while end - k > 1:
        middle = (k + end) // 2
        if laws.time[middle] <= t:
            k = middle
        else:
            end = middle
    return k
