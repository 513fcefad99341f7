"""Joint stages: twists that keep ideal joints and prescribed motions, before the contacts and at the end of a step.

Within the step the mean velocity keeps the constraint, J (theta v+ + (1 - theta) v) = s' with J at mid-step; at the end
the velocities themselves, J v+ = s' with J there (a multiplier each, as in the RATTLE scheme). With theta = 1/2 that is
second order and joints do no work; J v+ = s' with J at mid-step alone loses energy in every turn.
"""

from engine.friction.bilateral import hold_ties, tie_down
from engine.jit import inner
from engine.kernels.bilateral import tie_velocity, tie_violations, whitened_ties
from engine.kernels.contacts import add_whitened
from engine.kernels.motion import NOTHING


@inner
def hold_joints(bodies, ties, x, R, before, twist, held, h, theta, tied, w):
    """Change ``twist`` by the least kinetic energy so that the joints hold at the pose (x, R).

    Parameters
    ----------
    before : twists at the start of the step
    twist : twists at its end, (nb + 1, 6)
    h : length of the step, over which the mean velocity shall fit; 0: the velocity at the end shall
    tied, w : the rows and the unknowns of the friction problem; work space
    """
    if held.violation.shape[0] == 0:
        return
    c, point, way = held.violation, held.point, held.way
    tie_violations(ties, x, R, held.target[1], c, point, way)
    for i in range(c.shape[0]):
        c[i] = tie_velocity(ties, x, R, point, way, twist, i)
        if h > 0.0:
            mean = ties.arm[i] * (held.target[1, i] - held.target[0, i]) / h
            c[i] -= (mean - (1 - theta) * tie_velocity(ties, x, R, point, way, before, i)) / theta
        else:
            c[i] -= ties.arm[i] * held.target[2, i]
        if abs(c[i]) < NOTHING:
            c[i] = 0.0
    whitened_ties(bodies, ties, x, R, point, way, tied.J)
    tie_down(w.shape[0], tied)
    hold_ties(w.shape[0], tied, c, w)
    add_whitened(bodies, w, twist)
