"""Mechanisms of which something is wrong, or nothing."""

import re
import tomllib
from pathlib import Path
from typing import Any

from engine.preflight import cautions
from tests.engine.small import GRAVITY, coordinates, made, small

PAGE = Path(__file__).parents[3] / "docs" / "mechanism.md"
GROUND = {"fixed": True}
LINE = {"point": [0, 0, 0], "axis": [0, 0, 1]}
GUIDE = {"point": [0, 0, 0], "axis": [1, 0, 0]}
SPRING = {
    "type": "linear",
    "a": {"body": "ground", "point": [-1, 0, 0]},
    "b": {"body": "ball", "point": [0, 0, 0]},
    "stiffness": 200.0,
    "free_length": 1.0,
}


def lever() -> dict[str, Any]:
    """Return the lever of the page on mechanism files, which is sound."""
    found = re.search(r"```toml\n(format = 1.*?)```", PAGE.read_text("utf-8"), re.S)
    assert found
    return tomllib.loads(found[1])


def pin(gravity: Any = (0, -GRAVITY, 0), measured: str = "z", friction: float = 0.1, **tables: Any) -> dict[str, Any]:
    """Describe a pin with axial play between the flanges of a bearing along z, with gravity across it."""
    joint = {
        "type": "clearance_revolute",
        "bearing": {"body": "ground", **LINE},
        "journal": {"body": "pin", **LINE, "radius": 5e-3},
        "rings": [-0.01, 0.01],
        "radial_clearance": 1e-4,
        "axial_clearance": 2e-4,
        "flanges": {"radius": 8e-3},
        "friction": friction,
    }
    body = {"mass": 0.1, "inertia": [1e-5, 1e-5, 1e-6], "center_of_mass": [0, -0.05, 0]}
    return small(
        gravity=list(gravity),
        bodies={"ground": GROUND, "pin": body},
        joints={"J": joint},
        responses={measured: coordinates("pin")[measured]},
        **tables,
    )


def guided(body: Any = None, **tables: Any) -> dict[str, Any]:
    """Describe a ball that an ideal guide leaves one way to go, x."""
    ball = {"mass": 2.0, "inertia": [1e-3, 1e-3, 1e-3], **(body or {})}
    slide = {"type": "prismatic", "guide": {"body": "ground", **GUIDE}, "slider": {"body": "ball", **GUIDE}}
    responses = {"x": coordinates("ball")["x"]}
    return small(bodies={"ground": GROUND, "ball": ball}, joints={"J": slide}, responses=responses, **tables)


def warned(data: dict[str, Any]) -> list[str]:
    """Return what looks wrong in a mechanism, one text each."""
    return [str(caution) for caution in cautions(made(data))]
