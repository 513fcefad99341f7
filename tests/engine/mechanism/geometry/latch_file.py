"""The mechanism file of the docs' latch, as plain data, to be changed one key at a time."""

import hashlib
from pathlib import Path
from typing import Any

LATCH = Path(__file__).parents[4] / "docs/examples/latch.step"


def latch_file(path: Path = LATCH) -> dict[str, Any]:
    """Return a file with all four joints of the latch, and its stop."""

    def joint(bearing, hole, near, journal, pin, at):
        return {
            "type": "clearance_revolute",
            "bearing": {"body": bearing, "hole": {"radius": hole, "near": near}},
            "journal": {"body": journal, "pin": {"radius": pin, "near": at}},
            "radial_clearance": "as drawn",
            "friction": 0.1,
        }

    return {
        "format": 1,
        "name": "latch",
        "units": "mm-g-ms",
        "cad": {"file": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
        "simulation": {"step": 0.1, "horizon": 20.0, "penetration": 1e-6, "rest": {"window": 2.0, "drift": 1e-5}},
        "bodies": {
            "base": {"part": "base", "fixed": True},
            "crank": {"part": "crank"},
            "rocker": {"part": "rocker"},
            "coupler": {"part": "coupler"},
        },
        "joints": {
            "foot": joint("crank", 3.05, [0.0, 0.0, 2.5], "base", 3.0, [0.0, 0.0, 2.5]),
            "heel": joint("rocker", 3.06, [0.0, 0.0, 2.5], "base", 3.0, [50.0, 0.0, 2.5]),
            "knee": joint("coupler", 2.54, [0.0, 0.0, 2.5], "crank", 2.5, [24.0, 0.0, 7.5]),
            "toe": joint("coupler", 2.55, [44.407, 0.0, 2.5], "rocker", 2.5, [30.594, 0.0, 7.5]),
        },
        "contacts": {
            "stop": {
                "a": {"body": "crank", "point": [14.0, -7.0, 2.5]},
                "b": {"body": "base", "plane": {"near": [7.8, 14.0, 2.5]}},
                "friction": 0.1,
            }
        },
    }
