"""Contact forces of a trajectory as vectors in the world: the file has them along each contact's own frame."""

from collections.abc import Sequence

import numpy as np

from engine.assembly import Array, assemble
from engine.assembly.frames import order_bodies
from engine.kernels.gaps import find_contacts
from engine.kernels.rotations import rotation_matrix
from engine.trajectory.read import Trajectory


def contact_forces(trajectory: Trajectory, instants: Sequence[int]) -> tuple[Array, Array]:
    """Return where the contacts are and the mean forces of the steps that led there.

    A force is that on the contact's first body; on the second, if the first is fixed. Contacts are found at the pose of
    the instant, which is that of the end of the step; the step took them at its middle.

    Parameters
    ----------
    trajectory : of ``nc`` contacts
    instants : ``m`` rows of it

    Returns
    -------
    points, forces : (m, nc, 3) arrays, in the world
    """
    mechanism = trajectory.mechanism()
    assembly = assemble(mechanism)
    contacts, state, work = assembly.model.contacts, assembly.state, assembly.work
    impulses = [trajectory.contacts[name].impulse[list(instants)] for name in assembly.contact_names]
    sign = np.where(contacts.a < len(state.x) - 1, 1.0, -1.0)
    points, forces = np.zeros((2, len(instants), len(sign), 3))
    for i, row in enumerate(instants):
        for body, name in enumerate(order_bodies(mechanism)):
            motion = trajectory.bodies[name]
            state.x[body], state.p[body] = motion.position[row], motion.quaternion[row]
            rotation_matrix(state.p[body], state.R[body])
        find_contacts(contacts, state.x, state.R, state.gap, work.point, work.frame)
        points[i] = work.point
        along = np.array([impulse[i] for impulse in impulses]).reshape(-1, 3) / trajectory.step[row]
        forces[i] = np.einsum("c,ck,ckj->cj", sign, along, work.frame)
    return points, forces
