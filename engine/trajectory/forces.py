"""Contact forces of a trajectory as vectors in the world: the file has them along each contact's own frame."""

from collections.abc import Sequence

import numpy as np

from engine.assembly import Array, assemble
from engine.assembly.frames import order_bodies
from engine.kernels.gaps import find_contacts
from engine.kernels.rotations import rotation_matrix
from engine.trajectory.read import Trajectory


def contact_forces(trajectory: Trajectory, instants: Sequence[int]) -> tuple[Array, Array]:
    """Return where the contacts are and the mean forces of the recorded steps since the previous of the instants.

    A force is that on the contact's first body; on the second, if the first is fixed. It is turned as the contact is at
    the instant, the end of a step; the step took it at its middle.

    Parameters
    ----------
    trajectory : of ``nc`` contacts
    instants : ``m`` rows of it, increasing

    Returns
    -------
    points, forces : (m, nc, 3) arrays, in the world
    """
    mechanism = trajectory.mechanism()
    assembly = assemble(mechanism)
    contacts, state, work = assembly.model.contacts, assembly.state, assembly.work
    histories = [trajectory.contacts[name] for name in assembly.contact_names]
    sign = np.where(contacts.a < len(state.x) - 1, 1.0, -1.0)
    points, forces = np.zeros((2, len(instants), len(sign), 3))
    since = instants[0]
    for i, row in enumerate(instants):
        for body, name in enumerate(order_bodies(mechanism)):
            motion = trajectory.bodies[name]
            state.x[body], state.p[body] = motion.position[row], motion.quaternion[row]
            rotation_matrix(state.p[body], state.R[body])
        find_contacts(contacts, state.x, state.R, state.gap, work.point, work.frame)
        span = slice(since, row + 1)
        along = np.array([history.impulse[span].sum(axis=0) for history in histories]).reshape(-1, 3)
        points[i] = work.point
        forces[i] = np.einsum("c,ck,ckj->cj", sign / trajectory.step[span].sum(), along, work.frame)
        since = row + 1
    return points, forces
