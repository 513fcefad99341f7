"""Random mechanisms: chains of bodies with ideal joints and joints with play, and the same chains seen otherwise."""

import itertools
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from engine.mechanism import Mechanism
from engine.mechanism.base import TableModel, declared
from engine.mechanism.quantities import Quantity
from tests.engine.assembly.pairs_of_bodies import body, joint, seen_from
from tests.engine.small import GRAVITY, coordinates, made, small

IDEAL = ("revolute", "cylindrical", "prismatic", "spherical", "fixed", "planar")
LOOSE = ("revolute", "cylindrical", "prismatic", "spherical")

POLAR = {"point", "centre", "origin", "center_of_mass", "velocity", "axis", "normal", "vector", "gravity"}
KILO = {  # powers of 1000 between SI and mm-g-ms
    "length": 1, "per length": -1, "mass": 1, "time": 1, "frequency": -1, "rate": -1, "inertia": 3,
    "angular speed": -1, "acceleration": -1, "impulse": 1, "energy": 1, "torque": 1, "stiffness": -1,
    "torsional stiffness": 1, "torsional damping": 2,
}  # fmt: skip


def linkage(seed: int, bodies: int = 3, *, loose: bool = True, ground: bool = True) -> dict[str, Any]:
    """Describe a chain of bodies with random masses, poses and joints, in SI.

    Parameters
    ----------
    loose : one of its joints has play, and friction
    ground : it hangs from the ground, with gravity, above a floor that the last body soon meets; else it flies
    """
    rng = np.random.default_rng(seed)
    moving = {f"body_{i}": body(rng) for i in range(bodies)}
    everything = {"ground": {"fixed": True}, **moving}
    names = list(everything) if ground else list(moving)
    pairs = list(itertools.pairwise(names))
    played = int(rng.integers(len(pairs))) if loose else -1
    kinds = [str(rng.choice(LOOSE if i == played else IDEAL)) for i in range(len(pairs))]
    joints = {
        f"J{i}": joint(kind, everything, pair, rng.normal(size=3), rng, i == played)
        for i, (kind, pair) in enumerate(zip(kinds, pairs, strict=True))
    }
    data = small(
        simulation={"step": 1e-3, "horizon": 0.2, "tolerance": 1e-11, "penetration": 1e-9, "joint_violation": 1e-11},
        bodies=everything,
        joints=joints,
        responses=coordinates(names[-1]),
    )
    if ground:
        point = rng.normal(size=3)
        data["gravity"] = [0, 0, -GRAVITY]
        data["contacts"] = {
            "floor": {
                "a": {"body": names[-1], "point": seen_from(everything[names[-1]], point)[0]},
                "b": {"body": "ground", "plane": {"point": (point - [0, 0, 0.01]).tolist(), "normal": [0, 0, 1]}},
                "friction": 0.3,
            }
        }
    return data


def fly(data: dict[str, Any], velocity: Any, spin: Any) -> dict[str, Any]:
    """Let all bodies move as one at the start: ``velocity`` of what is at the world's origin, ``spin`` in the world."""
    for found in data["bodies"].values():
        if not found.get("fixed"):
            (turn,) = seen_from(found, np.zeros(3), spin)[1:]
            centre = np.asarray(found["origin"]) + attitude(found).apply(found["center_of_mass"])
            found["velocity"] = (np.asarray(velocity) + np.cross(spin, centre)).tolist()
            found["angular_velocity"] = turn
    return data


def attitude(found: dict[str, Any]) -> Rotation:
    """Return the rotation of a body's frame at the start."""
    axis = np.asarray(found.get("axis", [0, 0, 1]), float)
    return Rotation.from_rotvec(found.get("angle", 0.0) * axis / np.linalg.norm(axis))


def mirrored(data: dict[str, Any]) -> dict[str, Any]:
    """Describe the mirror image in the plane x = 0 of the world, every body's own frame mirrored with it.

    Points and directions change their x, what turns (spins, axes of rotation) its y and z. Flanges must not be in it:
    their points are found from the body's own x, y, z, which have a handedness.
    """
    flip = np.diag([-1.0, 1.0, 1.0])

    def of(table: Any, turning: tuple[str, ...]) -> Any:
        if not isinstance(table, dict):
            return table
        new = {key: of(item, turning) for key, item in table.items()}
        for key in POLAR & table.keys() - {*turning}:
            if isinstance(table[key], list):
                new[key] = (flip @ table[key]).tolist()
        for key in {*turning} & table.keys():
            new[key] = (-flip @ table[key]).tolist()
        if "inertia" in table:
            tensor = np.array(table["inertia"], float)
            new["inertia"] = (flip @ (np.diag(tensor) if tensor.ndim == 1 else tensor) @ flip).tolist()
        return new

    new = of({key: item for key, item in data.items() if key not in ("bodies", "springs")}, ())
    bodies = {name: {"axis": [0, 0, 1], **found} for name, found in data["bodies"].items()}
    new["bodies"] = of(bodies, ("axis", "angular_velocity"))
    return new | ({"springs": of(data["springs"], ("axis",))} if "springs" in data else {})


def in_millimetres(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism given in SI in mm, g and ms: every number by the quantity it was declared with."""
    return made({**_scaled(mechanism), "units": "mm-g-ms"})


def _scaled(model: TableModel) -> dict[str, Any]:
    """Return a table with its numbers in mm-g-ms; keys that were not given are left out."""
    table = {}
    for name in model.model_fields_set:
        field = type(model).model_fields[name]
        quantity = declared(field, Quantity)
        power = KILO.get(quantity.name, 0) if quantity else 0
        table[field.alias or name] = _times(getattr(model, name), 1000.0**power)
    return table


def _times(value: Any, factor: float) -> Any:
    """Return what stands at a key, with its numbers multiplied and the tables in it scaled."""
    if isinstance(value, TableModel):
        return _scaled(value)
    if isinstance(value, dict):
        return {key: _times(item, factor) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_times(item, factor) for item in value]
    return value * factor if isinstance(value, float) and factor != 1.0 else value
