"""Kinetic energy of the bodies."""

from engine.jit import inner


@inner
def kinetic_energy(bodies, v):
    """Return the sum of m |v|^2 / 2 + O . I O / 2."""
    energy = 0.0
    for body in range(bodies.mass.shape[0]):
        J, t = bodies.inertia[body], v[body]
        for k in range(3):
            energy += 0.5 * bodies.mass[body] * t[k] * t[k]
            for j in range(3):
                energy += 0.5 * t[3 + k] * J[k, j] * t[3 + j]
    return energy
