"""Springs and dampers too stiff for the time step, which then shake their bodies instead of holding them."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.mechanism import Mechanism
from engine.mechanism.loads import Damper, Spring
from engine.preflight.caution import Caution

LONGEST = 1.0  # rad or 1: largest product of angular frequency and step, or of damping and step divided by mass


def pace_of(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about springs and dampers whose characteristic time is shorter than the time step."""
    step, unit = mechanism.simulation.step, mechanism.unit("time")
    for name, spring in mechanism.springs.items():
        if spring.actions:  # its actions have lever arms of their own
            continue
        inert = _inert(mechanism, spring)
        rate = math.sqrt(spring.stiffness / inert)
        if rate * step > LONGEST:
            key, stiffness = f"springs.{name}.stiffness", "stiffness"
            quantity = stiffness if spring.type == "linear" else f"torsional {stiffness}"
            # a tenth of the limit above: an oscillation then takes some sixty steps
            most = inert * (0.1 / step) ** 2
            yield _fast(key, spring.stiffness, mechanism.unit(quantity), f"{2 * math.pi / rate:.3g} {unit}", step, most)
    links: list[tuple[str, dict[str, Any]]] = [("springs", mechanism.springs), ("dampers", mechanism.dampers)]
    for table, entries in links:
        for name, damper in entries.items():
            if not damper.damping or getattr(damper, "actions", None):
                continue
            inert = _inert(mechanism, damper)
            if damper.damping * step > LONGEST * inert:
                quantity = "damping" if damper.type == "linear" else "torsional damping"
                own = f"{inert / damper.damping:.3g} {unit}"
                key, value = f"{table}.{name}.damping", damper.damping
                yield _fast(key, value, mechanism.unit(quantity), own, step, 0.1 * inert / step)


def _fast(key: str, value: float, unit: str, own: str, step: float, most: float) -> Caution:
    """Return the caution about a number that is too stiff for the step."""
    return Caution(
        key,
        value,
        unit,
        f"its bodies answer within {own}, too fast for simulation.step = {step:g}",
        f"at most {most:.2g} {unit} with this step",
        "check the unit, or shorten the step",
    )


def _inert(mechanism: Mechanism, link: Spring | Damper) -> float:
    """Return the inertia that a spring or damper works against: that of the lighter of its bodies."""
    names = [end if isinstance(end, str) else end.body for end in (link.a, link.b)]
    inert = _mass if link.type == "linear" else _inertia
    return min(inert(mechanism, name) for name in names if not mechanism.bodies[name].fixed)


def _mass(mechanism: Mechanism, name: str) -> float:
    """Return the mass of a body."""
    return mechanism.bodies[name].mass or 0.0


def _inertia(mechanism: Mechanism, name: str) -> float:
    """Return the largest inertia of a body about any of its joints."""
    body = mechanism.bodies[name]
    largest = float(np.linalg.eigvalsh(np.array(body.inertia, float))[-1])
    centre = np.array(body.center_of_mass)
    points = [side.point for joint in mechanism.joints.values() for side in joint.sides if side.body == name]
    arms = [float(np.linalg.norm(np.array(point) - centre)) for point in points]
    return largest + _mass(mechanism, name) * max(arms, default=0.0) ** 2
