"""Mechanism files in which a point of a free body meets faces of a CAD part."""

import hashlib
from typing import Any

from tests.engine.cad.step_files import Drawing


def written(drawing: Any, folder: Any, **how: Any) -> Any:
    """Write a drawing and return its path."""
    return drawing.write(folder / "part.step", **how)


def one_part(shape: Any, where: Any = None) -> Any:
    """Return a drawing with one part, ``block``, at a place."""
    made = Drawing()
    whole = made.assembly("whole")
    made.add(whole, made.product("block", shape), where)
    return made


def surface_file(path: Any, surface: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return a file with a point over the faces of the fixed part ``block``."""
    return {
        "format": 1,
        "name": "faces",
        "units": "mm-g-ms",
        "cad": {"file": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
        "simulation": {"step": 0.1, "horizon": 20.0, "penetration": 1e-8, "rest": {"window": 2.0, "drift": 1e-6}},
        "bodies": {
            "block": {"part": "block", "fixed": True},
            "probe": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "origin": [0.0, 0.0, 50.0]},
        },
        "contacts": {
            "touch": {
                "a": {"body": "probe", "point": [0.0, 0.0, 0.0]},
                "b": {"body": "block", "surface": surface},
                "friction": 0.0,
            }
        },
        "responses": {"load": {"type": "contact_force", "contact": "touch"}},
        **more,
    }
