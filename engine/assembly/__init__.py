"""Assembly: the one place where a description becomes flat arrays (`kernels.model`)."""

from dataclasses import dataclass

import numpy as np

from engine.assembly.contacts import contact_arrays, contact_pairs
from engine.assembly.frames import Array, order_bodies, place_bodies
from engine.assembly.joints import joint_pairs
from engine.assembly.loads import load_arrays
from engine.assembly.responses import response_arrays
from engine.assembly.ties import Tie, layout, tie_arrays
from engine.errors import MechanismError
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.kernels.gaps import find_contacts
from engine.kernels.model import Bodies, Contacts, Model, Scratch, State, TimeLaws
from engine.mechanism.models import Mechanism

__all__ = ["Array", "Assembly", "assemble"]


@dataclass(frozen=True)
class Assembly:
    """A mechanism as arrays, at its start pose."""

    model: Model
    state: State
    work: Scratch
    problem: FrictionArrays
    contact_names: tuple[str, ...]


def assemble(mechanism: Mechanism) -> Assembly:
    """Turn a mechanism into arrays.

    Raises
    ------
    MechanismError
        If parts interpenetrate at the start pose.
    """
    order = order_bodies(mechanism)
    frames, state = place_bodies(mechanism, order)
    moving = [mechanism.bodies[name] for name in order]
    inertia = np.array([b.inertia for b in moving], float).reshape(-1, 3, 3)
    pairs = [*joint_pairs(mechanism, frames), *contact_pairs(mechanism, frames)]
    names = [pair.name for pair in pairs]
    contacts, laws = contact_arrays(pairs)
    ties: list[Tie] = []
    at, _ = layout(len(moving), ties)
    mass = np.array([b.mass for b in moving], float)
    model = Model(
        bodies=Bodies(mass, inertia, np.linalg.inv(np.linalg.cholesky(inertia)) if moving else inertia, at),
        contacts=contacts,
        laws=laws,
        ties=tie_arrays(ties),
        time_laws=TimeLaws(np.zeros(1, np.int64), np.zeros(0), np.zeros((0, 4)), np.zeros((0, 3))),
        loads=load_arrays(mechanism, frames),
        responses=response_arrays(mechanism, frames, state, names),
        phase_duration=np.array([np.inf if p.duration is None else p.duration for p in mechanism.phases]),
    )
    nb, nc = len(moving), len(names)
    state = state._replace(r=np.zeros((nc, 3)), slip=np.zeros(nc), gap=np.zeros(nc), speed=np.full(1, np.inf))
    assembly = Assembly(
        model,
        state,
        _scratch(nb, nc, model.responses.offset),
        friction_arrays(6 * nb, nc, 2, 12, _band(contacts, nb)),
        tuple(names),
    )
    _refuse_interpenetration(mechanism, assembly)
    return assembly


def _scratch(nb: int, nc: int, offset: Array) -> Scratch:
    """Allocate the work space of a run."""
    bodies, contacts = np.zeros((2, nb + 1, 6)), np.zeros((3, nc, 3))
    return Scratch(
        wrench=bodies[0],
        free=bodies[1],
        gap=np.zeros(nc),
        point=contacts[0],
        frame=np.zeros((nc, 3, 3)),
        q=contacts[1],
        shift=np.zeros(nc),
        u=contacts[2],
        active=np.zeros(nc, bool),
        chosen=np.zeros(nc, np.int64),
        values=offset.copy(),  # of an angle at the start: its full turns count from there
        anchor=np.zeros(offset.size),
        travel=np.zeros(nc),
        a=np.zeros(3),
        b=np.zeros(3),
    )


def _refuse_interpenetration(mechanism: Mechanism, assembly: Assembly) -> None:
    """Raise if any pair of the assembled parts overlaps at the start."""
    gap = assembly.state.gap
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, gap, work.point, work.frame)
    allowed = mechanism.simulation.penetration
    faults = [
        _overlap(mechanism, name, float(g), assembly.model.contacts.clearance[i])
        for i, (name, g) in enumerate(zip(assembly.contact_names, gap, strict=True))
        if not g >= -allowed
    ]
    if faults:
        lines = "\n".join(f"  {fault}" for fault in dict.fromkeys(faults))  # the rings of a joint share a fault
        raise MechanismError(f"{mechanism.name}: parts overlap at the start pose\n{lines}")


def _overlap(mechanism: Mechanism, name: str, gap: float, clearance: float) -> str:
    """Say which pair overlaps and what would be allowed."""
    unit = mechanism.unit("length")
    joint = name.split(".")[0]
    if joint in mechanism.joints:
        return (
            f"joints.{joint}.radial_clearance = {clearance:.6g} {unit}: the journal lies {clearance - gap:.6g} {unit} "
            f"off its bearing's centre at the start; allowed: at least {clearance - gap:.6g} {unit}, or move the bodies"
        )
    return (
        f"contacts.{name}: gap {gap:.6g} {unit} at the start; allowed: >= 0; move the bodies, the features or `offset`"
    )


def _band(contacts: Contacts, nb: int) -> int:
    """Return how far apart the velocities of one contact can lie."""
    moving = (contacts.a < nb) & (contacts.b < nb)
    return 6 * int(np.abs(contacts.a - contacts.b)[moving].max(initial=0)) + 5
