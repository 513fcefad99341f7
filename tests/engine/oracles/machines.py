"""Machines of a few bodies that answer one question each, with steps that grow and shrink: none is in the library."""

from typing import Any

import numpy as np

from tests.engine.small import GRAVITY, coordinates, small

UNIT = dict(zip("xyz", np.eye(3).tolist(), strict=True))
ADAPTIVE = {"step": 1e-4, "adaptive": {"longest": 4e-3, "travel": 2e-4}}
DOWN = [0, 0, -GRAVITY]
GROUND: dict[str, Any] = {"fixed": True}


def machine(horizon: float, duration: float | None = None, **tables: Any) -> dict[str, Any]:
    """Describe a mechanism with adaptive steps, that comes to rest, or that moves for a given duration."""
    simulation = {**ADAPTIVE, "horizon": horizon, **tables.pop("simulation", {})}
    phases = {"phases": [{"name": "motion", "duration": duration}]} if duration else {}
    return small(simulation=simulation, **phases, **tables)


def along(axis: str, body: str) -> dict[str, Any]:
    """Measure where a body is along an axis."""
    return coordinates(body)[axis]


def force(contact: str) -> dict[str, Any]:
    """Measure the normal force of a contact."""
    return {"type": "contact_force", "contact": contact}


def brick(mass: float, half: Any, **body: Any) -> dict[str, Any]:
    """Describe a brick of uniform mass, with half its edges."""
    a, b, c = np.asarray(half) ** 2
    return {"mass": mass, "inertia": [mass * (b + c) / 3, mass * (a + c) / 3, mass * (a + b) / 3], **body}


def feet(body: str, half: Any, other: str, height: float, friction: float) -> dict[str, Any]:
    """Let the lower corners of a brick stand on a plane of another body."""
    corners = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    return {
        f"{body}_{i}": {
            "a": {"body": body, "point": [x * half[0], y * half[1], -half[2]]},
            "b": {"body": other, "plane": {"point": [0, 0, height], "normal": [0, 0, 1]}},
            "friction": friction,
        }
        for i, (x, y) in enumerate(corners)
    }


def slide(body: str, place: list[float], axis: str) -> dict[str, Any]:
    """Let a body whose origin is at ``place`` slide along an axis of the ground."""
    guide = {"body": "ground", "point": place, "axis": UNIT[axis]}
    return {"type": "prismatic", "guide": guide, "slider": {"body": body, "point": [0, 0, 0], "axis": UNIT[axis]}}


def hinge(body: str, point: list[float], place: list[float], play: float = 0.0) -> dict[str, Any]:
    """Let a body turn about y in a bearing of its own, on a pin of the ground."""
    return {
        "type": "clearance_revolute" if play else "revolute",
        "bearing": {"body": body, "point": point, "axis": [0, 1, 0]},
        "journal": {"body": "ground", "point": place, "axis": [0, 1, 0], "radius": 0.01},
        "rings": [-0.05, 0.05],
        "radial_clearance": play or 1e-3,
        "friction": 0.1,
    }


def plates(pull: float, friction: tuple[float, ...] = (0.2, 0.4, 0.6), duration: float = 0.2) -> dict[str, Any]:
    """Stack three plates of 1, 2 and 3 kg and pull the uppermost."""
    height, half = 0.02, [0.2, 0.15, 0.01]
    bodies, contacts = {"ground": GROUND}, {}
    for i, mu in enumerate(friction):
        bodies[f"plate_{i}"] = brick(1.0 + i, half, origin=[0, 0, height * (i + 0.5)])
        below = ("ground", 0.0) if i == 0 else (f"plate_{i - 1}", height / 2)
        contacts |= feet(f"plate_{i}", half, *below, mu)
    return machine(
        1.0, duration, gravity=DOWN, bodies=bodies, contacts=contacts,
        forces={"pull": {"body": "plate_2", "point": [0, 0, -height / 2], "force": [pull, 0, 0], "frame": "body"}},
        responses={f"x{i}": along("x", f"plate_{i}") for i in range(3)},
    )  # fmt: skip


def oscillator(friction: float, start: float, stiffness: float = 100.0) -> dict[str, Any]:
    """Let a brick of 1 kg on the floor go, held by a spring at the height of its centre."""
    half = [0.05, 0.05, 0.05]
    spring = {
        "type": "linear", "stiffness": stiffness, "free_length": 1.0,
        "a": {"body": "ground", "point": [-1, 0, 0.05]}, "b": {"body": "brick", "point": [0, 0, 0]},
    }  # fmt: skip
    return machine(
        20.0, gravity=DOWN, bodies={"ground": GROUND, "brick": brick(1.0, half, origin=[start, 0, 0.05])},
        contacts=feet("brick", half, "ground", 0.0, friction), springs={"spring": spring},
        responses={"x": along("x", "brick")},
    )  # fmt: skip


def wedge(angle: float, friction: float, mass: float) -> dict[str, Any]:
    """Press a wedge on the floor from above with a guided load of 50 kg; it slips out if it is too steep."""
    half = [0.1, 0.05, 0.02]
    face = {"point": [0, 0, 0.02], "normal": [-np.sin(angle), 0, np.cos(angle)]}
    nose = {"a": {"body": "load", "point": [0, 0, -0.26]}, "b": {"body": "wedge", "plane": face}, "friction": friction}
    wedge = brick(mass, half, origin=[0, 0, 0.02])
    load = brick(50.0, [0.02, 0.02, 0.1], origin=[0, 0, 0.3])
    return machine(
        0.3, gravity=DOWN, bodies={"ground": GROUND, "wedge": wedge, "load": load},
        joints={"guide": slide("load", [0, 0, 0.3], "z")},
        contacts=feet("wedge", half, "ground", 0.0, friction) | {"nose": nose},
        responses={"x": along("x", "wedge"), "force": force("nose")}
        | {"friction": force("nose") | {"component": "friction"}},
    )  # fmt: skip


def tether(length: float, start: float, duration: float) -> dict[str, Any]:
    """Let a small mass fall that is tied to the origin by a slack thread: a ball in a large socket."""
    return machine(
        5.0, duration, gravity=DOWN,
        bodies={"ground": GROUND, "mass": {"mass": 1.0, "inertia": [1e-5] * 3, "origin": [start, 0, 0]}},
        joints={"thread": {
            "type": "clearance_spherical", "socket": {"body": "ground", "point": [0, 0, 0]},
            "ball": {"body": "mass", "point": [0, 0, 0], "radius": 0.01}, "radial_clearance": length, "friction": 0.0,
        }},
        responses={axis: along(axis, "mass") for axis in "xz"},
    )  # fmt: skip


def seesaw(duration: float | None = None, play: float = 0.0) -> dict[str, Any]:
    """Drop guided balls of 1 and 3 kg on a beam of 2 kg, one after the other; the beam has a stop below each end."""
    beam = {"mass": 2.0, "inertia": [0.01, 1 / 6, 1 / 6], "origin": [0, 0, 0.2]}
    ball = {"inertia": [1e-3] * 3}
    top, sphere = {"point": [0, 0, 0], "normal": [0, 0, 1]}, {"centre": [0, 0, 0], "radius": 0.02}
    contacts: dict[str, Any] = {
        f"hit_{i}": {"a": {"body": f"ball_{i}", "sphere": sphere}, "b": {"body": "beam", "plane": top}, "friction": 0.0}
        for i in (1, 2)
    } | {
        f"stop_{i}": {
            "a": {"body": "beam", "point": [side, 0, 0]},
            "b": {"body": "ground", "plane": {"point": [0, 0, 0.1], "normal": [0, 0, 1]}}, "friction": 0.2,
        } for i, side in ((1, -0.5), (2, 0.5))
    }  # fmt: skip
    places = {1: [-0.4, 0, 0.5], 2: [0.4, 0, 0.7]}
    balls = {f"ball_{i}": {"mass": 2.0 * i - 1, "origin": places[i], **ball} for i in (1, 2)}
    angle = {"type": "angle", "body": "beam", "relative_to": "ground", "axis": [0, 1, 0]}
    return machine(
        5.0, duration, gravity=DOWN, bodies={"ground": GROUND, "beam": beam} | balls, contacts=contacts,
        joints={f"guide_{i}": slide(f"ball_{i}", places[i], "z") for i in (1, 2)}
        | {"pivot": hinge("beam", [0, 0, 0], [0, 0, 0.2], play)},
        responses={"angle": angle, "z1": along("z", "ball_1"), "z2": along("z", "ball_2")}
        | ({} if duration else {name: force(name) for name in contacts}),
    )  # fmt: skip


def detent(push: float, slope: float, friction: float, spring: float) -> dict[str, Any]:
    """Push a slider whose notch holds a guided ball under a spring."""
    radius = 0.005
    height = radius / np.cos(slope)
    bodies = {
        "ground": GROUND,
        "slider": brick(0.2, [0.05, 0.02, 0.01]),
        "ball": {"mass": 0.004, "inertia": [4e-8] * 3, "origin": [0, 0, height]},
    }

    def flank(side: int) -> dict[str, Any]:
        return {"point": [0, 0, 0], "normal": [side * np.sin(slope), 0, np.cos(slope)]}

    return machine(
        0.1, simulation={"step": 2e-5}, bodies=bodies,
        joints={"way": slide("slider", [0, 0, 0], "x"), "guide": slide("ball", [0, 0, height], "z")},
        contacts={
            name: {
                "a": {"body": "ball", "sphere": {"centre": [0, 0, 0], "radius": radius}},
                "b": {"body": "slider", "plane": flank(side)},
                "friction": friction,
            } for name, side in (("left", 1), ("right", -1))
        },
        springs={"spring": {
            "type": "linear", "a": {"body": "ground", "point": [0, 0, 0.1]}, "b": {"body": "ball", "point": [0, 0, 0]},
            "stiffness": 500.0, "free_length": 0.1 - height, "preload": spring,
        }},
        forces={"push": {"body": "slider", "force": [push, 0, 0], "frame": "body"}},
        responses={"x": along("x", "slider"), "left": force("left"), "right": force("right")},
    )  # fmt: skip


def brake(friction: float, turn: int) -> dict[str, Any]:
    """Press a lever on a drum that a motor turns; friction pulls the lever in or pushes it off."""
    drum = {"mass": 1.0, "inertia": [1e-3] * 3}
    lever = {"mass": 0.2, "inertia": [1e-4, 1e-3, 1e-3], "origin": [0, 0, 0.1]}
    cylinder = {"point": [0, 0, 0], "axis": [0, 1, 0], "radius": 0.1}
    pad = {"a": {"body": "lever", "point": [0, 0, 0]}, "b": {"body": "drum", "cylinder": cylinder}}
    axle = hinge("drum", [0, 0, 0], [0, 0, 0])
    return machine(
        1.0, 0.05, simulation={"step": 2e-5}, bodies={"ground": GROUND, "drum": drum, "lever": lever},
        joints={"axle": axle, "pivot": hinge("lever", [-0.2, 0, 0.05], [-0.2, 0, 0.15])},
        contacts={"pad": pad | {"friction": friction}},
        forces={"hand": {"body": "lever", "point": [0.2, 0, 0], "force": [0, 0, -10.0], "frame": "body"}},
        motions={"motor": {"body": "drum", "relative_to": "ground", "about": {"axis": [0, 1, 0]},
                           "law": {"speed": 10.0 * turn}}},
        responses={"force": force("pad")},
    )  # fmt: skip


def toggle(angle: float, play: float, friction: float = 0.0) -> dict[str, Any]:
    """Push the knee of a toggle clamp, with play at its three pins and at its slider, which meets a stop."""
    length, mass = 0.1, 0.05
    knee, end = length * np.array([np.cos(angle), 0, np.sin(angle)]), [2 * length * np.cos(angle), 0, 0]
    inertia = [1e-6, mass * length**2 / 12, mass * length**2 / 12]
    link = {"mass": mass, "inertia": inertia, "axis": [0, 1, 0]}

    def pin(bearing: str, at: float, journal: str, on: float) -> dict[str, Any]:
        return {
            "type": "clearance_revolute", "rings": [-0.01, 0.01], "radial_clearance": play, "friction": friction,
            **({} if friction else {"flanges": {"radius": 0.006}, "axial_clearance": play}),  # or they would slide off
            "bearing": {"body": bearing, "point": [at, 0, 0], "axis": [0, 1, 0]},
            "journal": {"body": journal, "point": [on, 0, 0], "axis": [0, 1, 0], "radius": 0.004},
        }  # fmt: skip

    side = {"point": [0, 0, 0], "axis": [1, 0, 0], "normal": [0, 0, 1]}
    clamp = {
        "type": "clearance_prismatic",
        "guide": {**side, "body": "ground", "point": end}, "slider": {**side, "body": "jaw"},
        "block": {"half_length": 0.02, "half_height": 0.02, "half_width": 0.02},
        "clearance": play, "width_clearance": play, "friction": friction,
    }  # fmt: skip
    wall = {"point": [end[0] + 0.02, 0, 0], "normal": [-1, 0, 0]}
    stop = {"a": {"body": "jaw", "point": [0.02, 0, 0]}, "b": {"body": "ground", "plane": wall}, "friction": friction}
    bodies = {
        "ground": GROUND,
        "first": {**link, "origin": (knee / 2).tolist(), "angle": -angle},
        "second": {**link, "origin": ((knee + end) / 2).tolist(), "angle": angle},
        "jaw": brick(0.1, [0.02, 0.02, 0.02], origin=end),
    }
    data = machine(
        5.0, simulation={"step": 2e-5}, bodies=bodies, contacts={"stop": stop},
        joints={
            "root": pin("first", -length / 2, "ground", 0.0),
            "knee": pin("second", -length / 2, "first", length / 2),
            "end": pin("jaw", 0.0, "second", length / 2),
            "clamp": clamp,
        },
        forces={"hand": {"body": "first", "point": [length / 2, 0, 0], "force": [0, 0, -10.0], "frame": "world"}},
        responses={"force": force("stop"), "root": {"type": "joint_force", "joint": "root"}},
    )  # fmt: skip
    return data | {"phases": [{"name": "close", "damping": 20.0}]}
