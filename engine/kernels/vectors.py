"""Vectors of three numbers as tuples: values in registers, for kernels without an array to write them to."""

from engine.jit import inner

NOWHERE = 1e-150  # smallest length whose square does not underflow; a shorter vector has no direction
CENTRED = 1e-10  # share of a radius below which rounding, which depends on the world's axes, would choose a direction


@inner
def dot(a, b):
    """Return the scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def vector_product(a, b):
    """Return the vector product of a and b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inner
def split(v, axis):
    """Return the component of v along a unit vector, a number, and the remainder perpendicular to it, a vector."""
    along = dot(v, axis)
    return along, (v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2])


@inner
def world_direction(R, body, row, k):
    """Return the world components of the body's direction ``row[k : k + 3]``: R d."""
    a, b, c, M = row[k], row[k + 1], row[k + 2], R[body]
    return (
        M[0, 0] * a + M[0, 1] * b + M[0, 2] * c,
        M[1, 0] * a + M[1, 1] * b + M[1, 2] * c,
        M[2, 0] * a + M[2, 1] * b + M[2, 2] * c,
    )


@inner
def world_point(x, R, body, row):
    """Return the world position of the body's point ``row[0:3]``: x + R p."""
    a, b, c, M, o = row[0], row[1], row[2], R[body], x[body]
    return (
        o[0] + M[0, 0] * a + M[0, 1] * b + M[0, 2] * c,
        o[1] + M[1, 0] * a + M[1, 1] * b + M[1, 2] * c,
        o[2] + M[2, 0] * a + M[2, 1] * b + M[2, 2] * c,
    )


@inner
def body_components(R, body, v):
    """Return the components in body axes of a world vector: R' v."""
    M = R[body]
    return (
        M[0, 0] * v[0] + M[1, 0] * v[1] + M[2, 0] * v[2],
        M[0, 1] * v[0] + M[1, 1] * v[1] + M[2, 1] * v[2],
        M[0, 2] * v[0] + M[1, 2] * v[1] + M[2, 2] * v[2],
    )
