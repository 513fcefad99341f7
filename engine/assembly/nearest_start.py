"""The start pose nearest to the drawn one in which no parts overlap and all ideal joints are closed.

It minimises w' w / 2 over w, the displacements of the bodies times the root of the mass matrix, subject to g(w) >= 0 at
the contacts and c(w) = 0 in ideal joints and in motions of the first phase, by sequential quadratic programming: each
round is a least-distance problem (Lawson and Hanson, Solving Least Squares Problems, chapter 23). The curvature of the
contacts is part of it, for a light pin moves far round its bore. A contact yields by COMPLIANCE times its multiplier,
so that each round has a solution. If the search ends with an overlap, the pose that violates least is sought from
there (Levenberg and Marquardt), then the nearest one again. Where the violation can no longer be reduced, the
multipliers prove by duality how far the bodies would have to move at least, and which contacts are in the way.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, Integers
from engine.friction.arrays import dense_rows
from engine.friction.blocks import ROW
from engine.kernels.bilateral import REDUNDANT, row_violations, whitened_bilateral_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import whitened_rows
from engine.kernels.model import ARC_PLANE, CYLINDER_PLANE, GEARS, JOINT_FRICTION, POINT_PLANE, RunArrays
from engine.kernels.vectors import rotation_matrix
from engine.platform.linear_algebra import nonnegative_least_squares, one_thread

ROUNDS = 60  # of each search; most need 3 to 20
ATTEMPTS = 3  # pairs of searches: for the nearest pose, then for the one that violates least
COMPLIANCE = 1e-10  # share of a displacement by which a contact yields
SOFTER, SOFTEST = 30.0, 1e4  # factor of the compliance after a round that does not help, and its limit
CLOSE = 1e-3  # share of the displacement: a smaller change of the pose no longer counts
REACH = 2.0  # contacts with gaps below this multiple of the longest displacement take part
SHORTEST = 1e-3  # share of a round's change; a search that needs shorter ones has ended
ENOUGH = 1e-4  # share of the predicted decrease
STILL = 1e-6  # share of the squared violations: a round that removes less ends the search
STEP = 1e-5  # of the longest displacement, for differences of gaps
NOTHING = 1e-12  # share of the longest row: a shorter one is a rounding error of 0
STRONG = 0.1  # share of the largest multiplier: a contact with more is in the way

FLAT = (POINT_PLANE, ARC_PLANE, CYLINDER_PLANE, GEARS)


@dataclass(frozen=True)
class NearestStart:
    """Where the search for a start pose has ended; the state holds this pose.

    A displacement is the root mean square over the mass: of a body, or of all bodies.
    """

    travel: float  # displacement of the body that moves farthest
    body: int  # that body
    least: float  # of all bodies: no smaller displacement frees what still overlaps here; 0 if nothing does
    blocking: tuple[int, ...]  # contacts in the way, the strongest first


@dataclass(frozen=True)
class _Limits:
    """What a search is allowed to leave, and how far it goes in a round."""

    longest: float
    gap: float
    violation: Array  # (nt,) of each row of joints and motions


class _Search:
    """The constraints and their gradients at a pose w."""

    def __init__(self, arrays: RunArrays) -> None:
        model, self.state, self.work, self.problem = arrays
        grain = model.contacts.grain.copy()
        grain[:, 4:] = 1.0  # the tangents of a shape have length 1
        self.model = model._replace(contacts=model.contacts._replace(grain=grain))
        self.x, self.p = self.state.x.copy(), self.state.p.copy()
        self.columns = ROW * self.model.bodies.node[:, None] + np.arange(6)  # (nb, 6) of each body in w
        self.turn = np.zeros((len(self.model.bodies.mass), 3, 3))

    def put(self, w: Array) -> None:
        """Move the bodies from the drawn pose by w, and write gaps, contact frames and joint violations."""
        bodies, state, work = self.model.bodies, self.state, self.work
        state.x[:-1] = self.x[:-1] + w[self.columns[:, :3]] / np.sqrt(bodies.mass)[:, None]
        for i, root in enumerate(bodies.inverse_root):
            vector = root.T @ w[self.columns[i, 3:]]  # of the rotation, in body axes
            state.p[i] = _product(self.p[i], _quaternion(vector))
            rotation_matrix(state.p[i], state.R[i])
            self.turn[i] = root @ _right_jacobian(vector).T @ np.linalg.inv(root)
        find_contacts(self.model.contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
        state.gap[self.model.contacts.stiffness > 0.0] = np.inf  # they may overlap
        at, drawn = work.bilateral, np.zeros(len(work.bilateral.violation))
        row_violations(self.model.bilateral, state.x, state.R, drawn, at.violation, at.point, at.direction)

    def contact_rows(self, chosen: Integers) -> Array:
        """Return the gradients of some contacts along (N, T1, T2), shape (m, 3, n)."""
        model, state, rows = self.model, self.state, self.problem.rows
        for j, i in enumerate(chosen):
            whitened_rows(model.bodies, model.contacts, state.x, state.R, self.work.sites, i, rows, j)
        return self._by_w(dense_rows(rows.node[: chosen.size], rows.G[: chosen.size], self.problem.w.size))

    def joint_rows(self) -> Array:
        """Return the gradients of joints and motions, shape (nt, n)."""
        model, state, at, system = self.model, self.state, self.work.bilateral, self.problem.bilateral
        whitened_bilateral_rows(model.bodies, model.bilateral, state.x, state.R, at.point, at.direction, system.J)
        return self._by_w(dense_rows(system.node, system.J[:, None], self.problem.w.size))[:, 0]

    def _by_w(self, rows: Array) -> Array:
        """Return gradients with respect to w, from those with respect to a further displacement."""
        for columns, turn in zip(self.columns[:, 3:], self.turn, strict=True):
            rows[..., columns] = rows[..., columns] @ turn.T
        return rows

    def curvature(self, force: Array, step: float) -> Array:
        """Return the rows t with which contacts of these multipliers add t' t to the Hessian, shape (k, n).

        The second difference of a gap as the first body moves across its normal; a gap that opens is left out.
        """
        contacts, state, sites = self.model.contacts, self.state, self.work.sites
        chosen = np.flatnonzero((force > 0.0) & ~np.isin(contacts.kind, FLAT))
        place, ways = sites.point[chosen].copy(), sites.frame[chosen].copy()
        x, gap, scratch = state.x.copy(), np.zeros_like(state.gap), (sites.point.copy(), sites.frame.copy())
        bend = np.zeros((chosen.size, 2))
        for j, i in enumerate(chosen):
            first = contacts.a[i] < len(x) - 1
            body = contacts.a[i] if first else contacts.b[i]  # the ground does not move: neither way matters
            for k, along in ((0, step), (0, -step), (1, step), (1, -step)):
                x[body] = state.x[body] + along * ways[j, 1 + k]
                find_contacts(contacts, x, state.R, gap, *scratch)
                bend[j, k] += (state.gap[i] - gap[i]) / step**2
            x[body] = state.x[body]
            # the middle of a round feature, which stays where it is as it turns
            sites.point[i] = state.x[contacts.a[i]] + state.R[contacts.a[i]] @ contacts.geometry_a[i, :3]
        rows = self.contact_rows(chosen)[:, 1:]
        sites.point[chosen] = place
        share = np.sqrt(force[chosen, None] * np.maximum(bend, 0.0))
        return np.asarray((share[..., None] * rows)[bend > CLOSE * STEP / step])

    def near(self, limits: _Limits) -> tuple[Integers, Array, Array]:
        """Return the contacts that take part, the gradients of their gaps, and those of the joints."""
        place = self.model.contacts.kind < JOINT_FRICTION  # those above are directions
        chosen = np.flatnonzero((self.state.gap <= REACH * limits.longest) & place)
        return chosen, self.contact_rows(chosen)[:, 0], self.joint_rows()

    def lengths(self, w: Array) -> Array:
        """Return the displacement of each body, shape (nb,)."""
        return np.asarray(np.linalg.norm(w[self.columns], axis=1) / np.sqrt(self.model.bodies.mass))

    def is_free(self, limits: _Limits) -> bool:
        """Return whether nothing is violated by more than what may remain."""
        off = np.abs(self.work.bilateral.violation)
        return bool(self.state.gap.min(initial=0.0) >= -limits.gap and (off <= limits.violation).all())

    def violations(self) -> Array:
        """Return how far contacts overlap and joints are open."""
        return np.concatenate([np.minimum(self.state.gap, 0.0), np.abs(self.work.bilateral.violation)])


def find_nearest_start(arrays: RunArrays, longest: float, gap: float, violation: Array) -> NearestStart:
    """Move the bodies to the nearest pose without overlap and with closed joints.

    ``longest`` is the displacement of a body that is of interest, ``gap`` and ``violation``, (nt,), are what may
    remain. If there is no such pose, the state holds one that violates little.
    """
    search, limits = _Search(arrays), _Limits(longest, gap, violation)
    w = np.zeros(arrays.problem.w.size)
    with one_thread():
        search.put(w)
        for stage in ATTEMPTS * (_approach, _repair):
            w = stage(search, w, limits)
            if search.is_free(limits):
                break
        least, blocking = (0.0, ()) if search.is_free(limits) else _blocked(search, w, limits)
    lengths = search.lengths(w)
    return NearestStart(float(lengths.max(initial=0.0)), int(lengths.argmax()), least, blocking)


def _approach(search: _Search, w: Array, limits: _Limits) -> Array:
    """Look for the nearest free pose; return where the search ends.

    A round goes as far as w' w / 2 plus a multiple of the violations decreases.
    """
    state, off, weight = search.state, search.work.bilateral.violation, 0.0
    force = np.zeros(len(state.gap))
    for _ in range(ROUNDS):
        bent = search.curvature(force, STEP * limits.longest)
        chosen, rows, J = search.near(limits)
        goal, pressed, pull = _round(w, rows, state.gap[chosen], J, off, bent)
        force[:] = 0.0
        force[chosen], change = pressed, goal - w
        far, missing = search.lengths(change).max(initial=0.0), np.abs(search.violations()).sum()
        weight = max(weight, 2.0 * pressed.max(initial=0.0), 2.0 * pull)
        before, slope = 0.5 * w @ w + weight * missing, min(w @ change - weight * missing, 0.0)
        share = min(1.0, limits.longest / far if far > 0.0 else 1.0)
        while share > SHORTEST:
            search.put(w + share * change)
            after = 0.5 * np.sum((w + share * change) ** 2) + weight * np.abs(search.violations()).sum()
            if after <= before + ENOUGH * share * slope:
                break
            share *= 0.5
        w = w + share * change
        small = far <= max(CLOSE * search.lengths(w).max(initial=0.0), limits.gap)
        if share <= SHORTEST or (small and (search.is_free(limits) or far <= limits.gap)):
            break
    search.put(w)
    return w


def _repair(search: _Search, w: Array, limits: _Limits) -> Array:
    """Look for the pose with the least sum of squared violations, each round by the shortest way; return its w."""
    state, off, yields = search.state, search.work.bilateral.violation, COMPLIANCE
    for _ in range(ROUNDS):
        chosen, rows, J = search.near(limits)
        gap, apart, before = state.gap[chosen].copy(), off.copy(), np.sum(search.violations() ** 2)
        bent = search.curvature(np.maximum(-state.gap, 0.0), STEP * limits.longest) / _longest(rows)
        while yields < SOFTEST:
            change, _, _ = _round(np.zeros_like(w), rows, gap, J, apart, bent / np.sqrt(yields), yields)
            if search.lengths(change).max(initial=0.0) <= limits.longest:
                search.put(w + change)
                if np.sum(search.violations() ** 2) < before:
                    break
            yields *= SOFTER
        else:
            search.put(w)
            break
        w, yields = w + change, max(yields / SOFTER, COMPLIANCE)
        if search.is_free(limits) or np.sum(search.violations() ** 2) > (1.0 - STILL) * before:
            break
    return w


def _blocked(search: _Search, w: Array, limits: _Limits) -> tuple[float, tuple[int, ...]]:
    """Return a lower bound of the displacement of all bodies that frees the contacts, by their gradients at w.

    For any multipliers p >= 0, rows d >= h requires |d| >= p . h / |rows' p|. The contacts are those with large ones.
    """
    chosen, rows, J = search.near(limits)
    held, beside, _ = _hold(w, J, search.work.bilateral.violation)
    h = rows @ (w - held) - search.state.gap[chosen]
    across, p = _least_distance(rows @ beside.T, h, _longest(rows))
    work, length = float(p @ h), float(np.linalg.norm(across))
    stuck = h[np.linalg.norm(rows @ beside.T, axis=1) <= NOTHING * _longest(rows)].max(initial=0.0) > limits.gap
    least = np.inf if stuck else np.hypot(np.linalg.norm(held), work / length if length > 0.0 else 0.0)
    p = np.where(np.isfinite(least), p, np.maximum(h, 0.0))
    order = np.argsort(-p, kind="stable")
    blocking = tuple(int(chosen[j]) for j in order if p[j] > STRONG * p.max(initial=0.0))
    return float(least / np.sqrt(search.model.bodies.mass.sum())), blocking


def _round(
    w: Array, rows: Array, gap: Array, J: Array, violation: Array, bent: Array, yields: float = COMPLIANCE
) -> tuple[Array, Array, float]:
    """Return the shortest v with rows (v - w) + gap >= 0 and J (v - w) + violation = 0, and the contacts' multipliers.

    What ``bent``, (k, n), adds to the Hessian is that of the constraints. The last number is the largest multiplier of
    a joint.
    """
    held, beside, pull = _hold(w, J, violation)
    across = bent @ beside.T
    L = np.linalg.cholesky(np.eye(len(beside)) + across.T @ across)
    middle = np.linalg.solve(L, across.T @ (bent @ (held - w)))
    E = np.linalg.solve(L, beside @ rows.T).T
    s, pressed = _least_distance(E, rows @ (w - held) - gap + E @ middle, _longest(rows), yields)
    v = held + beside.T @ np.linalg.solve(L.T, s - middle)
    left = v + bent.T @ (bent @ (v - w)) - rows.T @ pressed
    return v, pressed, float(np.abs(pull @ left).max(initial=0.0))


def _hold(w: Array, J: Array, violation: Array) -> tuple[Array, Array, Array]:
    """Return the shortest v with J (v - w) + violation = 0, the ways that leave it so, and the map to multipliers.

    What closed loops hold twice is held once, as in a step.
    """
    acts = np.linalg.norm(J, axis=1) > 0.0
    length = np.linalg.norm(J[acts], axis=1)
    unit, wanted = J[acts] / length[:, None], (J[acts] @ w - violation[acts]) / length
    U, values, V = np.linalg.svd(unit, full_matrices=True)
    rank = int(np.count_nonzero(values > REDUNDANT * values.max(initial=0.0)))
    inverse = U[:, :rank] / values[:rank]
    return V[:rank].T @ (inverse.T @ wanted), V[rank:], (inverse / length[:, None]) @ V[:rank]


def _longest(rows: Array) -> float:
    """Return the length of the longest row; 1 without rows."""
    return float(np.linalg.norm(rows, axis=1).max(initial=0.0)) or 1.0


def _least_distance(E: Array, h: Array, scale: float, yields: float = COMPLIANCE) -> tuple[Array, Array]:
    """Return the shortest s with E s + yields scale^2 p >= h, and the multipliers p >= 0."""
    p, most = np.zeros(len(h)), float(h.max(initial=0.0)) / scale
    able = np.linalg.norm(E, axis=1) > NOTHING * scale
    if most > 0.0 and able.any():
        unit, asked = E[able] / scale, h[able] / (scale * most)
        target = np.zeros(E.shape[1] + len(unit) + 1)
        target[-1] = 1.0
        with suppress(RuntimeError):  # a search that does not end moves nothing
            u = nonnegative_least_squares(np.vstack([unit.T, np.sqrt(yields) * np.eye(len(unit)), asked]), target)
            p[able] = most * u / (1.0 - asked @ u) / scale
    return E.T @ p, p


# Rotations: a pose is the drawn one turned by a vector in body axes.


def _product(p: Array, q: Array) -> Array:
    """Return the product of two quaternions (w, x, y, z), of length 1."""
    both = np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])
    return np.asarray(both / np.linalg.norm(both))


def _quaternion(vector: Array) -> Array:
    """Return the quaternion of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    return np.concatenate([[np.cos(angle / 2)], 0.5 * np.sinc(angle / (2 * np.pi)) * vector])


def _right_jacobian(vector: Array) -> Array:
    """Return the derivative of a rotation, in body axes, with respect to its vector, shape (3, 3)."""
    a, b, c = vector
    across = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    angle = float(np.linalg.norm(vector))
    first = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos) / angle^2
    second = (angle - np.sin(angle)) / angle**3 if angle > 1e-3 else 1.0 / 6.0
    return np.asarray(np.eye(3) - first * across + second * (across @ across))
