"""Cautions about what is drawn and set: springs pressed far at the start, and too little time."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from engine.mechanism import Mechanism
from engine.preflight.plausibility import Caution

if TYPE_CHECKING:  # slow to import
    from engine.assembly import Assembly

PRESSED = 0.01  # share of the mechanism's extent by which a contact with a stiffness may overlap as drawn


def time_cautions(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions if the phases last longer than a run may, or the longest step is shorter than the shortest."""
    sim, unit = mechanism.simulation, mechanism.unit("time")
    lasts = sum(phase.duration or 0.0 for phase in mechanism.phases if phase.until is None)
    if lasts > sim.horizon * (1.0 + 1e-9):
        text = f"the phases of a given duration last {lasts:g} {unit} together, so that no run comes to its end"
        yield Caution("simulation.horizon", sim.horizon, unit, text, f"more than {lasts:g} {unit}", "raise it")
    if sim.adaptive and sim.adaptive.longest < sim.step:
        text = f"shorter than simulation.step = {sim.step:g}, which is the shortest step, so that no step grows"
        customary = f"more than {sim.step:g} {unit}"
        yield Caution("simulation.adaptive.longest", sim.adaptive.longest, unit, text, customary, "exchange the two")


def pressed_starts(mechanism: Mechanism, assembly: "Assembly") -> Iterator[Caution]:
    """Yield a caution for each contact with a stiffness whose parts overlap far as drawn, as beyond a turned plane."""
    places = np.concatenate([assembly.state.x[:-1], assembly.work.sites.point])
    extent = 2.0 * float(np.linalg.norm(places - places.mean(axis=0), axis=1).max(initial=0.0))
    force, length = mechanism.unit("force"), mechanism.unit("length")
    for name, contact in mechanism.contacts.items():
        stiffness = contact.spring[0]
        if not stiffness:
            continue
        overlap = max(-float(assembly.state.gap[i]) for i in assembly.numbers(name))
        if overlap > PRESSED * extent and overlap > contact.offset:
            presses = stiffness * overlap ** (1.5 if contact.hertz_stiffness else 1.0)
            text = f"its parts overlap by {overlap:.4g} {length} as drawn, where it presses with {presses:.4g} {force}"
            remedy = "move a part, turn a normal that points into the material, or let it be if that is the preload"
            yield Caution(f"contacts.{name}", text=text, remedy=remedy)
