"""A window of rest so short that the mechanism counts as being at rest before its plays have closed."""

from collections.abc import Iterator

import numpy as np

from engine.arrays import Array
from engine.mechanism import Mechanism, get_value, unit_of
from engine.preflight.caution import Caution
from engine.preflight.small_motions import SmallMotions, accelerations, null_space
from engine.preflight.unloaded import values_at

SLOW = 1e6  # windows: a play that takes longer to close has no load
SHORT = 4.0  # windows: a run does not wait for a play of a joint that takes longer than this to close


def early_rest_of(mechanism: Mechanism, small: SmallMotions) -> Iterator[Caution]:
    """Yield the slowest play that is still open when the mechanism may count as being at rest.

    At the start everything is at rest. If the loads move no measured length by more than the allowed drift within the
    window, the run ends there although its bodies have only begun to slide or turn. If they do, a body that is not
    measured may still move later, when the measured ones stand still. A run waits only for bodies in flight.
    """
    rest, assembly = mechanism.simulation.rest, small.assembly
    window = max(rest.window, mechanism.simulation.step)
    touching = small.normals[assembly.state.gap <= max(mechanism.simulation.penetration, rest.drift)]
    moves, _ = accelerations(null_space(small.joints, len(small.root)), touching, small.loads(0, 0.0))
    gradients = small.derivative(lambda pose: values_at(small, pose))
    measured = gradients[assembly.model.responses.measures_motion] @ moves
    seen = assembly.state.v.any() or 0.5 * np.abs(measured).max(initial=0.0) * window**2 > rest.drift
    slowest, which = 0.0, ""
    for i, name in enumerate(assembly.contact_names):
        play, towards = float(assembly.state.gap[i]), _approach(small, i, moves)
        takes = float(np.sqrt(2.0 * play / towards)) if towards > 0.0 and play > 0.0 else 0.0
        long = SHORT * rest.window if seen and "." in name else SLOW * rest.window if seen else rest.window
        if max(long, slowest) < takes < SLOW * rest.window:
            slowest, which = takes, name
    if which:
        unit = mechanism.unit("time")
        yield Caution(
            "simulation.rest.window",
            rest.window,
            unit,
            f"the loads take {slowest:.3g} {unit} to close {_play(mechanism, which)}, and "
            + (
                "a body that nothing measures counts as moving only in flight"
                if seen
                else "nothing that is measured moves at first: the run could end before"
            ),
            f"more than {slowest:.2g} {unit}",
            "make the window longer",
        )


def _approach(small: SmallMotions, contact: int, moves: Array) -> float:
    """Return the acceleration at which the gap of a contact closes."""
    if small.is_round[contact]:
        rows = small.rounds[small.round_of == contact]
        return float(np.linalg.norm(rows @ moves))
    return float(-small.normals[contact] @ moves)


def _play(mechanism: Mechanism, contact: str) -> str:
    """Return the name of the play at a contact, with its value if it is a number in the file."""
    joint, _, face = contact.partition(".")
    if not face:
        return f"the gap of contacts.{contact}"
    key = f"joints.{joint}.{mechanism.joints[joint].face_clearance(face)}"
    return f"the play {key} = {get_value(mechanism, key):g} {unit_of(mechanism, key)}"
