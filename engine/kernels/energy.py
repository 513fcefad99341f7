"""The energy of the bodies, and the energy that a step creates (docs/method.md, Energy).

The twists of a step satisfy M (v+ - v) = h F + G' r + J' l, and the bodies move by h v_theta, with
v_theta = (1 - theta) v + theta v+. Multiplied by (v + v+)/2 = v_theta - (theta - 1/2) (v+ - v) this gives

    K+ - K = h F . v_theta + r . u_theta + l . J v_theta - (theta - 1/2) |v+ - v|^2_M

The first term is the work of the loads along the displacement of the bodies; the third is zero for a joint, and the
work of the drive for a motion. The rest belongs to the contacts; the projection adds the work against the loads along
its displacement. Friction and impacts dissipate energy; where the sum is positive, the step created it.
"""

from engine.jit import inner
from engine.kernels.contacts import contact_velocity


@inner
def kinetic_energy(bodies, v):
    """Return the kinetic energy of the bodies, the sum of m |v|^2 / 2 + O . I O / 2."""
    energy = 0.0
    for body in range(bodies.mass.shape[0]):
        J, t = bodies.inertia[body], v[body]
        for k in range(3):
            energy += 0.5 * bodies.mass[body] * t[k] * t[k]
            for j in range(3):
                energy += 0.5 * t[3 + k] * J[k, j] * t[3 + j]
    return energy


@inner
def work_of_contacts(bodies, contacts, state, work, problem, n, theta, plain):
    """Return r . u_theta - (theta - 1/2) |v+ - v|^2_M of a step with ``n`` contacts, and what lasting contacts remove.

    The first is negative where contacts dissipate energy. The state has the pose within the step and the twists at its
    end; its relative velocities, and ``work.u``, those at the start of the step, are computed here. In the ``plain``
    scheme ``work.u`` is given, because its contact frames belong to another pose.

    Between the poses of two steps the relative velocity of a contact that lasts changes although no impulse acts: on a
    curved surface, or where a body rolls, the tangent plane turns. What impulses do against this part is no friction.
    What friction takes is written into ``work.rubbed`` where it is read.
    """
    gained, removed, rubbed = 0.0, 0.0, work.rubbed
    for i in range(rubbed.shape[0]):
        rubbed[i] = 0.0
    for j in range(n):
        i = work.chosen[j]
        for k in range(3):
            gained += theta * problem.r[j, k] * problem.u[j, k]
        gained -= theta * problem.r[j, 0] * work.shift[i]  # problem.u contains the shift of the impact law
        if not plain:
            contact_velocity(contacts, state.x, state.R, work.sites, work.start.v, i, work.u)
        for k in range(3):
            gained += (1 - theta) * problem.r[j, k] * work.u[i, k]
            if work.start.r[i, 0] > 0.0:
                removed -= 0.5 * problem.r[j, k] * (work.u[i, k] - work.start.u[i, k])
            if k > 0 and rubbed.shape[0] > 0:
                rubbed[i] -= problem.r[j, k] * (theta * problem.u[j, k] + (1 - theta) * work.u[i, k])
            state.u[i, k] = problem.u[j, k] - (work.shift[i] if k == 0 else 0.0)
    if n > 0:
        gained -= (theta - 0.5) * _square_of_change(bodies, work.start.v, state.v)
    return gained, removed


@inner
def _square_of_change(bodies, before, after):
    """Return |v+ - v|^2 in the metric of the mass matrix for twists of shape (nb + 1, 6)."""
    total = 0.0
    for body in range(bodies.mass.shape[0]):
        J, v, w = bodies.inertia[body], before[body], after[body]
        for k in range(3):
            d, spin = w[k] - v[k], w[3 + k] - v[3 + k]
            total += bodies.mass[body] * d * d
            for j in range(3):
                total += spin * J[k, j] * (w[3 + j] - v[3 + j])
    return total


@inner
def work_of_displacement(R, wrench, displacement):
    """Return the work of forces and torques, in world axes, along displacements of the bodies.

    A displacement is one of the centre of mass, and a rotation in body axes; both arrays have shape (nb + 1, 6).
    """
    total = 0.0
    for body in range(R.shape[0] - 1):
        f, d = wrench[body], displacement[body]
        for k in range(3):
            total += f[k] * d[k] + f[3 + k] * (R[body, k, 0] * d[3] + R[body, k, 1] * d[4] + R[body, k, 2] * d[5])
    return total
