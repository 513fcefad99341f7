"""A chain of n links released off the vertical: what a link costs should not grow with n.

Ideal joints have bilateral rows, with friction a contact beside them; a joint with play has two rings. A pin that a
force F presses against its bore swings on the radial play c at about sqrt(F / (m c)). From two divided by that on, a
step does not resolve the swing, and forces alternate: with more links F grows, and with less play c shrinks.
"""

from math import cos, sin
from time import process_time
from typing import Any

from engine.assembly import assemble
from engine.kernels.time_loop import ITERATIONS, OK, REPEATED, STATUS, STEPS
from engine.kernels.time_loop import TIME as REACHED
from engine.loop import control_of, drive
from engine.mechanism import mechanism_from

LENGTH, MASS, PIN, HALF_WIDTH = 0.1, 0.05, 0.005, 0.01  # of a link: m, kg; radius of a pin, station of a ring
ACROSS = [0.0, 1.0, 0.0]
LINKS = (10, 30, 100, 300, 1000)
KINDS: dict[str, dict[str, float]] = {  # play in m, torque in N m
    "ideal": {"clearance": 0.0},
    "ideal, friction": {"clearance": 0.0, "torque": 1e-4},
    "play 1 mm": {"clearance": 1e-3},
    "play 0.1 mm": {"clearance": 1e-4},
    "play 0.01 mm": {"clearance": 1e-5},
    "play 0.1 mm, smooth": {"clearance": 1e-4, "friction": 0.0},
    "play 0.01 mm, smooth": {"clearance": 1e-5, "friction": 0.0},
}
TIME, WALL_LIMIT = 0.05, 60.0  # s


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return a row for each kind of joint and number of links; ``unit_us`` is the reference [us]."""
    rows = []
    for kind in KINDS:
        least = 0.0
        for links in LINKS:
            row = _row(kind, links)
            least = least or row["us a link and ms"]
            ratio = row["us a link and ms"] / least
            rows.append({**row, "in solves": row["us a link"] / unit_us, "to 10 links": ratio})
    return rows


def _row(kind: str, links: int) -> dict[str, Any]:
    mechanism = mechanism_from(chain(links, **KINDS[kind]), "chain")
    assembly, control = assemble(mechanism), control_of(mechanism, True)._replace(horizon=TIME)
    start = process_time()  # time of this process only, without other load
    course = drive(assembly, control, WALL_LIMIT)
    spent, steps = 1e6 * (process_time() - start) / links, int(course.counts[STEPS])
    return {
        "joints": kind,
        "links": links,
        "steps": steps,
        "solved": bool(course.counts[STATUS] == OK),
        "repeated": int(course.counts[REPEATED]),
        "iterations": float(course.counts[ITERATIONS]) / steps,
        "us a link": spent / steps,
        "us a link and ms": spent / (1e3 * course.reals[REACHED]),  # of simulated time, repeated steps included
    }


def chain(
    links: int, clearance: float = 1e-4, friction: float = 0.1, angle: float = 0.5, torque: float = 0.0
) -> dict[str, Any]:
    """Describe bars on pins, released at rest at an `angle` [rad].

    A radial `clearance` [m] of 0 makes joints ideal; then friction is a `torque` [N m].
    """
    joint: dict[str, Any] = {"type": "revolute"}
    if clearance > 0:
        joint = {"type": "clearance_revolute", "rings": [-HALF_WIDTH, HALF_WIDTH], "radial_clearance": clearance}
    elif torque > 0:
        joint["friction_torque"] = torque
    return {
        "format": 1,
        "name": "chain",
        "title": f"Chain of {links} links",
        "description": f"{links} links of 0.1 m on pins with play, hanging, released off the vertical.",
        "units": "SI",
        "gravity": [0.0, 0.0, -9.81],
        "simulation": {"step": 5e-4, "horizon": 0.5, "penetration": 1e-11, "rest": {"window": 0.1, "drift": 1e-9}},
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
