"""Balls in sockets: concentric spheres of two parts; and near misses, each with the reason."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array
from engine.cad.cad_model import CadAssembly, CadFace, Coordinates, Millimetres
from engine.cad.findings.pins_in_holes import MOST_CLEARANCE, MOST_EXCESS, NearMiss

_NEAR = 1.0  # mm of difference between radii or centres, up to which a refused pair is reported
_LEAST_BALL = 0.25  # share of a whole sphere; less is a rounded end
_DIRECTIONS = 4000  # number of directions in which a ball could leave its socket


@dataclass(frozen=True, eq=False, kw_only=True)
class BallInSocket:
    """A joint of two parts: a ball held by its socket in all directions."""

    socket_part: str
    ball_part: str
    socket: int
    """Number of the face."""
    ball: int
    centre: Coordinates
    """Centre of the socket, shape (3,) [mm]."""
    ball_centre: Coordinates
    socket_radius: Millimetres
    ball_radius: Millimetres
    radial_clearance: Millimetres
    """As drawn; 0 if both have the same radius."""
    overlap: Millimetres
    """How far ball and socket overlap as posed [mm]."""


def balls_in_sockets(assembly: CadAssembly, triangles: dict[int, Array]) -> tuple[list[BallInSocket], list[NearMiss]]:
    """Return the balls in sockets of an assembly in mm, and the near misses; triangles from `triangles_by_face`."""
    spheres = [face for face in assembly.faces if face.kind == "sphere" and face.number in triangles]
    found, refused = [], []
    for socket in (face for face in spheres if face.hollow):
        for ball in (face for face in spheres if not face.hollow and face.part != socket.part):
            if not _near(socket, ball):
                continue
            if reason := _refusal(socket, ball, triangles[socket.number].reshape(-1, 3)):
                refused.append(NearMiss(hole=socket.number, pin=ball.number, reason=reason))
            else:
                found.append(_joint(socket, ball))
    return found, refused


def _near(socket: CadFace, ball: CadFace) -> bool:
    """Return whether radii and centres differ little, and the ball is more than a rounded end."""
    whole = ball.area > _LEAST_BALL * 4 * np.pi * ball.radius**2
    return bool(whole and abs(socket.radius - ball.radius) <= _NEAR and _offset(socket, ball) <= _NEAR)


def _offset(socket: CadFace, ball: CadFace) -> float:
    return float(np.linalg.norm(ball.point - socket.point))


def _unsure(socket: CadFace, ball: CadFace) -> float:
    """Return the difference of the radii [mm] that is not significant."""
    return socket.recognition_gap + ball.recognition_gap + 1e-9


def _refusal(socket: CadFace, ball: CadFace, points: Array) -> str:
    """Return why a pair is not a joint; empty if it is one."""
    clearance = socket.radius - ball.radius
    if clearance < -_unsure(socket, ball) - 1e-6:
        return f"the ball is {-clearance:.3g} mm larger in radius than the socket: a press fit, or an error"
    if clearance > MOST_CLEARANCE:
        return f"the radii differ by {clearance:.3g} mm; allowed: up to {MOST_CLEARANCE:g}"
    allowed = max(clearance, 0.0) + MOST_EXCESS
    if _offset(socket, ball) > allowed:
        far = _offset(socket, ball)
        return f"the centres are {far:.3g} mm apart; allowed: the clearance + {MOST_EXCESS:g}, so {allowed:.3g}"
    if not _holds(points - socket.point, ball.radius):
        return "the ball can leave the socket, which is not all round it; write a contact of a sphere and a socket"
    return ""


def _holds(points: Array, ball_radius: float) -> bool:
    """Return whether a socket, given by points relative to its centre, is narrower than the ball in all directions."""
    away = np.linalg.norm(points, axis=1)
    towards = points / away[:, None]
    turns = np.arange(_DIRECTIONS) * np.pi * (3.0 - np.sqrt(5.0))  # an evenly spaced spiral of points
    heights = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    across = np.sqrt(1.0 - heights**2)
    ways = np.column_stack([across * np.cos(turns), across * np.sin(turns), heights])
    beyond = max(0.0, 1.0 - (ball_radius / float(away.max())) ** 2) ** 0.5  # sine of the angle past the widest circle
    return bool((ways @ towards.T).max(axis=1).min() > max(beyond, 0.02))


def _joint(socket: CadFace, ball: CadFace) -> BallInSocket:
    clearance, unsure = socket.radius - ball.radius, _unsure(socket, ball)
    overlap = _offset(socket, ball) - max(clearance, 0.0)
    return BallInSocket(
        socket_part=socket.part,
        ball_part=ball.part,
        socket=socket.number,
        ball=ball.number,
        centre=socket.point,
        ball_centre=ball.point,
        socket_radius=socket.radius,
        ball_radius=ball.radius,
        radial_clearance=clearance if clearance > unsure else 0.0,
        overlap=overlap if overlap > unsure else 0.0,
    )
