"""Bodies that are parts of a CAD file: pose, mass, centre and inertia from the solids, unless the file gives them.

A body is one part, or several that are rigidly joined; its frame is that of the first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.arrays import Array
from engine.cad import CadPart
from engine.errors import some
from engine.mechanism.base import is_number
from engine.mechanism.faults import did_you_mean
from engine.mechanism.geometry.drawn_features import direction, lengths, significant
from engine.mechanism.materials import density_of, unknown_material

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


@dataclass(frozen=True)
class DensityRules:
    """How densities are found: the units of the mechanism, and what holds where neither file has one of a solid."""

    mass_unit: float  # the mechanism's unit of mass [g]
    millimetre: float  # the length of one in the mechanism's unit
    default: float | str | None = None  # a density, or the name of a material

    def named(self, density: float | str) -> float | None:
        """Return a density in the mechanism's unit; None if it is the name of no known material."""
        if not isinstance(density, str):
            return float(density)
        known = density_of(density)
        return None if known is None else known / (self.millimetre**3 * self.mass_unit)


def mass_properties(parts: Sequence[CadPart], body: Mapping[str, Any], rules: DensityRules) -> MassProperties:
    """Return the mass properties of parts that are one body.

    The ``density`` of the body's table, as a number or the name of a material, overrides that of the CAD file: one for
    all solids, one per solid, or one per part. Without any density, its ``mass`` is divided among the solids in
    proportion to their volumes. Raise NoDensity if neither file gives the mass.
    """
    solids = [(part, solid) for part in parts for solid in part.solids]
    volumes = np.array([solid.volume for _, solid in solids])
    if not len(volumes):
        remedy = "give mass, center_of_mass and inertia, or export it as a solid"
        text = f"the part {parts[0].name} holds no solid, only surfaces; allowed: a part with solids; {remedy}"
        raise NoDensity(text)
    densities, source = _densities(parts, body, rules)
    masses = densities * volumes
    centres = np.array([solid.centre for _, solid in solids])
    centre = masses @ centres / masses.sum()
    inertia = np.zeros((3, 3))
    for density, own, (_, solid) in zip(densities, masses, solids, strict=True):
        r = solid.centre - centre
        inertia += density * solid.inertia + own * (r @ r * np.eye(3) - np.outer(r, r))
    return MassProperties(float(volumes.sum()), float(masses.sum()), centre, inertia, source)


def _densities(parts: Sequence[CadPart], body: Mapping[str, Any], rules: DensityRules) -> tuple[Array, str]:
    """Return the density of each solid, and their origin."""
    given = _given(parts, body.get("density"))
    materials = [solid.material or part.material for part in parts for solid in part.solids]
    found: list[float | None] = []
    sources: dict[str, list[str]] = {}
    for own, material in zip(given, materials, strict=True):
        if own is not None:
            if (density := rules.named(own)) is None:
                raise NoDensity(unknown_material(str(own)))
            sources.setdefault("this file", []).extend([own] if isinstance(own, str) else [])
        elif material and material.density:
            density = material.density / rules.mass_unit
            sources.setdefault("the CAD file", []).append(material.name)
        elif rules.default is not None:
            density = rules.named(rules.default)
            sources.setdefault("[cad]", []).extend([rules.default] if isinstance(rules.default, str) else [])
        else:
            density = None
        found.append(density)
    known = [density for density in found if density is not None]
    if len(known) == len(found):
        named = {source: ", ".join(dict.fromkeys(names)) for source, names in sources.items()}
        return np.array(known), " and ".join(f"{each} ({names})" if names else each for each, names in named.items())
    volumes = [solid.volume for part in parts for solid in part.solids]
    if is_number(body.get("mass")) and not known:
        return np.full(len(found), body["mass"] / sum(volumes)), "the mass in this file"
    without = [part.name for part in parts if any(not (solid.material or part.material) for solid in part.solids)]
    several = f"; its solids, in order: {_solids(parts)}" if len(found) > 1 else ""
    each = ", or one for each solid" if len(found) > 1 else ""
    raise NoDensity(
        f"missing; the CAD file has no density of {some(without or [part.name for part in parts])}{several}; allowed:"
        f" density, a number > 0 or the name of a material{each}, or mass; add one of them, or density to [cad], for"
        " all that have none"
    )


def _given(parts: Sequence[CadPart], given: Any) -> list[float | str | None]:
    """Return the densities that a body's table gives to its solids; None where it gives none."""
    count = sum(len(part.solids) for part in parts)
    if given is None:
        return [None] * count
    if isinstance(given, Mapping):
        names = [part.name for part in parts]
        if strange := [name for name in given if name not in names]:
            known = f"{some(names)}{did_you_mean(strange[0], names)}"
            raise NoDensity(f"{strange[0]!r} is no part of this body; allowed: {known}; correct it")
        given = [given.get(part.name) for part in parts for _ in part.solids]
        sound = all(each is None or _is_density(each) for each in given)
    else:
        given = [given] * count if _is_density(given) else given
        sound = isinstance(given, Sequence) and len(given) == count and all(map(_is_density, given))
    if not sound:
        listed = f", or a list of {count}, one for each of its solids ({_solids(parts)})" if count > 1 else ""
        whose = some([part.name for part in parts])
        raise NoDensity(f"no density of {whose}; allowed: a number > 0, or the name of a material{listed}; correct it")
    return list(given)


def _is_density(value: Any) -> bool:
    return isinstance(value, str) or (is_number(value) and value > 0)


def _solids(parts: Sequence[CadPart]) -> str:
    """Return a phrase for the solids of parts."""
    return some(
        [
            f"{solid.name or f'solid {i}' if len(parts) == 1 else part.name} of volume {solid.volume:.6g}"
            for part in parts
            for i, solid in enumerate(part.solids)
        ]
    )


def body_of_part(
    part: CadPart, body: Mapping[str, Any], masses: MassProperties | None, millimetre: float
) -> dict[str, Any]:
    """Return the table of a body, without what is only for CAD, completed with the numbers of its part."""
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
