"""The slider-crank by events: minimal coordinates between impacts (DOP853), Newton's law with friction at each.

Bounces on a face come ever closer, until the slider slides along it; there the force on it is the multiplier of one
more constraint, and it leaves where that force ends. The slider's angle stays zero, for both corners of a side touch at
once, so the crank's and the rod's angle are left. Nothing of this is shared with the engine: no time steps, no active
sets, no joints to hold.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

L1, L2, CLEARANCE = 0.153, 0.306, 1e-3  # m
M1, M2, M3, J1, J2 = 0.038, 0.038, 0.076, 7.4e-5, 5.9e-4  # kg, kg m2
RESTITUTION, FRICTION, GRAVITY = 0.4, 0.01, 9.81
REBOUND = 2e-3  # m/s: after a slower one the slider stays on the face; what would follow rises by less than 0.1 um

Array = NDArray[np.float64]


def mass_matrix(th: Array) -> Array:
    """Return the mass matrix in the angles of crank and rod, shape (2, 2)."""
    coupling = L1 * L2 * (0.5 * M2 + M3) * np.cos(th[0] - th[1])
    crank, rod = J1 + (0.25 * M1 + M2 + M3) * L1**2, J2 + (0.25 * M2 + M3) * L2**2
    return np.array([[crank, coupling], [coupling, rod]])


def rates(_: float, y: Array) -> Array:
    """Return the rates of angles and speeds y = (th1, th2, w1, w2) in free motion (Lagrange's equations)."""
    th, w = y[:2], y[2:]
    inertial = L1 * L2 * (0.5 * M2 + M3) * np.sin(th[0] - th[1]) * np.array([-(w[1] ** 2), w[0] ** 2])
    weight = -GRAVITY * np.array([(0.5 * M1 + M2 + M3) * L1, (0.5 * M2 + M3) * L2]) * np.cos(th)
    return np.concatenate([w, np.linalg.solve(mass_matrix(th), inertial + weight)])


def height(th: Array) -> float:
    """Return the height of the slider."""
    return float(L1 * np.sin(th[0]) + L2 * np.sin(th[1]))


def after_impact(y: Array) -> Array:
    """Return the state after the slider, sliding on, has hit the guide: Newton's law, Coulomb's with its full size."""
    th, w = y[:2], y[2:]
    side = np.sign(height(th))
    normal = -side * np.array([L1, L2]) * np.cos(th)
    along = -np.array([L1, L2]) * np.sin(th)
    push = normal - FRICTION * np.sign(along @ w) * along
    change = np.linalg.solve(mass_matrix(th), push)
    return np.concatenate([th, w - (1 + RESTITUTION) * (normal @ w) / (normal @ change) * change])


def flight(t: float, y: Array) -> tuple[Array, Array]:
    """Return times and states (n, 4) of free motion until the slider reaches a face."""
    reach = [lambda _, y, s=s: s * height(y[:2]) - CLEARANCE for s in (-1, 1)]
    for event in reach:
        event.terminal, event.direction = True, 1
    found = solve_ivp(rates, (t, t + 0.1), y, "DOP853", events=reach, rtol=1e-12, atol=1e-14, max_step=1e-5)
    return found.t, found.y.T


def run(impacts: int) -> tuple[Array, Array, Array]:
    """Return times and states (n, 4) up to the given number of impacts, and the times of these."""
    y = np.array([0.0, 0.0, 150.0, -75.0])
    times, states = [np.zeros(1)], [y[None]]
    for _ in range(impacts):
        flown, path = flight(times[-1][-1], y)
        times.append(flown[1:])
        states.append(path[1:])
        y = after_impact(path[-1])
    return np.concatenate(times), np.concatenate(states), np.array([flown[-1] for flown in times[1:]])


def force_on_face(y: Array, side: float) -> tuple[Array, float]:
    """Return the rates of y while the slider slides along a face, and the normal force that this takes [N].

    The gap ``c - side height`` stays zero, and so do its rates: one more equation, with the force as its unknown.
    """
    th, w = y[:2], y[2:]
    normal, along = -side * np.array([L1, L2]) * np.cos(th), -np.array([L1, L2]) * np.sin(th)
    push = np.linalg.solve(mass_matrix(th), normal - FRICTION * np.sign(along @ w) * along)
    free = rates(0.0, y)[2:]
    curving = side * np.array([L1, L2]) * np.sin(th) @ w**2
    force = -(normal @ free + curving) / (normal @ push)
    return np.concatenate([w, free + force * push]), float(force)


def slide(t: float, y: Array, side: float) -> tuple[Array, Array]:
    """Return times and states (n, 4) of the motion along a face until its force ends."""

    def leaves(_: float, y: Array) -> float:
        return force_on_face(y, side)[1]

    leaves.terminal, leaves.direction = True, -1
    found = solve_ivp(
        lambda _, y: force_on_face(y, side)[0], (t, t + 0.1), y, "DOP853", events=leaves, rtol=1e-12, atol=1e-14,
        max_step=1e-5,
    )  # fmt: skip
    return found.t, found.y.T


def bounce_and_slide(end: float) -> tuple[Array, Array, list[tuple[float, float]]]:
    """Return times and states (n, 4) up to `end` [s] at least, and when each slide began and ended.

    A flight or a slide that has begun by then is followed to its end.
    """
    y = np.array([0.0, 0.0, 150.0, -75.0])
    times, states, slides = [np.zeros(1)], [y[None]], []
    while times[-1][-1] < end:
        flown, path = flight(times[-1][-1], y)
        y = after_impact(path[-1])
        times.append(flown[1:])
        states.append(path[1:])
        side = float(np.sign(height(y[:2])))
        if -side * (np.array([L1, L2]) * np.cos(y[:2])) @ y[2:] > REBOUND:
            continue
        slid, path = slide(flown[-1], y, side)
        y = path[-1]
        times.append(slid[1:])
        states.append(path[1:])
        slides.append((float(slid[0]), float(slid[-1])))
    return np.concatenate(times), np.concatenate(states), slides
