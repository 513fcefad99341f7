"""Responses as arrays."""

import numpy as np

from engine.assembly.frames import Frame
from engine.kernels.model import CONTACT_FORCE, POSITION, Responses
from engine.mechanism.models import Mechanism


def response_arrays(mechanism: Mechanism, frames: dict[str, Frame], contacts: list[str]) -> Responses:
    """Return what is measured."""
    n = len(mechanism.responses)
    kind, body, point = np.zeros(n, np.int64), np.zeros((n, 3), np.int64), np.zeros((n, 12))
    offset = np.zeros(n)
    for i, response in enumerate(mechanism.responses.values()):
        if response.type == "contact_force":
            kind[i], body[i, 0] = CONTACT_FORCE, contacts.index(response.contact)
            continue
        start, end, way = response.from_, response.to, response.direction
        turned = frames[way.body or "world"]
        kind[i], offset[i] = POSITION, response.offset
        body[i] = frames[start.body].index, frames[end.body].index, turned.index
        if start.axis is not None:
            point[i, 0:3] = frames[start.body].point(start.axis.point)
            point[i, 3:6] = frames[start.body].direction(start.axis.axis)
        else:
            point[i, 0:3] = frames[start.body].point(start.point or (0.0, 0.0, 0.0))
        point[i, 6:9], point[i, 9:12] = frames[end.body].point(end.point), turned.direction(way.vector)
    return Responses(kind, body, point, offset)
