"""The play of the joints, kept apart from everything else of a mechanism.

Play is what campaigns vary most, and it is only a number added to gaps: all other arrays are those of the mechanism
without play and do not change with it.
"""

from collections.abc import Iterable
from typing import Any

from engine.arrays import Array
from engine.assembly.contacts import Pair
from engine.mechanism.base import TableModel
from engine.mechanism.joints import Joint
from engine.mechanism.models import Mechanism

MOST_SHAPES = 1000  # kept in memory
_shapes: dict[Any, Any] = {}


def without_play(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with clearance 0 in every joint; the joints are the same objects whatever their play."""
    return mechanism.model_copy(update={"joints": {name: _shape(joint) for name, joint in mechanism.joints.items()}})


def add_play(mechanism: Mechanism, faces: Iterable[tuple[int, str, str]], clearance: Array) -> None:
    """Add the play of the joints to ``clearance``, (nc,), in place.

    Each of ``faces`` is the number of a contact, its joint, and the key of its clearance.
    """
    for i, joint, key in faces:
        clearance[i] += getattr(mechanism.joints[joint], key)


def faces_with_play(pairs: Iterable[Pair]) -> tuple[tuple[int, str, str], ...]:
    """Return the number, the joint and the key of the clearance for each contact of a joint."""
    return tuple((i, *pair.play) for i, pair in enumerate(pairs) if pair.play is not None)


def _shape(joint: Joint) -> Any:
    """Return a joint with clearance 0: the same object for all joints that differ in nothing else."""
    entries = joint.__dict__
    closed = {key: 0.0 for key in joint.CLEARANCES if entries[key] is not None}
    content = type(joint), *closed, *[_exact(value) for key, value in entries.items() if key not in joint.CLEARANCES]
    shape = _shapes.get(content)
    if shape is None:
        if len(_shapes) >= MOST_SHAPES:
            _shapes.clear()
        # the shape keeps the tables of the joint alive, so that no other object can get their ids
        shape = _shapes.setdefault(content, joint.model_copy(update=closed))
    return shape


def _exact(value: Any) -> Any:
    """Return a key that only the same value has: unlike the float itself, it distinguishes -0.0 from 0.0."""
    if isinstance(value, TableModel):
        return id(value)
    if isinstance(value, tuple):
        return tuple(map(_exact, value))
    return value.hex() if isinstance(value, float) else value
