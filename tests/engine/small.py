"""Small mechanisms made for one question each, and what the tests read off their arrays."""

import copy
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly
from engine.mechanism import Mechanism
from engine.mechanism.models import mechanism_from

GRAVITY = 9.81
CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FLOOR = {"point": [0, 0, 0], "normal": [0, 0, 1]}


def small(**tables: Any) -> dict[str, Any]:
    """Describe a mechanism in SI without anything in it but the given tables."""
    simulation = {
        "step": 1e-3,
        "horizon": 1.0,
        "tolerance": 1e-8,
        "penetration": 1e-8,
        "rest": {"window": 0.05, "drift": 1e-7},
    }
    simulation |= tables.pop("simulation", {})
    return {"format": 1, "name": "small", "units": "SI", "simulation": simulation, **tables}


def made(data: dict[str, Any]) -> Mechanism:
    """Check the data and make the mechanism."""
    return mechanism_from(copy.deepcopy(data), "test")


def shipped(name: str) -> dict[str, Any]:
    """Return a shipped mechanism as plain data."""
    return tomllib.loads(files("engine.mechanism").joinpath("library", f"{name}.toml").read_text("utf-8"))


def coordinates(body: str, point: Any = (0, 0, 0)) -> dict[str, Any]:
    """Measure the three world coordinates of a body's point; the fixed body must be called ``ground``."""
    return {
        axis: {
            "type": "position",
            "from": {"body": "ground", "point": [0, 0, 0]},
            "to": {"body": body, "point": list(point)},
            "direction": {"vector": vector},
        }
        for axis, vector in zip("xyz", np.eye(3).tolist(), strict=True)
    }


def block_on_floor(
    half: Any = (0.3, 0.2, 0.1), friction: float = 0.4, restitution: float = 0.0, **body: Any
) -> dict[str, Any]:
    """Describe a brick of uniform mass with a contact at each corner, above the floor z = 0."""
    a, b, c = np.asarray(half) ** 2
    mass = body.pop("mass", 2.0)
    return small(
        gravity=[0, 0, -GRAVITY],
        bodies={
            "ground": {"fixed": True},
            "block": {"mass": mass, "inertia": [mass * (b + c) / 3, mass * (a + c) / 3, mass * (a + b) / 3], **body},
        },
        contacts={
            f"corner_{i}": {
                "a": {"body": "block", "point": (np.array(corner) * half).tolist()},
                "b": {"body": "ground", "plane": FLOOR},
                "friction": friction,
                "restitution": restitution,
            }
            for i, corner in enumerate(CORNERS)
        },
        responses=coordinates("block"),
    )


def tumbling() -> dict[str, Any]:
    """Throw a brick on the floor, with friction: contacts come and go."""
    data = block_on_floor(
        friction=0.3,
        origin=[0, 0, 0.4],
        axis=[1, 2, 0.5],
        angle=0.6,
        velocity=[0.5, -0.3, -1.0],
        angular_velocity=[1.0, 2.0, -0.5],
    )
    data["simulation"] |= {"horizon": 0.5, "step": 2e-3, "tolerance": 1e-11}
    return data


def swinging() -> dict[str, Any]:
    """Take the shipped pendulum, with friction on its bolt and for half a second only."""
    data = shipped("clearance_pendulum")
    data["materials"]["greased"]["friction"] = 0.2
    data["simulation"] |= {"horizon": 0.5, "step": 1e-3, "tolerance": 1e-11}
    return data


def energy(assembly: Assembly) -> float:
    """Kinetic energy of all bodies and their potential in gravity; springs not counted."""
    bodies, state, gravity = assembly.model.bodies, assembly.state, assembly.model.loads.gravity
    total = 0.0
    for i, (mass, inertia) in enumerate(zip(bodies.mass, bodies.inertia, strict=True)):
        v, spin = state.v[i, :3], state.v[i, 3:]
        total += 0.5 * mass * v @ v + 0.5 * spin @ inertia @ spin - mass * gravity @ state.x[i]
    return float(total)


def place(assembly: Assembly, body: int, x: Any, rotation: Rotation) -> None:
    """Put a body's centre of mass at x and turn its axes."""
    q = rotation.as_quat(canonical=False)
    assembly.state.x[body] = x
    assembly.state.p[body] = [q[3], *q[:3]]
    assembly.state.R[body] = rotation.as_matrix()


def turned(data: dict[str, Any], rotation: Rotation, shift: Any) -> dict[str, Any]:
    """Describe the same mechanism elsewhere: every body's pose and speed, gravity and world directions moved along.

    Loads in the world's directions must be numbers, and motions against the world must turn or go on, not start at a
    point of the world.
    """
    data = copy.deepcopy(data)
    data["gravity"] = rotation.apply(data.get("gravity", [0, 0, 0])).tolist()
    for body in data["bodies"].values():
        axis = np.asarray(body.get("axis", [0, 0, 1]), float)
        own = Rotation.from_rotvec(body.get("angle", 0.0) * axis / np.linalg.norm(axis))
        vector = (rotation * own).as_rotvec()
        angle = float(np.linalg.norm(vector))
        body["axis"], body["angle"] = (vector / angle).tolist(), angle
        body["origin"] = (rotation.apply(body.get("origin", [0, 0, 0])) + shift).tolist()
        if "velocity" in body:
            body["velocity"] = rotation.apply(body["velocity"]).tolist()
    for table, key in _in_the_world(data):
        table[key] = rotation.apply(table[key]).tolist()
    return data


def _in_the_world(data: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield where the world's directions stand: the tables with them, and their keys."""
    for response in data.get("responses", {}).values():
        if "body" not in response.get("direction", {"body": ""}):
            yield response["direction"], "vector"
        elif "axis" in response and "relative_to" not in response:
            yield response, "axis"
    for motion in data.get("motions", {}).values():
        if "relative_to" not in motion:
            yield (motion["along"], "direction") if "along" in motion else (motion["about"], "axis")
    for key in ("force", "torque"):
        for load in data.get(f"{key}s", {}).values():
            if load.get("frame", "world") == "world":
                yield load, key
