"""Joints between two bodies, ideal or with play; `type = "revolute"` and `type = "clearance_revolute"` share one model.

The type alone decides: an ideal joint accepts the keys of its counterpart with play and ignores them.
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
