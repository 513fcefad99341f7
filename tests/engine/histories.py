"""The motion of a run as arrays, step by step, and what is conserved in it."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly, assemble
from engine.kernels.record import BODY, CONTACT, HEAD
from engine.kernels.time_loop import MAX_PENETRATION, MAX_VIOLATION, OK, STATUS
from engine.loop import control_of, drive
from engine.mechanism import Mechanism


@dataclass(frozen=True)
class History:
    """``n`` instants of a run to its horizon, the start among them, with ``nb`` bodies and ``nc`` contacts."""

    assembly: Assembly
    step: Array  # (n,) lengths of the steps that led to the instants
    energy: Array  # (n,) kinetic and potential
    x: Array  # (n, nb, 3) centres of mass
    p: Array  # (n, nb, 4) quaternions (w, x, y, z)
    v: Array  # (n, nb, 6) velocities (world) and angular velocities (body axes)
    gap: Array  # (n, nc)
    r: Array  # (n, nc, 3) impulses

    def rotation(self) -> Array:
        """Return the rotation matrices of the bodies, shape (n, nb, 3, 3)."""
        w, a, b, c = np.moveaxis(self.p, -1, 0)
        rows = [
            [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
            [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
            [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
        ]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    def momentum(self) -> Array:
        """Return linear momentum, and angular momentum about the world's origin, of all bodies: shape (n, 6)."""
        bodies = self.assembly.model.bodies
        linear = bodies.mass[:, None] * self.v[..., :3]
        own = np.einsum("nbij,bjk,nbk->nbi", self.rotation(), bodies.inertia, self.v[..., 3:])
        return np.concatenate([linear.sum(1), (np.cross(self.x, linear) + own).sum(1)], axis=1)


def history(mechanism: Mechanism) -> History:
    """Run to the horizon, which has to end well, and keep every step."""
    return recorded(assemble(mechanism), mechanism)


def recorded(assembly: Assembly, mechanism: Mechanism) -> History:
    """Run a mechanism's arrays to the horizon, see `history`."""
    control, blocks = control_of(mechanism, True), []
    course = drive(assembly, control, 60.0, sink=lambda rows: blocks.append(rows.copy()))
    assert course.counts[STATUS] == OK
    assert course.reals[MAX_PENETRATION] <= control.penetration
    assert course.reals[MAX_VIOLATION] <= control.violation
    rows, nb, nc = np.concatenate(blocks), len(assembly.model.bodies.mass), len(assembly.contact_names)
    bodies = rows[:, HEAD : HEAD + BODY * nb].reshape(len(rows), nb, BODY)
    contacts = rows[:, HEAD + BODY * nb : HEAD + BODY * nb + CONTACT * nc].reshape(len(rows), nc, CONTACT)
    return History(
        assembly,
        rows[:, 1],
        rows[:, 2] + rows[:, 3],
        bodies[..., :3],
        bodies[..., 3:7],
        bodies[..., 7:],
        contacts[..., 0],
        contacts[..., 1:4],
    )
