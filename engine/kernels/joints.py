"""Joint stages: twists consistent with ideal joints and prescribed motions, before the contacts and after a step.

Within the step the mean velocity satisfies the constraint, J (theta v+ + (1 - theta) v) = s' with J at mid-step; at the
end the velocities themselves satisfy it, J v+ = s' with J at the new pose (with multipliers of their own, as in the
RATTLE scheme). With theta = 1/2 this is of second order and joints do no work; J v+ = s' with J at mid-step alone would
lose energy in every turn.
"""

from engine.friction.bilateral import factorise_bilateral, hold_bilateral
from engine.jit import inner
from engine.kernels.bilateral import row_velocity, row_violations, whitened_bilateral_rows
from engine.kernels.contacts import add_whitened
from engine.kernels.motion import NOTHING


@inner
def hold_joints(bodies, rows, state, at_pose, problem, twist, h, theta):
    """Change ``twist``, with the least kinetic energy, so that the joints hold at the current pose.

    The mean velocity of a step of length ``h`` must satisfy the joints, with the twists at its start in ``state``; if
    ``h`` is 0, the velocity at the end must. The bilateral system of ``problem`` and its unknowns are overwritten.
    """
    x, R = state.x, state.R
    if at_pose.violation.shape[0] == 0:
        return
    c, point, direction = at_pose.violation, at_pose.point, at_pose.direction
    row_violations(rows, x, R, at_pose.target[1], c, point, direction)
    for i in range(c.shape[0]):
        c[i] = row_velocity(rows, x, R, point, direction, twist, i)
        if h > 0.0:
            mean = rows.arm[i] * (at_pose.target[1, i] - at_pose.target[0, i]) / h
            c[i] -= (mean - (1 - theta) * row_velocity(rows, x, R, point, direction, state.v, i)) / theta
        else:
            c[i] -= rows.arm[i] * at_pose.target[2, i]
        if abs(c[i]) < NOTHING:
            c[i] = 0.0
    whitened_bilateral_rows(bodies, rows, x, R, point, direction, problem.bilateral.J)
    factorise_bilateral(problem.system, problem.bilateral)
    hold_bilateral(problem.system, problem.bilateral, c, problem.w)
    add_whitened(bodies, problem.w, twist)
