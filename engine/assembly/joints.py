"""Joints as arrays: contact pairs of those with clearance."""

from collections.abc import Iterator

import numpy as np

from engine.assembly.contacts import Pair
from engine.assembly.frames import Frame, tangent
from engine.kernels.model import GEOMETRY, RING_BORE
from engine.mechanism.models import Mechanism


def joint_pairs(mechanism: Mechanism, frames: dict[str, Frame]) -> Iterator[Pair]:
    """Yield the contacts of the joints with clearance, named JOINT.FACE (paper, section 3.1)."""
    for name, joint in mechanism.joints.items():
        bearing, journal = frames[joint.bearing.body], frames[joint.journal.body]
        along = bearing.direction(joint.bearing.axis)
        axis = journal.direction(joint.journal.axis)
        for i, (station, radius) in enumerate(zip(joint.rings, joint.radii, strict=True)):
            a, b = np.zeros(GEOMETRY), np.zeros(GEOMETRY)
            a[:3] = bearing.point(joint.bearing.point) + station * along
            b[:3], b[3:6], b[6:9], b[9] = journal.point(joint.journal.point), axis, tangent(axis), radius
            yield Pair(
                name=f"{name}.ring{i + 1}",
                kind=RING_BORE,
                a=bearing.index,
                b=journal.index,
                geometry_a=a,
                geometry_b=b,
                clearance=joint.radial_clearance,
                law=mechanism.contact_law(joint),
            )
