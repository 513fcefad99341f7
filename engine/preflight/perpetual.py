"""Motions that lose no energy and so never come to rest: undamped oscillations on springs and in gravity."""

from collections.abc import Iterator

import numpy as np

from engine.assembly.frames import order_bodies
from engine.mechanism import Mechanism
from engine.preflight.caution import Caution
from engine.preflight.small_motions import NOTHING, SmallMotions, accelerations, null_space
from engine.preflight.unloaded import values_at


def perpetual_of(mechanism: Mechanism, small: SmallMotions) -> Iterator[Caution]:
    """Yield cautions about bodies that move from the start, are measured at the end, and lose no energy meanwhile."""
    if mechanism.motions or any(phase.damping for phase in mechanism.phases):
        return
    assembly, names = small.assembly, order_bodies(mechanism)
    loads = small.loads(0, 0.0)
    moves, _ = accelerations(null_space(small.joints, len(small.root)), small.normals, loads)
    start = assembly.state.v[:-1].copy()
    start[:, 3:] = np.einsum("bij,bj->bi", assembly.state.R[:-1], start[:, 3:])
    starts = np.linalg.solve(small.root, start.ravel()) if start.any() else start.ravel()
    gradients = small.derivative(lambda pose: values_at(small, pose))[assembly.model.responses.measures_motion]
    for group in _linked(mechanism):
        if any(_dissipates(mechanism, body) for body in group):
            continue
        own = np.isin(np.repeat(np.array(names), 6), sorted(group))
        goes = np.abs(gradients @ np.where(own, moves, 0.0)).max(initial=0.0)
        flies = np.abs(gradients @ np.where(own, starts, 0.0)).max(initial=0.0)
        size = np.linalg.norm(gradients) if gradients.size else 0.0
        if goes > NOTHING * size * np.linalg.norm(loads) or flies > NOTHING * size * np.linalg.norm(starts):
            yield Caution(
                f"bodies.{min(group, key=names.index)}",
                None,
                "1",
                "no contact, damper or damping of the phase takes energy from its motion: it never comes to rest",
                "",
                "add what damps it, or give the phase a duration if the motion is the result",
            )


def _linked(mechanism: Mechanism) -> list[set[str]]:
    """Return the groups of moving bodies that are linked by joints, contacts, springs or dampers."""
    groups = [{name} for name, body in mechanism.bodies.items() if not body.fixed]
    pairs = [{side.body for side in pair.sides} for pair in (*mechanism.joints.values(), *mechanism.contacts.values())]
    for link in (*mechanism.springs.values(), *mechanism.dampers.values()):
        pairs.append({end if isinstance(end, str) else end.body for end in (link.a, link.b)})
    for pair in pairs:
        met = [group for group in groups if group & pair]
        groups = [group for group in groups if not group & pair] + ([set().union(*met)] if met else [])
    return groups


def _dissipates(mechanism: Mechanism, body: str) -> bool:
    """Return whether a contact, a joint with play or a damper acts on a body."""
    touches = [joint for joint in mechanism.joints.values() if not joint.ideal] + [*mechanism.contacts.values()]
    if any(side.body == body for pair in touches for side in pair.sides):
        return True
    damped = [link for link in (*mechanism.springs.values(), *mechanism.dampers.values()) if link.damping]
    return any(body == (end if isinstance(end, str) else end.body) for link in damped for end in (link.a, link.b))
