"""Two bodies with one joint between them, placed anywhere, its features given where they meet in the world."""

import copy
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.engine.small import small

WORD = {
    "revolute": ("bearing", "journal"),
    "cylindrical": ("bearing", "journal"),
    "prismatic": ("guide", "slider"),
    "spherical": ("socket", "ball"),
    "fixed": ("a", "b"),
    "planar": ("a", "b"),
}
PLAY: dict[str, dict[str, Any]] = {
    "revolute": {
        "rings": [-0.3, 0.4],
        "radial_clearance": 0.02,
        "flanges": {"radius": 0.5},
        "axial_clearance": 0.03,
        "friction": 0.1,
    },
    "cylindrical": {"rings": [-0.3, 0.4], "radial_clearance": 0.02, "friction": 0.1},
    "prismatic": {
        "block": {"half_length": 0.5, "half_height": 0.2, "half_width": 0.3},
        "clearance": 0.01,
        "width_clearance": 0.02,
        "friction": 0.1,
    },
    "spherical": {"radial_clearance": 0.02, "friction": 0.1},
}


def body(rng: np.random.Generator) -> dict[str, Any]:
    """Describe a body of random mass, inertia and pose."""
    root = 0.2 * rng.normal(size=(3, 3))
    return {
        "mass": float(rng.uniform(0.5, 3)),
        "inertia": (np.eye(3) * 2 + 0.1 * (root + root.T)).tolist(),
        "center_of_mass": rng.normal(size=3).tolist(),
        "origin": rng.normal(size=3).tolist(),
        "axis": rng.normal(size=3).tolist(),
        "angle": float(rng.uniform(-3, 3)),
    }


def seen_from(body: dict[str, Any], point: Any, *directions: Any) -> list[list[float]]:
    """Return a world point and world directions in the frame of a body."""
    axis = np.asarray(body.get("axis", [0, 0, 1]), float)
    turn = Rotation.from_rotvec(body.get("angle", 0.0) * axis / np.linalg.norm(axis)).inv()
    own = turn.apply(np.asarray(point) - body.get("origin", [0, 0, 0]))
    return [own.tolist(), *(turn.apply(d).tolist() for d in directions)]


def joined(kind: str, rng: np.random.Generator, *, ground: bool = False, loose: bool = False) -> dict[str, Any]:
    """Describe bodies ``one`` and ``two`` with a joint ``J`` of a kind, closed and centred at the start.

    Its keys for the form with play are in it either way; ``ground`` makes the first body a fixed one.
    """
    bodies = {"one": body(rng), "two": body(rng)}
    if ground:
        bodies["one"] = {"fixed": True, **{key: bodies["one"][key] for key in ("origin", "axis", "angle")}}
    return small(
        bodies=bodies,
        joints={"J": joint(kind, bodies, ("one", "two"), rng.normal(size=3), rng, loose)},
        simulation={"penetration": 1e-9},
    )


def joint(
    kind: str, bodies: dict[str, Any], between: tuple[str, str], point: Any, rng: np.random.Generator, loose: bool
) -> dict[str, Any]:
    """Describe a joint between two bodies, closed and centred at a world point, its axes at random."""
    axis = rng.normal(size=3)
    normal = np.cross(axis, rng.normal(size=3))
    found = {"type": f"clearance_{kind}" if loose else kind, **copy.deepcopy(PLAY.get(kind, {}))}
    for side, name in zip(WORD[kind], between, strict=True):
        at, along, up = seen_from(bodies[name], point, axis, normal)
        keys: dict[str, Any] = {"point": at}
        if kind in ("revolute", "cylindrical", "prismatic"):
            keys["axis"] = along
        if kind == "prismatic":
            keys["normal"] = up
        if kind == "planar":
            keys["normal"] = along
        if side in ("journal", "ball"):
            keys["radius"] = 0.25
        found[side] = {"body": name, **keys}
    return found
