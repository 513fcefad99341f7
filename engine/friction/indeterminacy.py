"""The range of a normal force that friction allows, over all balanced forces inside Coulomb's cones.

At redundant sticking contacts a continuum of forces gives the same motion. For the normal force of one contact, the
ends of this continuum follow from two cone programmes: the forces r of all contacts must give the same generalised
impulse H' r as a known solution, within the cones. The solutions are r = r0 + Z y with Z a basis of the
self-equilibrated forces. The ends are found with Newton's method on the barrier -log(s_0^2 - |s_T|^2) of the cones,
s = (mu r_N, r_T), approaching their boundary (the path-following method of Nesterov and Nemirovskii).
"""

import math
from collections.abc import Sequence
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from engine.arrays import Array
from engine.friction.barrier import CentreWork, Cones, centre, least
from engine.friction.null_space import null_space
from engine.friction.problem import FrictionError, real_numbers
from engine.jit.lanes import LANES

HUGE = 1e150  # the squares of larger entries overflow
SLACK = 1e-8  # share of the largest force: tolerance for known forces outside their cones; each cone is widened by it
FRICTIONLESS = 1e-12  # a smaller mu counts as 0


def normal_force_range(H: ArrayLike, mu: ArrayLike, r: ArrayLike, contact: int) -> tuple[float, float]:
    """Return the smallest and largest normal force of one contact among all forces with the same balance.

    The largest is infinite where friction locks: two opposite walls can be pressed apart with any force. H, (3 nc, n),
    holds rows (N, T1, T2) per contact in any metric, r the known forces or impulses, inside Coulomb's cones. Raise
    FrictionError if numbers are not finite, shapes do not match, mu < 0, there is no such contact, or r is outside the
    cones.
    """
    H, mu, r = real_numbers("H", H), real_numbers("mu", mu).ravel(), real_numbers("r", r).ravel()
    nc = mu.size
    if H.ndim != 2 or len(H) != 3 * nc or r.size != 3 * nc:
        raise FrictionError(
            f"indeterminacy: H {H.shape} and r {r.shape} with {nc} contacts; expected (3 nc, n), (3 nc,)"
        )
    if (mu < 0).any():
        raise FrictionError(f"indeterminacy: mu[{int(mu.argmin())}] = {mu.min():g}; allowed: >= 0")
    if not isinstance(contact, Integral) or not 0 <= contact < nc:
        raise FrictionError(f"indeterminacy: contact {contact}; allowed: 0 ... {nc - 1}")
    contact = int(contact)  # a bool would index as a mask
    size = float(np.abs(r).max(initial=0))
    if size == 0.0:
        return 0.0, 0.0
    outside = np.hypot(r[1::3] / size, r[2::3] / size) - mu * (r[::3] / size)
    if outside.max() > SLACK**0.5:
        raise FrictionError(f"indeterminacy: r of contact {int(outside.argmax())} is outside Coulomb's cone")
    with np.errstate(all="ignore"):  # numbers may come close to the largest double
        return force_ranges(H, mu, r, [[contact]])[0]


def force_ranges(H: Array, mu: Array, r: Array, groups: Sequence[Sequence[int]]) -> list[tuple[float, float]]:
    """Return the smallest and largest normal force of each of ``groups`` of contacts; see `normal_force_range`.

    At least one force in r must not be 0. Raise FrictionError if the squares of numbers in H overflow.
    """
    size = float(np.abs(r).max())
    cones, scale = _balanced(H, mu, r / size)
    (d, m), e = cones.across.shape, cones.basis.shape[2]
    s, ds = np.zeros((2, m))
    middle, ranges, work = None, [], CentreWork(s, ds, np.zeros((d, e)), *np.zeros((5, e)))
    for group in groups:
        force = math.fsum(float(r[3 * contact]) for contact in group)
        way = np.sum([cones.basis[contact, 0, :d] * scale[contact] for contact in group], axis=0)
        if not np.abs(way).max(initial=0) > SLACK:
            ranges.append((force, force))
            continue
        if middle is None:  # the centre of the cones is the same for all contacts
            middle = np.zeros(e)
            centre(cones, np.zeros(e), middle, work)
        low, high = least(cones, way, middle, work), -least(cones, -way, middle, work)
        ranges.append((max(force + size * low, 0.0), force + size * high))
    return ranges


def _balanced(H: Array, mu: Array, r: Array) -> tuple[Cones, Array]:
    """Return all forces with the same balance as r, and the factors that convert each cone's s_0 to a normal force."""
    rough = mu > FRICTIONLESS
    scale = np.where(rough, 1 / np.where(rough, mu, 1.0), 1.0)
    columns = np.stack([scale, rough, rough], axis=1)  # a frictionless contact has no tangential force
    balance = H.T * columns.ravel()
    largest = np.abs(balance).max(initial=0)
    if not largest < HUGE:  # their squares would overflow
        raise FrictionError(f"indeterminacy: H holds numbers of {np.abs(H).max():.3g}; allowed: less than {HUGE:g} mu")
    if largest > 0:
        balance /= largest
    if not rough.all():
        balance = np.vstack([balance, np.eye(columns.size)[columns.ravel() == 0]])
    start = r.reshape(-1, 3) / np.where(columns > 0, columns, 1.0)
    start[:, 0] = np.maximum(start[:, 0], np.hypot(start[:, 1], start[:, 2])) + SLACK
    free = null_space(balance)
    (n, d), m = free.shape, _groups(len(free))
    cones = Cones(np.zeros(m), np.zeros((mu.size, 3, _groups(d))), np.zeros((d, m)))
    cones.start[:n], cones.basis[..., :d], cones.across[:, :n] = start.ravel(), free.reshape(mu.size, 3, d), free.T
    return cones, scale


def _groups(n: int) -> int:
    """Return n rounded up to whole groups of eight."""
    return -(-n // LANES) * LANES
