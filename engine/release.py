"""Where a phase begins at rest, both rest and motion may solve its equations: then rest goes on.

A bracket on a post locks itself: friction holds it while its rings press on the post, and they press while friction
holds it. To fall freely is a solution as well, and which one a step finds is an accident of its solver. Real contacts
are not quite rigid and hold as they held before. So the run stays at rest if any forces of the contacts that carried
load hold the new loads, and it says that this was a choice.
"""

from dataclasses import replace

import numpy as np

from engine.arrays import Array, copied
from engine.assembly import Assembly
from engine.equilibrium import SHORT, balancing_forces, forces_at_rest
from engine.kernels import time_loop
from engine.kernels.model import Control
from engine.kernels.statics import MOVING, may_hold
from engine.kernels.time_loop import Course, run_to_end
from engine.not_at_rest.continuation import copy_of


def stay_at_rest(assembly: Assembly, control: Control, course: Course, touching_gap: float) -> bool:
    """Let a phase that begins at rest continue it, if contact forces allow; return whether there was a choice.

    The impulses with which the next step begins are changed if it would not stay at rest by itself.
    """
    h, t = map(float, course.reals[[time_loop.STEP, time_loop.TIME]])
    phase = int(course.counts[time_loop.PHASE])
    last = assembly.state.r / h
    if not last.any() or not may_hold(assembly.arrays, phase, t, SHORT * control.step):
        return False
    falls = _moves(assembly, control, course, assembly.state.r)
    if falls is None:
        return False
    falls_without = falls or _moves(assembly, control, course, np.zeros_like(last))
    if not falls_without:
        return False
    pose = replace(assembly, state=copied(assembly.state), work=copied(assembly.work))
    forces_at_rest(pose, phase, control.step, touching_gap, t)  # for the loads, and the rows of the contacts
    held = balancing_forces(pose, last, control.step, only_loaded=True)
    if held is None:
        return False
    if falls:
        if _moves(assembly, control, course, h * held) is not False:
            return False
        assembly.state.r[:] = h * held
    return True


def _moves(assembly: Assembly, control: Control, course: Course, impulses: Array) -> bool | None:
    """Return whether bodies move in the next step if its solution begins with these impulses.

    None if motions drive it, or if it fails.
    """
    arrays, trial = copy_of(assembly.arrays, int(course.counts[time_loop.PHASE])), Course(*map(np.copy, course))
    arrays.state.r[:] = impulses
    only_one_step = np.ones(1, np.uint8)
    run_to_end(arrays, control._replace(pauses=False), trial, np.zeros((1, 1)), 0, only_one_step)
    target = arrays.work.bilateral.target
    if trial.counts[time_loop.STATUS] != time_loop.STOPPED or (target[0] != target[1]).any() or target[2].any():
        return None
    bodies, wrench, twist = arrays.model.bodies, arrays.work.wrench[:-1], arrays.state.v[:-1]
    moment = np.einsum("bji,bj->bi", arrays.state.R[:-1], wrench[:, 3:])
    spin = np.einsum("bij,bj->bi", bodies.inverse_root, moment)
    h = float(trial.reals[time_loop.STEP])
    free = h**2 * float((wrench[:, :3] ** 2 / bodies.mass[:, None]).sum() + (spin**2).sum())
    spins = np.einsum("bi,bij,bj->", twist[:, 3:], bodies.inertia, twist[:, 3:])
    return float(bodies.mass @ (twist[:, :3] ** 2).sum(axis=1) + spins) > MOVING * free
