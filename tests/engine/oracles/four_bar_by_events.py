"""A driven four-bar with play at one pin, by events: two angles, free flight and contact in turn (DOP853), no friction.

The crank turns at a constant speed. The pin between coupler and rocker has play: it is free inside its bore, strikes
it without bounce, follows it while the force presses, and leaves it where that force would pull. Nothing of this is
shared with the engine: no time steps, no active sets, no bodies in space.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

CRANK, COUPLER, ROCKER, BASE = 0.1, 0.26, 0.2, 0.3  # m
MASS = {"crank": 0.2, "coupler": 0.4, "rocker": 0.3}  # kg
INERTIA = {"crank": 1.7e-4, "coupler": 2.25e-3, "rocker": 1e-3}  # kg m2, about the centres
PLAY, SPEED, START, GRAVITY = 1e-3, 10.0, 0.5 * np.pi, 9.81

Array = NDArray[np.float64]


def along(angle: float) -> Array:
    """Return the direction of a link."""
    return np.array([np.cos(angle), np.sin(angle)])


def across(angle: float) -> Array:
    """Return the derivative of that direction by the angle."""
    return np.array([-np.sin(angle), np.cos(angle)])


def closed(crank: float) -> tuple[float, float]:
    """Return the angles of coupler and rocker without play."""
    reach = np.array([BASE, 0.0]) - CRANK * along(crank)
    distance = np.hypot(*reach)
    bend = np.arccos((COUPLER**2 + distance**2 - ROCKER**2) / (2 * COUPLER * distance))
    coupler = np.arctan2(reach[1], reach[0]) + bend
    end = CRANK * along(crank) + COUPLER * along(coupler) - [BASE, 0.0]
    return float(coupler), float(np.arctan2(end[1], end[0]))


@dataclass(frozen=True)
class Instant:
    """The mechanism at a time: y holds the angles of coupler and rocker, and their rates."""

    t: float
    y: Array

    def offset(self) -> tuple[Array, Array]:
        """Return where the coupler's end lies in the rocker's bore, and its velocity there."""
        crank, (a, b, wa, wb) = START + SPEED * self.t, self.y
        place = CRANK * along(crank) + COUPLER * along(a) - [BASE, 0.0] - ROCKER * along(b)
        return place, CRANK * SPEED * across(crank) + COUPLER * wa * across(a) - ROCKER * wb * across(b)

    def row(self) -> Array:
        """Return the derivative of the distance from the bore's centre by the two angles."""
        place, _ = self.offset()
        return np.array([COUPLER * across(self.y[0]), -ROCKER * across(self.y[1])]) @ place / np.hypot(*place)

    def free(self) -> Array:
        """Return the angular accelerations without a force in the bore."""
        a, b, _, _ = self.y
        carried = -CRANK * SPEED**2 * along(START + SPEED * self.t) + [0.0, GRAVITY]
        turning = [
            -0.5 * MASS["coupler"] * COUPLER * across(a) @ carried,
            -0.5 * MASS["rocker"] * ROCKER * GRAVITY * np.cos(b),
        ]
        return np.array(turning) / ABOUT

    def force(self) -> float:
        """Return the force that keeps the pin on its bore; a negative one would have to pull."""
        place, velocity = self.offset()
        distance, (a, b, wa, wb) = np.hypot(*place), self.y
        carried = -CRANK * SPEED**2 * along(START + SPEED * self.t)
        carried = carried - COUPLER * wa**2 * along(a) + ROCKER * wb**2 * along(b)
        radial = place @ velocity / distance
        needed = (carried @ place + velocity @ velocity - radial**2) / distance + self.row() @ self.free()
        return float(needed / (self.row() ** 2 / ABOUT).sum())

    def energy(self) -> float:
        """Return the kinetic and potential energy of coupler and rocker."""
        crank, (a, b, wa, wb) = START + SPEED * self.t, self.y
        middle = CRANK * along(crank) + 0.5 * COUPLER * along(a)
        v = CRANK * SPEED * across(crank) + 0.5 * COUPLER * wa * across(a)
        height = MASS["coupler"] * middle[1] + 0.5 * MASS["rocker"] * ROCKER * np.sin(b)
        kinetic = MASS["coupler"] * v @ v + INERTIA["coupler"] * wa**2 + ABOUT[1] * wb**2
        return float(0.5 * kinetic + GRAVITY * height)


ABOUT = np.array(
    [INERTIA["coupler"] + 0.25 * MASS["coupler"] * COUPLER**2, INERTIA["rocker"] + 0.25 * MASS["rocker"] * ROCKER**2]
)


def rates(t: float, y: Array, touches: bool) -> Array:
    """Return the rates of angles and their rates, with the pin in contact or in flight."""
    now = Instant(t, y)
    push = now.force() * now.row() / ABOUT if touches else 0.0
    return np.concatenate([y[2:], now.free() - push])


def run(y: Array, until: float) -> tuple[list[Instant], list[tuple[float, str]]]:
    """Return instants of the motion, 1 ms apart, and the times at which the pin strikes its bore or leaves it."""

    def wall(t: float, y: Array, _: bool) -> float:
        return float(np.hypot(*Instant(t, y).offset()[0]) - PLAY)

    def pulls(t: float, y: Array, _: bool) -> float:
        return Instant(t, y).force()

    wall.terminal = pulls.terminal = True  # type: ignore[attr-defined]
    wall.direction, pulls.direction = 1, -1  # type: ignore[attr-defined]
    t, touches = 0.0, False
    instants, events = [], []
    wanted = np.linspace(0.0, until, round(until / 1e-3) + 1)
    while t < until:
        part = solve_ivp(
            rates, (t, until), y, "DOP853", events=pulls if touches else wall, args=(touches,), rtol=1e-11, atol=1e-12,
            dense_output=True, max_step=1e-3,
        )  # fmt: skip
        within = wanted[(wanted >= t) & (wanted < part.t[-1] + (part.t[-1] == until))]
        instants += [Instant(float(s), part.sol(s)) for s in within]
        t, y = float(part.t[-1]), part.y[:, -1].copy()
        if t < until:
            events.append((t, "leaves" if touches else "strikes"))
            if not touches:
                now = Instant(t, y)
                row = now.row()
                place, velocity = now.offset()
                y[2:] -= (velocity @ place / PLAY) / (row**2 / ABOUT).sum() * row / ABOUT
            touches = not touches
    return instants, events
