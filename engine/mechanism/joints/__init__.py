"""Joints between two bodies, ideal or with play; `type = "revolute"` and `type = "clearance_revolute"` share one model.

The type alone decides: an ideal joint accepts the keys of its counterpart with play and ignores them.
"""

from typing import Annotated

from pydantic import Field

from engine.mechanism.joints.base import Fixed, Joint, Planar, Spherical
from engine.mechanism.joints.journal import Cylindrical, Revolute
from engine.mechanism.joints.prismatic import Prismatic

AnyJoint = Annotated[
    Revolute | Cylindrical | Prismatic | Spherical | Fixed | Planar,
    Field(discriminator="type"),
]

__all__ = ["AnyJoint", "Cylindrical", "Fixed", "Joint", "Planar", "Prismatic", "Revolute", "Spherical"]
