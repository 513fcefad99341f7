"""Cautions about what is written: numbers off their plausible range, duplicates, springs too stiff for the step.

A caution is something that looks wrong in a mechanism although it could run.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from engine.mechanism import Mechanism
from engine.mechanism.keys.values import settable_numbers
from engine.mechanism.loads import Damper, Spring
from engine.run import LARGEST_TURN

STANDARD_GRAVITY = 9.80665  # m/s2
GRAVITY_FACTOR = 100.0  # allows for centrifuges and the moon; a wrong unit is off by a factor of a thousand

# quantity: smallest, largest, and the usual range, in SI units
CLEARANCE = (1e-7, 1e-2, (2e-6, 2e-3))
MASS = (1e-9, 1e9, (1e-6, 1e5))
STIFFNESS = (1e-2, 1e9, (10.0, 1e6))
TORSION = (1e-9, 1e8, (1e-6, 1e5))
DENSITY = (1e-2, 5e5, (100.0, 2e4))

CLEARANCES = ("radial_clearance", "clearance", "width_clearance", "axial_clearance")

# value in SI units of 1 in the units of "mm-g-ms"
IN_SI = {"length": 1e-3, "mass": 1e-3, "acceleration": 1e3, "stiffness": 1e3, "torsional stiffness": 1e-3}
BALL = 9.1  # m / (4/3 pi r^3) of a ball divided by m / k^3, where k is its radius of gyration

LONGEST = 1.0  # rad or 1: largest product of angular frequency and step, or of damping and step divided by mass


@dataclass(frozen=True)
class Caution:
    """Something that looks wrong in a mechanism, where it is, and what to do."""

    key: str  # dotted path in the mechanism file
    value: float | None = None  # the number at this key, if it is a single number
    unit: str = "1"  # of the value; "1" for a pure number
    text: str = ""  # what looks wrong
    customary: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        value = "" if self.value is None else f" = {self.value:g}{unit}"
        customary = f"; customary: {self.customary}" if self.customary else ""
        return f"{self.key}{value}: {self.text}{customary}; {self.remedy}"

    def to_json(self) -> dict[str, object]:
        """Return plain data."""
        return {**asdict(self), "message": str(self)}


# The ranges are those of real machines and instruments, from a watch to a dredger, extended by a factor of a thousand
# beyond the usual at each end. The density is that of a body as compact as its moments of inertia indicate.


def implausible_numbers(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about the numbers of a mechanism that are far off what is customary in its unit system."""
    yield from _gravity(mechanism)
    for name, joint in mechanism.joints.items():
        for key in CLEARANCES if not joint.ideal else ():
            value = getattr(joint, key, None)
            pressed = key == "radial_clearance" and getattr(joint, "ring_stiffness", None) is not None
            if value is not None and not pressed:  # a fit may leave any play, or none
                yield from _out_of_range(mechanism, f"joints.{name}.{key}", value, "length", CLEARANCE)
    for name, body in mechanism.bodies.items():
        if body.mass is not None and body.inertia is not None:
            yield from _implausible_mass(mechanism, name, body.mass, body.inertia)
    for name, joint in mechanism.joints.items():
        for key, custom in (("stiffness", STIFFNESS), ("torsional_stiffness", TORSION)):
            for axis, value in zip("xyz", getattr(joint, key, None) or (), strict=False):
                if value:
                    where = f"joints.{name}.{key}.{axis}"
                    yield from _out_of_range(mechanism, where, value, key.replace("_", " "), custom)
    for name, spring in mechanism.springs.items():
        kind, custom = ("stiffness", STIFFNESS) if spring.type == "linear" else ("torsional stiffness", TORSION)
        if spring.stiffness is not None:
            yield from _out_of_range(mechanism, f"springs.{name}.stiffness", spring.stiffness, kind, custom)
    yield from _degrees(mechanism)


def _degrees(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about angles of more than a turn, as only motions have them: they may be in degrees."""
    for number in settable_numbers(mechanism):
        if number.unit == "rad" and math.tau < abs(number.value) <= 360.0 and not number.key.startswith("motions."):
            text = f"{number.value / math.tau:.3g} turns"
            remedy = f'if that is in degrees, write "radians({number.value:g})"'
            yield Caution(number.key, number.value, "rad", text, "up to one turn", remedy)


def _factor(mechanism: Mechanism, quantity: str) -> float:
    """Return the value in SI units of 1 in the mechanism's unit of a quantity."""
    return 1.0 if mechanism.units == "SI" else IN_SI[quantity]


def _gravity(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield a caution if gravity is far off the earth's but not zero."""
    factor = _factor(mechanism, "acceleration")
    size = float(np.linalg.norm(mechanism.gravity))
    ratio = size * factor / STANDARD_GRAVITY
    if size and not 1.0 / GRAVITY_FACTOR <= ratio <= GRAVITY_FACTOR:
        unit, text = mechanism.unit("acceleration"), f"{ratio:.4g} times the earth's"
        remedy = f'check the unit: with units = "{mechanism.units}" gravity is in {unit}'
        yield Caution("gravity", size, unit, text, f"{STANDARD_GRAVITY / factor:.6g} {unit}", remedy)


def _implausible_mass(mechanism: Mechanism, name: str, mass: float, inertia: object) -> Iterator[Caution]:
    """Yield a caution if a mass is out of range, by itself or for a body with this inertia."""
    key = f"bodies.{name}.mass"
    if off := [*_out_of_range(mechanism, key, mass, "mass", MASS)]:
        yield from off
        return
    factor = _factor(mechanism, "mass") / _factor(mechanism, "length") ** 3
    arm = float(np.sqrt(np.trace(np.array(inertia, float)) / (2.0 * mass)))
    with np.errstate(over="ignore"):
        density = float(np.float64(factor * mass / BALL) / np.float64(arm) ** 3)
    least, most, (low, high) = DENSITY
    if not least <= density <= most:
        text = f"with this inertia the body is as compact as a ball of {density:.3g} kg/m3"
        customary = f"{low:g} to {high:g} kg/m3, much less for wires and sheets"
        unit, of_inertia = mechanism.unit("mass"), mechanism.unit("inertia")
        yield Caution(key, mass, unit, text, customary, f"check the units: mass in {unit}, inertia in {of_inertia}")


def _out_of_range(
    mechanism: Mechanism, key: str, value: float, quantity: str, custom: tuple[float, float, tuple[float, float]]
) -> Iterator[Caution]:
    """Yield a caution if a number is out of its range."""
    least, most, (low, high) = custom
    factor, unit = _factor(mechanism, quantity), mechanism.unit(quantity)
    if not least <= value * factor <= most:
        side = "small" if value * factor < least else "large"
        customary = f"{low / factor:g} to {high / factor:g} {unit}"
        remedy = f'check the unit: with units = "{mechanism.units}" it is in {unit}'
        yield Caution(key, value, unit, f"unusually {side}", customary, remedy)


def duplicates(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield the joints and contacts whose entries are identical to another one in the same table."""
    for table, entries in (("joints", mechanism.joints), ("contacts", mechanism.contacts)):
        first: dict[str, str] = {}
        for name, entry in entries.items():
            other = first.setdefault(repr(entry), name)
            if other != name:
                text = f"the same as {table}.{other}: the forces are shared between the two"
                yield Caution(f"{table}.{name}", text=text, remedy="remove one of them")


def stiff_springs(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about springs and dampers whose characteristic time is shorter than the time step."""
    step, unit = mechanism.simulation.step, mechanism.unit("time")
    for name, spring in mechanism.springs.items():
        if spring.actions:  # its actions have lever arms of their own
            continue
        inert = _inert(mechanism, spring)
        steepest = _steepest(spring)
        rate = math.sqrt(steepest / inert)
        if rate * step > LONGEST:
            key, stiffness = f"springs.{name}.{'law' if spring.law else 'stiffness'}", "stiffness"
            quantity = stiffness if spring.type == "linear" else f"torsional {stiffness}"
            # a tenth of the limit above: an oscillation then takes some sixty steps
            most = inert * (0.1 / step) ** 2
            yield _too_stiff(key, steepest, mechanism.unit(quantity), f"{2 * math.pi / rate:.3g} {unit}", step, most)
    links: list[tuple[str, dict[str, Any]]] = [("springs", mechanism.springs), ("dampers", mechanism.dampers)]
    for table, entries in links:
        for name, damper in entries.items():
            law = damper.law if table == "dampers" else None
            value = _steepest(damper) if law else damper.damping
            if not value or getattr(damper, "actions", None):
                continue
            inert = _inert(mechanism, damper)
            if value * step > LONGEST * inert:
                quantity = "damping" if damper.type == "linear" else "torsional damping"
                own = f"{inert / value:.3g} {unit}"
                key = f"{table}.{name}.{'law' if law else 'damping'}"
                yield _too_stiff(key, value, mechanism.unit(quantity), own, step, 0.1 * inert / step)


def _steepest(link: Any) -> float:
    """Return the stiffness of a spring, or of its law the steepest slope; of a damper with a law the same."""
    if link.law is None:
        return float(link.stiffness)
    # cubics between the points are at most three times as steep as the straight lines, see `TableLaw`
    slopes = [abs((y - x) / (t - s)) for (s, x), (t, y) in pairwise(link.law.points)]
    return float(max(slopes)) * (3.0 if link.law.interpolation == "smooth" else 1.0)


def fast_spins(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield a caution about the step if it is too long for a body's spin at the start."""
    step, unit = mechanism.simulation.step, mechanism.unit("time")
    spins = {name: math.hypot(*body.angular_velocity) for name, body in mechanism.bodies.items() if not body.fixed}
    name = max(spins, key=spins.__getitem__, default="")
    if name and spins[name] * step > LARGEST_TURN:
        text = f"bodies.{name} turns by {spins[name] * step:.3g} rad in a step at its spin at the start: too far for "
        text += "the gyroscopic moment of the middle of the step"
        customary = f"up to {LARGEST_TURN / spins[name]:.3g} {unit}"
        yield Caution("simulation.step", step, unit, text, customary, "shorten the step")


def _too_stiff(key: str, value: float, unit: str, own: str, step: float, most: float) -> Caution:
    """Return the caution about a number that is too stiff for the step."""
    text, customary = f"its bodies answer within {own}, too fast for simulation.step = {step:g}", f"at most {most:.2g}"
    return Caution(key, value, unit, text, f"{customary} {unit} with this step", "check the unit, or shorten the step")


def _inert(mechanism: Mechanism, link: Spring | Damper) -> float:
    """Return the inertia that a spring or damper works against: that of the lighter of its bodies."""
    names = [end if isinstance(end, str) else end.body for end in (link.a, link.b)]
    bodies = {name: mechanism.bodies[name] for name in names if not mechanism.bodies[name].fixed}
    return min(body.mass or 0.0 if link.type == "linear" else _inertia(mechanism, n) for n, body in bodies.items())


def _inertia(mechanism: Mechanism, name: str) -> float:
    """Return the largest inertia of a body about any of its joints."""
    body = mechanism.bodies[name]
    largest = float(np.linalg.eigvalsh(np.array(body.inertia, float))[-1])
    centre = np.array(body.center_of_mass)
    points = [side.point for joint in mechanism.joints.values() for side in joint.sides if side.body == name]
    arms = [float(np.linalg.norm(np.array(point) - centre)) for point in points]
    return largest + (body.mass or 0.0) * max(arms, default=0.0) ** 2
