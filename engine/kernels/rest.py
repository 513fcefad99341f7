"""When a mechanism is at rest: no measured length and no contact that carries load moves for a while."""

from engine.kernels.jit import kernel

LOADED = 1e-3  # of the largest impulse: a contact that carries load


@kernel
def start_pause(work):
    """Note where everything is now."""
    for i in range(work.values.shape[0]):
        work.anchor[i] = work.values[i]
    for i in range(work.travel.shape[0]):
        work.travel[i] = 0.0


@kernel
def moved(counts, state, work, h, drift):
    """Say whether anything that matters moved since the pause began: a measured length, a contact that carries load.

    ``counts``, shape (nr,) bool: the responses that are measured lengths or angles.

    Bodies without load may drift on for ever (a rod that spins slowly between its bearings): they do not count. Contact
    forces do not count either: with everything sticking they may wander inside their indeterminacy.
    """
    away, load = False, 0.0
    for i in range(work.values.shape[0]):
        if counts[i]:
            away = away or not abs(work.values[i] - work.anchor[i]) <= drift
    for i in range(state.slip.shape[0]):
        load = max(load, state.r[i, 0])
    for i in range(state.slip.shape[0]):
        if state.r[i, 0] > LOADED * load:
            work.travel[i] += h * state.slip[i]
            away = away or work.travel[i] > drift
    return away
