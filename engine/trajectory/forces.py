"""Contact forces of a trajectory as vectors in the world; the file stores them in each contact's own frame."""

from collections.abc import Sequence

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly, assemble
from engine.assembly.frames import order_bodies
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.motion import move
from engine.trajectory.read import Trajectory


def contact_forces(trajectory: Trajectory, instants: Sequence[int]) -> tuple[Array, Array]:
    """Return the contact points, and the mean forces over the recorded steps since the previous instant.

    A force is that on the contact's first body, or on the second if the first is fixed.

    `instants` are m rows of the trajectory, increasing; the first gets the force of its own step alone. Points and
    forces have shape (m, nc, 3), in world axes.
    """
    mechanism = trajectory.mechanism()
    assembly, order = assemble(mechanism), order_bodies(mechanism)
    work, step = assembly.work, trajectory.step
    # in the plain scheme the frames are those at the end of a step
    within = (0.0 if trajectory.settings["scheme"] == "moreau_jean" else trajectory.settings["theta"]) * step
    sign = np.where(assembly.model.contacts.a < len(order), 1.0, -1.0)
    histories = [trajectory.contacts[name] for name in assembly.contact_names]
    points, forces = np.zeros((2, len(instants), len(sign), 3))
    since = instants[0]
    for i, row in enumerate(instants):
        for at in range(since, row + 1):
            _place(assembly, trajectory, order, at, float(within[at]))
            impulse = np.reshape([history.impulse[at] for history in histories], (-1, 3))
            forces[i] += np.einsum("c,ck,ckj->cj", sign, impulse, work.sites.frame)
        points[i] = work.sites.point
        forces[i] /= step[since : row + 1].sum()
        since = row + 1
    return points, forces


def _place(assembly: Assembly, trajectory: Trajectory, order: list[str], row: int, back: float) -> None:
    """Find the contacts as in the step: at the pose of a row minus the last part of its displacement."""
    state, work = assembly.state, assembly.work
    for body, name in enumerate(order):
        motion = trajectory.bodies[name]
        state.x[body], state.p[body] = motion.position[row], motion.quaternion[row]
        state.v[body, :3], state.v[body, 3:] = motion.velocity[row], motion.angular_velocity[row]
    move(state, -back)
    find_contacts(assembly.model.contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
