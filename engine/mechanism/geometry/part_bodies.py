"""Bodies that are parts of a CAD file: pose, mass, centre and inertia from the solids, unless the file gives them.

A body is one part, or several that are rigidly joined; its frame is that of the first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import CadPart
from engine.mechanism.base import is_number
from engine.mechanism.faults import did_you_mean
from engine.mechanism.geometry.face_search import direction, lengths, significant

POSE = {"origin", "axis", "angle"}
"""The keys of a body's pose: the file gives either all of them or none, and then the pose is that of the part."""


class NoPart(Exception):
    """The parts of a body are not parts of the CAD file; the message says why, about a key and its value."""

    def __init__(self, key: str, text: str, value: object) -> None:
        super().__init__(text)
        self.key, self.value = key, value


def joined_name(parts: Sequence[str]) -> str:
    """Return the name of the part that several parts become in one body."""
    return " + ".join(parts)


def parts_of_body(body: Mapping[str, Any]) -> list[str]:
    """Return the names in the `part` or the `parts` of a body; empty if it has neither, or no texts."""
    given = [body["part"]] if "part" in body else body.get("parts")
    return list(given) if isinstance(given, list) and all(isinstance(name, str) for name in given) else []


def part_of_body(body: Mapping[str, Any], known: Sequence[str]) -> str:
    """Return the name of the part that a body is, or of that which its parts become; raise NoPart if there is none."""
    if "part" in body and "parts" in body:
        raise NoPart("parts", "not beside part; allowed: one of the two; remove one of them", body["parts"])
    key = "part" if "part" in body else "parts"
    names = parts_of_body(body)
    if not names:
        raise NoPart(key, f"no list of parts; allowed: one or more of {', '.join(known)}; correct it", body[key])
    for name in names:
        if name not in known:
            text = f"no such part; allowed: {', '.join(known)}{did_you_mean(name, known)}; correct it"
            raise NoPart(key, text, name)
        if names.count(name) > 1:
            raise NoPart(key, "named twice; allowed: each part once; remove one of them", name)
    return names[0] if len(names) == 1 else joined_name(names)


class NoDensity(Exception):
    """The mass of a part cannot be determined; the message says why."""


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties of a part, in the mechanism's units."""

    volume: float
    mass: float
    centre: Array  # (3,) in the assembly's frame
    inertia: Array  # (3, 3) about the centre, in the axes of the assembly
    source: str  # of the density


def mass_properties(part: CadPart, body: Mapping[str, Any], mass_unit: float) -> MassProperties:
    """Return the mass properties of a part; ``mass_unit`` is the mechanism's unit of mass [g].

    The ``density`` of the body's table, a number or one per solid, overrides that of the CAD file; without any density,
    its ``mass`` is divided among the solids in proportion to their volumes. Raise NoDensity if neither file gives the
    mass.
    """
    volumes = np.array([solid.volume for solid in part.solids])
    if not len(volumes):
        raise NoDensity(
            f"the part {part.name} holds no solid, only surfaces; allowed: a part with solids; give mass, "
            "center_of_mass and inertia, or export it as a solid"
        )
    densities, source = _densities(part, body, mass_unit)
    masses = densities * volumes
    centres = np.array([solid.centre for solid in part.solids])
    centre = masses @ centres / masses.sum()
    inertia = np.zeros((3, 3))
    for density, own, solid in zip(densities, masses, part.solids, strict=True):
        r = solid.centre - centre
        inertia += density * solid.inertia + own * (r @ r * np.eye(3) - np.outer(r, r))
    return MassProperties(float(volumes.sum()), float(masses.sum()), centre, inertia, source)


def _densities(part: CadPart, body: Mapping[str, Any], mass_unit: float) -> tuple[Array, str]:
    """Return the density of each solid, and its origin."""
    given, count = body.get("density"), len(part.solids)
    if given is not None:
        each = [given] * count if is_number(given) else given
        sound = isinstance(each, Sequence) and len(each) == count and all(is_number(rho) and rho > 0 for rho in each)
        if not sound:
            listed = f", or a list of {count}, one for each of its solids ({_solids(part)})" if count > 1 else ""
            raise NoDensity(f"no density of {part.name}; allowed: a number > 0{listed}; correct it")
        return np.array(each, float), "this file"
    materials = [solid.material or part.material for solid in part.solids]
    known = [material.density / mass_unit for material in materials if material and material.density]
    if len(known) == count:
        names = dict.fromkeys(material.name for material in materials if material)
        return np.array(known), f"the CAD file ({', '.join(names)})"
    if is_number(body.get("mass")) and not known:
        return np.full(count, body["mass"] / sum(solid.volume for solid in part.solids)), "the mass in this file"
    several = f"; its solids, in order: {_solids(part)}" if count > 1 else ""
    raise NoDensity(
        f"missing; the CAD file has no density of {part.name}{several}; allowed: density, a number > 0"
        f"{' or one for each solid' if count > 1 else ''}, or mass; add one of them"
    )


def _solids(part: CadPart) -> str:
    """Return a phrase for the number of solids of a part."""
    names = [solid.name or f"solid {i}" for i, solid in enumerate(part.solids)]
    volumes = [f"of volume {solid.volume:.6g}" for solid in part.solids]
    return ", ".join(" ".join(each) for each in zip(names, volumes, strict=True))


def body_of_part(
    part: CadPart, body: Mapping[str, Any], masses: MassProperties | None, millimetre: float
) -> dict[str, Any]:
    """Return the table of a body completed with the numbers of its part; existing entries are kept.

    ``part``, ``parts`` and ``density`` are removed. ``masses`` is None for a fixed body, and ``millimetre`` the length
    of one in the mechanism's unit.
    """
    from scipy.spatial.transform import Rotation

    placement = part.placement
    turn = Rotation.from_matrix(placement.rotation).as_rotvec()
    angle = float(np.linalg.norm(turn))
    numbers: dict[str, Any] = {"origin": lengths(placement.translation, millimetre)}
    if angle > 0:
        numbers |= {"axis": direction(turn / angle), "angle": angle}
    if masses is not None:
        R: Array = placement.rotation
        own_mass = body.get("mass")
        share = float(own_mass) / masses.mass if is_number(own_mass) and own_mass is not None else 1.0
        inertia = R.T @ masses.inertia @ R * share
        numbers |= {
            "mass": float(significant(np.array(masses.mass))),
            "center_of_mass": lengths(R.T @ (masses.centre - placement.translation), millimetre),
            "inertia": significant((inertia + inertia.T) / 2).tolist(),
        }
    written = {key: value for key, value in body.items() if key not in ("part", "parts", "density")}
    if written.keys() & POSE:
        numbers = {key: value for key, value in numbers.items() if key not in POSE}
    return numbers | written
