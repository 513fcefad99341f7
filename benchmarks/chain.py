"""Chains of any length: a mechanism for which the time of a step should be proportional to the number of links."""

from math import cos, sin
from typing import Any

LENGTH, MASS, PIN, HALF_WIDTH = 0.1, 0.05, 0.005, 0.01  # of a link: m, kg; radius of a pin, station of a ring
ACROSS = [0.0, 1.0, 0.0]


def chain(links: int, clearance: float = 1e-4, friction: float = 0.1, angle: float = 0.5) -> dict[str, Any]:
    """Describe a straight chain on joints with play, released at rest.

    Each of the `links` bars hangs on a pin of the one above, the first on the ground. A radial `clearance` [m] of 0
    makes the joints ideal; `friction` is the coefficient in every joint, `angle` [rad] that of the whole chain from the
    vertical.
    """
    joint = (
        {"type": "clearance_revolute", "rings": [-HALF_WIDTH, HALF_WIDTH], "radial_clearance": clearance}
        if clearance > 0
        else {"type": "revolute"}
    )
    return {
        "format": 1,
        "name": "chain",
        "title": f"Chain of {links} links",
        "description": f"{links} links of 0.1 m on pins with play, hanging, released off the vertical.",
        "units": "SI",
        "gravity": [0.0, 0.0, -9.81],
        "simulation": {
            "step": 5e-4,
            "horizon": 0.5,
            "penetration": 1e-11,
            "rest": {"window": 0.1, "drift": 1e-9},
        },
        "phases": [{"name": "swing", "duration": 0.5}],
        "materials": {"pin_eye": {"friction": friction}},
        "bodies": {"ground": {"fixed": True}} | {f"L{k}": _link(k, angle) for k in range(1, links + 1)},
        "joints": {f"J{k}": joint | _pin(k) | {"material": "pin_eye"} for k in range(1, links + 1)},
        "responses": {axis: _tip(links, vector) for axis, vector in (("x", [1.0, 0.0, 0.0]), ("z", [0.0, 0.0, 1.0]))},
    }


def _link(k: int, angle: float) -> dict[str, Any]:
    """Describe the k-th link; its frame is in its upper eye, and the link extends along -z."""
    across = MASS * LENGTH**2 / 12
    return {
        "mass": MASS,
        "inertia": [across, across, MASS * PIN**2],
        "center_of_mass": [0.0, 0.0, -LENGTH / 2],
        "origin": [(k - 1) * LENGTH * sin(angle), 0.0, -(k - 1) * LENGTH * cos(angle)],
        "axis": [0.0, -1.0, 0.0],
        "angle": angle,
    }


def _pin(k: int) -> dict[str, Any]:
    """Describe the sides of the k-th joint: the eye of link k, and a pin of the link above or of the ground."""
    above, point = ("ground", [0.0, 0.0, 0.0]) if k == 1 else (f"L{k - 1}", [0.0, 0.0, -LENGTH])
    return {
        "bearing": {"body": f"L{k}", "point": [0.0, 0.0, 0.0], "axis": ACROSS},
        "journal": {"body": above, "point": point, "axis": ACROSS, "radius": PIN},
    }


def _tip(links: int, vector: list[float]) -> dict[str, Any]:
    """Describe a coordinate of the chain's end as a response."""
    return {
        "type": "position",
        "from": {"body": "ground", "point": [0.0, 0.0, 0.0]},
        "to": {"body": f"L{links}", "point": [0.0, 0.0, -LENGTH]},
        "direction": {"vector": vector},
    }
