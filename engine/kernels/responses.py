"""What is measured on the mechanism: distances between features and contact forces."""

from engine.kernels.jit import kernel
from engine.kernels.model import CONTACT_FORCE
from engine.kernels.rotations import to_world, turn_to_world


@kernel
def measure(responses, x, R, r, h, values, p, q):
    """Write every response, shape (nr,), at the pose (x, R) with the impulses r; ``p``, ``q`` are work space (3,)."""
    for i in range(values.shape[0]):
        if responses.kind[i] == CONTACT_FORCE:
            values[i] = r[responses.body[i, 0], 0] / h + responses.offset[i]
        else:
            values[i] = _position(responses.body[i], responses.point[i], x, R, p, q) + responses.offset[i]


@kernel
def _position(body, row, x, R, p, q):
    """Component of the way from a point, or from an axis at the height of the other point, to a point."""
    to_world(x, R, body[0], row, 0, p)
    to_world(x, R, body[1], row, 6, q)
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    turn_to_world(R, body[0], row, 3, p)
    along = d0 * p[0] + d1 * p[1] + d2 * p[2]  # 0 for a point: its axis is the zero vector
    d0, d1, d2 = d0 - along * p[0], d1 - along * p[1], d2 - along * p[2]
    turn_to_world(R, body[2], row, 9, p)
    return d0 * p[0] + d1 * p[1] + d2 * p[2]
