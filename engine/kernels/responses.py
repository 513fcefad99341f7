"""What is measured on the mechanism: distances between features and contact forces."""

from engine.kernels.jit import kernel
from engine.kernels.model import CONTACT_FORCE
from engine.kernels.rotations import to_world, turn_to_world


@kernel
def measure(model, state, h, values, p, q):
    """Write every response, shape (nr,), at the pose and impulses in ``state``; ``p``, ``q`` are work space (3,)."""
    for i in range(values.shape[0]):
        body = model.response_body[i]
        if model.response_kind[i] == CONTACT_FORCE:
            values[i] = state.r[body[0], 0] / h + model.response_offset[i]
        else:
            values[i] = _position(model, state, i, p, q) + model.response_offset[i]


@kernel
def _position(model, state, i, p, q):
    """Component of the way from a point, or from an axis at the height of the other point, to a point."""
    body, local = model.response_body[i], model.response_point[i]
    to_world(state.x, state.R, body[0], local[0], p)
    to_world(state.x, state.R, body[1], local[2], q)
    d0, d1, d2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    turn_to_world(state.R, body[0], local[1], p)
    along = d0 * p[0] + d1 * p[1] + d2 * p[2]  # 0 for a point: its axis is the zero vector
    d0, d1, d2 = d0 - along * p[0], d1 - along * p[1], d2 - along * p[2]
    turn_to_world(state.R, body[2], local[3], p)
    return d0 * p[0] + d1 * p[1] + d2 * p[2]
