"""Numbers that are off the customary range by a factor of a thousand, mostly because they are in another unit.

The ranges are those of real machines and instruments, from a watch to a dredger, extended by a factor of a thousand
beyond the usual at each end. The density is that of a body as compact as its moments of inertia indicate.
"""

from collections.abc import Iterator

import numpy as np

from engine.mechanism import Mechanism
from engine.preflight.caution import Caution

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


def customs_of(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about the numbers of a mechanism that are far off what is customary in its unit system."""
    yield from _gravity(mechanism)
    for name, joint in mechanism.joints.items():
        for key in CLEARANCES if not joint.ideal else ():
            value = getattr(joint, key, None)
            if value is not None:
                yield from _off(mechanism, f"joints.{name}.{key}", value, "length", CLEARANCE)
    for name, body in mechanism.bodies.items():
        if body.mass is not None and body.inertia is not None:
            yield from _mass(mechanism, name, body.mass, body.inertia)
    for name, spring in mechanism.springs.items():
        kind, custom = ("stiffness", STIFFNESS) if spring.type == "linear" else ("torsional stiffness", TORSION)
        yield from _off(mechanism, f"springs.{name}.stiffness", spring.stiffness, kind, custom)


def _factor(mechanism: Mechanism, quantity: str) -> float:
    """Return the value in SI units of 1 in the mechanism's unit of a quantity."""
    return 1.0 if mechanism.units == "SI" else IN_SI[quantity]


def _gravity(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield a caution if gravity is far off the earth's but not zero."""
    factor = _factor(mechanism, "acceleration")
    size = float(np.linalg.norm(mechanism.gravity))
    ratio = size * factor / STANDARD_GRAVITY
    if size and not 1.0 / GRAVITY_FACTOR <= ratio <= GRAVITY_FACTOR:
        unit, earth = mechanism.unit("acceleration"), STANDARD_GRAVITY / factor
        yield Caution(
            "gravity",
            size,
            unit,
            f"{ratio:.4g} times the earth's",
            f"{earth:.6g} {unit}",
            f'check the unit: with units = "{mechanism.units}" gravity is in {unit}',
        )


def _mass(mechanism: Mechanism, name: str, mass: float, inertia: object) -> Iterator[Caution]:
    """Yield a caution if a mass is out of range, by itself or for a body with this inertia."""
    key, off = f"bodies.{name}.mass", False
    for caution in _off(mechanism, key, mass, "mass", MASS):
        off = True
        yield caution
    if off:
        return
    factor = _factor(mechanism, "mass") / _factor(mechanism, "length") ** 3
    arm = float(np.sqrt(np.trace(np.array(inertia, float)) / (2.0 * mass)))
    with np.errstate(over="ignore"):
        density = float(np.float64(factor * mass / BALL) / np.float64(arm) ** 3)
    least, most, (low, high) = DENSITY
    if not least <= density <= most:
        yield Caution(
            key,
            mass,
            mechanism.unit("mass"),
            f"with this inertia the body is as compact as a ball of {density:.3g} kg/m3",
            f"{low:g} to {high:g} kg/m3, much less for wires and sheets",
            f"check the units: mass in {mechanism.unit('mass')}, inertia in {mechanism.unit('inertia')}",
        )


def _off(
    mechanism: Mechanism, key: str, value: float, quantity: str, custom: tuple[float, float, tuple[float, float]]
) -> Iterator[Caution]:
    """Yield a caution if a number is out of its range."""
    least, most, (low, high) = custom
    factor, unit = _factor(mechanism, quantity), mechanism.unit(quantity)
    if not least <= value * factor <= most:
        side = "small" if value * factor < least else "large"
        yield Caution(
            key,
            value,
            unit,
            f"unusually {side}",
            f"{low / factor:g} to {high / factor:g} {unit}",
            f'check the unit: with units = "{mechanism.units}" it is in {unit}',
        )
