"""The C-60 at rest against statics worked out apart: frictionless forces by scipy, where they press the journals."""

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from campaign import load_campaign
from campaign.inputs.sampling import draw
from engine import load_mechanism, read_trajectory, simulate
from tests.engine.small import shipped


def numbers(data):
    """Return plain data with the values of the expressions of `latch_angle`, at its shipped angle of 0."""
    if isinstance(data, dict):
        return {name: numbers(each) for name, each in data.items()}
    if isinstance(data, list):
        return [numbers(each) for each in data]
    is_formula = isinstance(data, str) and "(latch_angle)" in data
    return eval(data, {"sin": math.sin, "cos": math.cos, "tan": math.tan, "latch_angle": 0.0}) if is_formula else data


DATA = numbers(shipped("c60"))
MOVING = [name for name, body in DATA["bodies"].items() if not body.get("fixed")]
JOINTS = [f"J{i}" for i in range(1, 8)]


def turned(body, vector):
    """Return the first two components of a body's vector in the world: every body is turned about z, or lies on it."""
    if body == "needle":
        return np.zeros(2)  # its axis is that of the world
    angle = DATA["bodies"][body].get("angle", 0.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ np.asarray(vector[:2], float)


def place(body, point):
    """Return where a body's point is in the world, seen along z."""
    return np.asarray(DATA["bodies"][body].get("origin", [0, 0, 0])[:2], float) + turned(body, point)


def wrench(point, force):
    """Return force and moment about the origin."""
    return np.array([*force, point[0] * force[1] - point[1] * force[0]])


def unit(vector):
    """Return the vector at length one."""
    return vector / np.linalg.norm(vector)


def contacts():
    """Yield (name, body pushed, body that pushes, point, direction) of the contacts that may carry load in ON."""
    for name in ("C1_1", "C1_2", "C1_3", "C1_4"):
        arc, plane = DATA["contacts"][name]["a"], DATA["contacts"][name]["b"]
        normal = turned(plane["body"], plane["plane"]["normal"])
        point = place(arc["body"], arc["arc"]["centre"]) - arc["arc"]["radius"] * normal
        yield name, arc["body"], plane["body"], point, normal
    hook, bar = DATA["responses"]["latch_overlap"]["from"], DATA["contacts"]["C4_1"]["b"]
    yield "C4", "hook", "tripping_bar", place("hook", hook["point"]), turned("tripping_bar", bar["rectangle"]["normal"])
    bump = place("tripping_bar", DATA["contacts"]["C5_1"]["a"]["arc"]["centre"])
    away = unit(bump - place("hook", [0.0, 0.0]))
    yield "C5", "tripping_bar", "hook", bump, away
    edge = DATA["contacts"]["C7"]["a"]["cylinder"]
    normal = np.array(DATA["contacts"]["C7"]["b"]["plane"]["normal"][:2])
    yield "C7", "moving_contact", "case", place("moving_contact", edge["point"]) - edge["radius"] * normal, normal


def springs():
    """Yield (body, point, force) and (body, None, couple) of the three springs at the start pose."""
    handle, a2, a3 = (DATA["springs"][name] for name in ("handle_spring", "A2", "A3"))
    angles = {name: body.get("angle", 0.0) for name, body in DATA["bodies"].items()}
    yield "handle", None, handle["stiffness"] * (handle["free_angle"] - angles["handle"])
    ends = place("case", a2["a"]["point"]), place("plate", a2["b"]["point"])
    heights = [a2["a"]["point"][2], DATA["bodies"]["plate"]["origin"][2] + a2["b"]["point"][2]]
    line = np.array([*(ends[1] - ends[0]), heights[1] - heights[0]])
    length = np.linalg.norm(line)
    yield "plate", ends[1], a2["stiffness"] * (a2["free_length"] - length) * line[:2] / length
    turn = angles["moving_contact"] - angles["plate"] - a3["free_angle"] + a3["preload"]
    yield "moving_contact", None, -a3["stiffness"] * turn
    yield "plate", None, a3["stiffness"] * turn


@pytest.fixture(scope="module")
def statics():
    """Solve the planar balance of seven bodies without friction: joint forces on journals, contact forces >= 0."""
    columns, names, low = [], [], []

    def add(name, pushed, pushing, point, direction, least):
        column = np.zeros((len(MOVING), 3))
        for body, sign in ((pushed, 1.0), (pushing, -1.0)):
            if body in MOVING:
                column[MOVING.index(body)] += sign * wrench(point, direction)
        columns.append(column.ravel())
        names.append(name)
        low.append(least)

    for joint in [*JOINTS, "S3"]:
        journal, bearing = DATA["joints"][joint]["journal"], DATA["joints"][joint]["bearing"]
        for axis in np.eye(2):
            add(joint, journal["body"], bearing["body"], place(bearing["body"], bearing["point"]), axis, -np.inf)
    for contact in contacts():
        add(*contact, 0.0)
    load = np.zeros((len(MOVING), 3))
    for body, point, action in springs():
        load[MOVING.index(body)] += wrench(point, action) if point is not None else [0.0, 0.0, action]
    found = lsq_linear(np.array(columns).T, -load.ravel(), bounds=(low, np.inf), tol=1e-14)
    assert np.linalg.norm(found.fun) < 1e-3 * np.linalg.norm(load)  # the pose is in balance: a static solution exists
    return {name: np.array([x for n, x in zip(names, found.x, strict=True) if n == name]) for name in names}


@pytest.fixture(scope="module")
def settled(tmp_path_factory):
    """Run the C-60 as shipped and keep its motion."""
    path = tmp_path_factory.mktemp("c60") / "on.h5"
    return simulate(load_mechanism("c60"), trajectory=path), read_trajectory(path)


def test_forces_without_friction(statics):
    """Against the hand calculation of the public model, whose A3 gives the plate 1.2513 times its couple.

    It has 13.2 N at the contact, 55.7 N in the rod and 10.1 to 11.5 N at the latch; rod and latch hold the plate
    against A2 and A3, 74.6 N mm and 265.8 N mm, and are less by so much as the couple here is balanced.
    """
    less = (74.6 + 265.8) / (74.6 + 1.2513 * 265.8)
    assert statics["C7"][0] == pytest.approx(13.2, abs=0.2)
    assert np.linalg.norm(statics["J5"]) == pytest.approx(55.7 * less, rel=0.02)
    assert 10.1 * less < statics["C4"][0] < 11.5 * less


@pytest.mark.parametrize("joint", JOINTS)
def test_journals_lie_where_statics_press_them(statics, settled, joint):
    """The journal in the ring that carries most: within 45 degrees of the frictionless force, and on the circle.

    Friction of 0.1 and 0.3 turns a force by 6 and 17 degrees, and changes the sizes of all.
    """
    _, motion = settled
    rings = [name for name in motion.contacts if name.startswith(f"{joint}.ring")]
    ring = max(rings, key=lambda name: motion.contacts[name].impulse[-1, 0])
    seat = _eccentricity(motion, joint, rings.index(ring))
    towards = unit(-statics[joint])  # what pushes the journal back has pressed it the other way
    assert np.linalg.norm(seat) == pytest.approx(0.07, abs=1e-3)
    assert unit(seat) @ towards > np.cos(np.pi / 4)


def _eccentricity(motion, joint, ring):
    """Return where the journal's axis is in one ring of its bearing, seen along z, at the end [mm]."""
    data = DATA["joints"][joint]
    side = {}
    for name in ("bearing", "journal"):
        body = data[name]["body"]
        if body == "case":
            frame, origin = np.eye(3), np.zeros(3)
        else:
            frame, origin = _rotation(motion.bodies[body].quaternion[-1]), motion.bodies[body].origin[-1]
        side[name] = origin + frame @ data[name]["point"], frame @ np.array(data[name]["axis"], float)
    centre = side["bearing"][0] + data["rings"][ring] * side["bearing"][1]
    point, axis = side["journal"]
    along = (centre[2] - point[2]) / axis[2]
    return (point + along * axis - centre)[:2]


def _rotation(quaternion):
    """Return the rotation of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.slow
def test_sensitivity_to_play_is_that_of_finite_differences():
    """FC-1 and FC-6 by regression on 60 samples, all joints together, against runs with all of them changed.

    Joint by joint the friction that is frozen in, 0.1 N, hides the 2 N/mm that a joint takes; the sum stands out.
    """
    mechanism, spec = load_mechanism("c60"), load_campaign("c60").spec
    drawn = draw(spec, 0, 60)
    plays = np.column_stack(list(drawn.values()))
    found = [simulate(mechanism, dict(zip(drawn, map(float, row), strict=True))).responses for row in plays]
    grid = np.linspace(0.05, 0.09, 9)
    line = [simulate(mechanism, dict.fromkeys(JOINTS, float(play))).responses for play in grid]
    for name, sign in (("FC-1", -1), ("FC-6", 1)):
        y = np.array([run[name] for run in found])
        design = np.column_stack([np.ones(len(y)), plays - plays.mean(axis=0)])
        coefficients, *_ = np.linalg.lstsq(design, y, rcond=None)
        left = y - design @ coefficients
        covariance = np.linalg.inv(design.T @ design) * (left @ left) / (len(y) - 8)
        together, error = coefficients[1:].sum(), np.sqrt(covariance[1:, 1:].sum())
        (slope, _), spread = np.polyfit(grid, [run[name] for run in line], 1, cov=True)
        assert sign * together > 3 * error
        assert abs(together - slope) < 4 * np.hypot(error, np.sqrt(spread[0, 0]))
