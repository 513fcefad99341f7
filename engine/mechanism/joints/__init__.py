"""Joints between two bodies, ideal or with play: `type = "revolute"` and `type = "clearance_revolute"` are one table.

The word alone decides: an ideal joint takes the keys of its form with play, and does not look at them.
"""

from typing import Annotated

from pydantic import Field

from engine.mechanism.joints.base import Joint
from engine.mechanism.joints.ideal import Fixed, Planar
from engine.mechanism.joints.journal import Cylindrical, Revolute
from engine.mechanism.joints.prismatic import Prismatic
from engine.mechanism.joints.spherical import Spherical

AnyJoint = Annotated[
    Revolute | Cylindrical | Prismatic | Spherical | Fixed | Planar,
    Field(discriminator="type"),
]

__all__ = ["AnyJoint", "Cylindrical", "Fixed", "Joint", "Planar", "Prismatic", "Revolute", "Spherical"]
