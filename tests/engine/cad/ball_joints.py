"""Ball joints drawn with OCP: a block with a socket, a ball on a stem."""

from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere
from OCP.gp import gp_Pnt

from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, moved

BALL, SOCKET = 5.0, 5.03


def sphere(centre, radius):
    """Return a whole ball."""
    return BRepPrimAPI_MakeSphere(gp_Pnt(*centre), radius).Shape()


def cup(depth, radius=SOCKET):
    """Return a block whose socket, about the origin, opens a depth above its centre."""
    return cut(box((-8.0, -8.0, -8.0), (16.0, 16.0, 8.0 + depth)), sphere((0.0, 0.0, 0.0), radius))


def stem(radius=BALL):
    """Return a ball about the origin on a stem along z."""
    return fused(sphere((0.0, 0.0, 0.0), radius), cylinder((0.0, 0.0, 0.0), 1.5, 20.0))


def ball_joint(bearing, ball, **move):
    """Return a drawing of the two; the ball may be moved."""
    made = Drawing()
    top = made.assembly("ball joint")
    for name, shape in (("cup", bearing), ("stem", moved(ball, **move))):
        made.add(top, made.product(name, shape), name=name)
    return made
