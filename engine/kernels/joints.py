"""Joint stages: twists that keep ideal joints and prescribed motions, before the contacts and at the end of a step.

Within the step the mean velocity keeps the constraint, J (theta v+ + (1 - theta) v) = s' with J at mid-step; at the end
the velocities themselves, J v+ = s' with J there (a multiplier each, as in the RATTLE scheme). With theta = 1/2 that is
second order and joints do no work; J v+ = s' with J at mid-step alone loses energy in every turn.
"""

from engine.friction.ties import hold_ties, tie_down
from engine.kernels.contacts import add_whitened
from engine.kernels.jit import kernel
from engine.kernels.ties import tie_velocity, tie_violations, whitened_ties


@kernel
def hold_joints(bodies, ties, state, work, problem, h, theta):
    """Change the free twists ``work.free`` so that the joints hold over the step; the pose is that of mid-step."""
    if work.violation.shape[0] == 0:
        return
    point, way, c = work.tie_point, work.tie_way, work.violation
    tie_violations(ties, state.x, state.R, work.target[1], c, point, way)
    for i in range(c.shape[0]):
        mean = ties.arm[i] * (work.target[1, i] - work.target[0, i]) / h
        before = tie_velocity(ties, state.x, state.R, point, way, state.v, i)
        after = tie_velocity(ties, state.x, state.R, point, way, work.free, i)
        c[i] = after - (mean - (1 - theta) * before) / theta
    _hold(bodies, ties, state, work, problem, work.free)


@kernel
def align_velocities(bodies, ties, state, work, problem):
    """Change the twists so that the joints hold at the end of the step; the projection has found the rows there."""
    if work.violation.shape[0] == 0:
        return
    c = work.violation
    for i in range(c.shape[0]):
        rate = ties.arm[i] * work.target[2, i]
        c[i] = tie_velocity(ties, state.x, state.R, work.tie_point, work.tie_way, state.v, i) - rate
    _hold(bodies, ties, state, work, problem, state.v)


@kernel
def _hold(bodies, ties, state, work, problem, twist):
    """Add to the twists what takes the rates ``work.violation`` away, at the least energy."""
    whitened_ties(bodies, ties, state.x, state.R, work.tie_point, work.tie_way, problem.ties.J)
    tie_down(problem.w.shape[0], problem.ties)
    hold_ties(problem.w.shape[0], problem.ties, work.violation, problem.w)
    add_whitened(bodies, problem.w, twist)
