"""Plain data of a small mechanism that is right, to be made wrong one key at a time."""

from typing import Any


def pendulum() -> dict[str, Any]:
    """Describe a link on a pin with play, with one of every kind of table."""
    return {
        "format": 1,
        "name": "pendulum",
        "units": "mm-g-ms",
        "validity": ["height > -5"],
        "simulation": {"step": 1e-3, "horizon": 1.0, "penetration": 1e-8, "rest": {"window": 0.1, "drift": 1e-6}},
        "phases": [{"name": "hold", "duration": 0.5}, {"name": "free"}],
        "materials": {"steel_steel": {"friction": 0.2, "restitution": 0.1}},
        "bodies": {
            "ground": {"fixed": True},
            "link": {"mass": 2.0, "inertia": [3.0, 1.0, 3.0], "origin": [0, 0, 1], "angle": 0.25},
        },
        "joints": {
            "J1": {
                "type": "clearance_revolute",
                "bearing": {"body": "link", "point": [0, 0, 0], "axis": [0, 0, 2]},
                "journal": {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1], "radius": [1.0, 0.9]},
                "rings": [-1.0, 1.0],
                "radial_clearance": 0.05,
                "radial_clearance_limit": 0.3,
                "material": "steel_steel",
            }
        },
        "contacts": {
            "stop": {
                "a": {"body": "ground", "plane": {"point": [0, -9, 0], "normal": [0, 1, 0]}},
                "b": {"body": "link", "point": [0, -8, 0]},
                "friction": 0.3,
            }
        },
        "springs": {
            "pull": {
                "type": "linear",
                "a": {"body": "ground", "point": [1, 0, 0]},
                "b": {"body": "link", "point": [0, -4, 0]},
                "stiffness": 2.0,
                "free_length": 3.0,
            },
            "turn": {
                "type": "torsion",
                "a": "ground",
                "b": "link",
                "axis": [0, 0, 1],
                "stiffness": 5.0,
                "free_angle": 0.5,
            },
        },
        "dampers": {"grease": {"type": "torsion", "a": "ground", "b": "link", "axis": [0, 0, 1], "damping": 0.2}},
        "forces": {
            "weight": {"body": "link", "force": [0, -1, 0]},
            "shake": {"body": "link", "force": [1, 0, 0], "law": {"amplitude": 0.5, "period": 0.1}},
        },
        "torques": {"brake": {"body": "link", "torque": [0, 0, 1], "phases": ["hold"]}},
        "motions": {
            "lift": {
                "body": "link",
                "along": {"point": [0, -8, 0], "direction": [0, 1, 0]},
                "law": {"table": [[0, 0], [0.5, 2]], "interpolation": "smooth"},
            },
            "swing": {"body": "link", "relative_to": "ground", "about": {"axis": [0, 0, 1]}, "law": {"speed": 0.1}},
        },
        "responses": {
            "load": {"type": "contact_force", "contact": "stop"},
            "height": {
                "type": "position",
                "from": {"body": "ground", "axis": {"point": [0, 0, 0], "axis": [0, 0, 1]}},
                "to": {"body": "link", "point": [0, -8, 0]},
                "direction": {"vector": [0, 3, 0]},
            },
        },
    }


def put(data: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Set ``path`` (dotted) of ``data`` and return it; a value of ... removes the key."""
    *tables, key = path.split(".")
    table = data
    for name in tables:
        table = table[int(name)] if isinstance(table, list) else table.setdefault(name, {})
    if value is ...:
        del table[key]
    else:
        table[int(key) if isinstance(table, list) else key] = value
    return data
