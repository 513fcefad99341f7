"""Closed linkages of ideal pins that hold some motions twice, each with the motion that its one freedom leaves."""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from engine.arrays import Array
from tests.engine.small import GRAVITY, small

BENNETT = (0.6, np.radians(70.0)), (0.4, np.arcsin(0.4 / 0.6 * np.sin(np.radians(70.0))))  # length, twist of its links
START, LINK = 1.2, [0.03, 0.04, 0.05]  # angle of the first link; moments of inertia
SPRING = {"stiffness": 20.0, "free_angle": 1.0}  # 10 J at the start
ROD = 1 / 12  # moment of inertia of a rod of 1 m and 1 kg across it
THIN = 1.667e-3  # and along it


def pin(name: str, sides: list[tuple[str, Any, Any]]) -> dict[str, Any]:
    """Join two bodies, each given with a point and an axis in its own frame, by an ideal pin."""
    ends = [{"body": body, "point": list(map(float, p)), "axis": list(map(float, axis))} for body, p, axis in sides]
    return {name: {"type": "revolute", "bearing": ends[0], "journal": ends[1]}}


def linkage(points: Array, axes: Array, inertia: list[list[float]]) -> dict[str, Any]:
    """Return bodies and joints of a closed linkage of links of 1 kg; the last link, back to the first point, is fixed.

    Each link's frame is at its middle, parallel to the world.
    """
    names = [f"link_{i}" for i in range(len(points) - 1)] + ["ground"]
    middle = np.append(0.5 * (points[:-1] + points[1:]), [np.zeros(3)], axis=0)
    bodies: dict[str, Any] = {"ground": {"fixed": True}}
    for i, name in enumerate(names[:-1]):
        bodies[name] = {"mass": 1.0, "inertia": inertia[i], "origin": middle[i].tolist()}
    joints: dict[str, Any] = {}
    for i, (p, axis) in enumerate(zip(points, axes, strict=True)):
        ends = [(names[k], p - middle[k], axis) for k in (i - 1, i)]
        joints |= pin("ABCDEFGH"[i], ends)
    return {"bodies": bodies, "joints": joints}


def bennett_pose(angle: float) -> tuple[Array, Array]:
    """Return the joints of a Bennett linkage and their axes, (4, 3) each, for the angle of its first link.

    The first joint is at the origin with its axis along z; Denavit and Hartenberg's frames lead round the loop.
    """
    (_, alpha), (_, beta) = BENNETT
    other = 2 * np.arctan(np.sin(0.5 * (beta + alpha)) / np.sin(0.5 * (beta - alpha)) / np.tan(0.5 * angle))
    frame, points, axes = np.eye(4), [], []
    for turned, (length, twist) in zip((angle, other, -angle, -other), (*BENNETT, *BENNETT), strict=True):
        points.append(frame[:3, 3].copy())
        axes.append(frame[:3, 2].copy())
        c, s, ct, st = np.cos(turned), np.sin(turned), np.cos(twist), np.sin(twist)
        frame = frame @ np.array(
            [[c, -s * ct, s * st, length * c], [s, c * ct, -c * st, length * s], [0, st, ct, 0], [0, 0, 0, 1]]
        )
    np.testing.assert_allclose(frame, np.eye(4), atol=1e-12)  # the loop is closed
    return np.array(points), np.array(axes)


def bennett(step: float) -> dict[str, Any]:
    """Describe a Bennett linkage that starts from rest against a torsion spring on its first joint."""
    return small(
        simulation={"step": step, "horizon": 5.0},
        springs={"spring": {"type": "torsion", "a": "ground", "b": "link_0", "axis": [0, 0, 1], **SPRING}},
        phases=[{"name": "swing", "duration": 5.0}],
        responses={"fastest": {"type": "angular_velocity", "body": "link_0", "axis": [0, 0, 1], "at": "maximum"}},
        **linkage(*bennett_pose(START), [LINK] * 3),
    )


def bricard(step: float) -> dict[str, Any]:
    """Describe the orthogonal Bricard linkage of the IFToMM benchmark A04: six edges of a cube, one of them fixed."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], float)
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
    along = np.abs(points[1:] - points[:-1])
    inertia = (ROD + (THIN - ROD) * along).tolist()
    return small(
        simulation={"step": step, "horizon": 6.0},
        gravity=[0, -GRAVITY, 0],
        phases=[{"name": "fall", "duration": 6.0}],
        **linkage(points, axes, inertia),
    )


def four_bars(
    count: int,
    step: float,
    horizon: float,
    speed: float,
    angle: float,
    tilt: float = 0.0,
    off: float = 0.0,
    crank_mass: float = 1.0,
) -> dict[str, Any]:
    """Describe a row of parallelograms: ``count`` + 1 cranks of 1 m on the ground, joined by bars of 1 m.

    All stand at ``angle`` from the horizontal and turn at ``speed``, in a plane tilted by ``tilt`` about x, in which
    gravity acts. The axis of one side of the last joint is off by ``off`` [rad].
    """
    c, s, (ct, st) = np.cos(angle), np.sin(angle), (np.cos(tilt), np.sin(tilt))
    up, axis = np.array([0, st, ct]), np.array([0, -ct, st])
    crank = c * np.array([1.0, 0, 0]) + s * up
    across = speed * np.cross(axis, crank)
    turn = np.stack([crank, np.cross(axis, crank), axis], axis=1)
    rod = np.diag([THIN, ROD, ROD])
    bodies: dict[str, Any] = {"ground": {"fixed": True}}
    joints: dict[str, Any] = {}
    for i in range(count + 1):
        foot = np.array([float(i), 0, 0])
        bodies[f"crank_{i}"] = {
            "mass": crank_mass,
            "inertia": (crank_mass * turn @ rod @ turn.T).tolist(),
            "origin": (foot + 0.5 * crank).tolist(),
            "velocity": (0.5 * across).tolist(),
            "angular_velocity": (speed * axis).tolist(),
        }
        joints |= pin(f"foot_{i}", [("ground", foot, axis), (f"crank_{i}", -0.5 * crank, axis)])
    for i in range(count):
        middle = np.array([i + 0.5, 0, 0]) + crank
        bodies[f"bar_{i}"] = {
            "mass": 1.0,
            "inertia": [THIN, ROD, ROD],
            "origin": middle.tolist(),
            "velocity": across.tolist(),
        }
        joints |= pin(f"left_{i}", [(f"crank_{i}", 0.5 * crank, axis), (f"bar_{i}", [-0.5, 0, 0], axis)])
        wrong = np.cos(off) * axis + np.sin(off) * up
        side = (f"crank_{i + 1}", 0.5 * crank, wrong if i == count - 1 else axis)
        joints |= pin(f"right_{i}", [side, (f"bar_{i}", [0.5, 0, 0], axis)])
    return small(
        simulation={"step": step, "horizon": horizon},
        gravity=(-GRAVITY * up).tolist(),
        bodies=bodies,
        joints=joints,
        phases=[{"name": "swing", "duration": horizon}],
        responses={"angle": {"type": "angle", "body": "crank_0", "axis": axis.tolist()}},
    )


def four_bars_exact(count: int, horizon: float, speed: float, angle: float, crank_mass: float = 1.0) -> float:
    """Return by how much the cranks of `four_bars` have turned: one freedom, a pendulum whose bars only shift."""
    inertia, lift = crank_mass * (count + 1) / 3 + count, crank_mass * (count + 1) / 2 + count

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], -GRAVITY * lift / inertia * np.cos(y[0])]

    end = solve_ivp(rate, (0.0, horizon), [angle, speed], method="DOP853", rtol=1e-12, atol=1e-12).y[0, -1]
    return float(end - angle)


def bennett_fastest() -> float:
    """Return the largest speed of the first link of `bennett`, from energy alone.

    With one freedom, m(q) q'^2 / 2 = V(start) - V(q), where m / 2 is the kinetic energy of all links at q' = 1, here by
    differences of their poses.
    """
    most, little = 0.0, 1e-5
    stretch = SPRING["free_angle"]
    for q in np.linspace(START, START + 2 * stretch, 401):
        before, here, after = (_links(q + k * little) for k in (-1, 0, 1))
        inertia = 0.0
        for i in range(3):
            velocity = (after[i][0] - before[i][0]) / (2 * little)
            W = (after[i][1] - before[i][1]) @ here[i][1].T / (2 * little)
            spin = here[i][1].T @ [W[2, 1], W[0, 2], W[1, 0]]
            inertia += velocity @ velocity + spin @ np.diag(LINK) @ spin
        work = 0.5 * SPRING["stiffness"] * (stretch**2 - (q - START - stretch) ** 2)
        most = max(most, 2 * work / inertia)
    return float(np.sqrt(most))


def _links(angle: float) -> list[tuple[Array, Array]]:
    """Return the middle of each moving link of `bennett`, and its rotation since the start."""
    (points, axes), (first, first_axes) = bennett_pose(angle), bennett_pose(START)
    return [
        (0.5 * (points[i] + points[i + 1]), _frame(points, axes, i) @ _frame(first, first_axes, i).T) for i in range(3)
    ]


def _frame(points: Array, axes: Array, i: int) -> Array:
    """Return a rotation fixed in link i, from its length and the axis of its first joint."""
    e = (points[i + 1] - points[i]) / np.linalg.norm(points[i + 1] - points[i])
    return np.stack([e, axes[i], np.cross(e, axes[i])], axis=1)
