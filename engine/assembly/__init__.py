"""Assembly: the one place where a description becomes flat arrays (`kernels.model`)."""

from dataclasses import dataclass

import numpy as np

from engine.assembly.contacts import contact_arrays, contact_pairs
from engine.assembly.frames import Array, order_bodies, place_bodies
from engine.assembly.ideal_joints import joint_ties
from engine.assembly.joints import joint_pairs
from engine.assembly.loads import load_arrays
from engine.assembly.responses import response_arrays
from engine.assembly.start import refuse_open_joints, refuse_overlap
from engine.assembly.ties import layout, tie_arrays
from engine.friction.arrays import FrictionArrays, friction_arrays
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
        If parts overlap at the start pose, or an ideal joint is open there.
    """
    order = order_bodies(mechanism)
    frames, state = place_bodies(mechanism, order)
    moving = [mechanism.bodies[name] for name in order]
    inertia = np.array([b.inertia for b in moving], float).reshape(-1, 3, 3)
    pairs = [*joint_pairs(mechanism, frames, state.R), *contact_pairs(mechanism, frames)]
    names = [pair.name for pair in pairs]
    contacts, laws = contact_arrays(pairs)
    ties = [*joint_ties(mechanism, frames, state.R)]
    at, _ = layout(len(moving), ties)
    mass = np.array([b.mass for b in moving], float)
    model = Model(
        bodies=Bodies(mass, inertia, np.linalg.inv(np.linalg.cholesky(inertia)) if moving else inertia, at),
        contacts=contacts,
        laws=laws,
        ties=tie_arrays(ties),
        time_laws=TimeLaws(np.zeros(1, np.int64), np.zeros(0), np.zeros((0, 4)), np.zeros((0, 3))),
        loads=load_arrays(mechanism, frames),
        responses=response_arrays(mechanism, frames, names),
        phase_duration=np.array([np.inf if p.duration is None else p.duration for p in mechanism.phases]),
    )
    nb, nc, nr = len(moving), len(names), len(mechanism.responses)
    state = state._replace(r=np.zeros((nc, 3)), slip=np.zeros(nc), gap=np.zeros(nc), speed=np.full(1, np.inf))
    assembly = Assembly(
        model,
        state,
        _scratch(nb, nc, nr),
        friction_arrays(6 * nb, nc, 2, 12, _band(contacts, nb)),
        tuple(names),
    )
    refuse_open_joints(mechanism, ties, state)
    refuse_overlap(mechanism, contacts, names, state, assembly.work)
    return assembly


def _scratch(nb: int, nc: int, nr: int) -> Scratch:
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
        values=np.zeros(nr),
        anchor=np.zeros(nr),
        travel=np.zeros(nc),
        a=np.zeros(3),
        b=np.zeros(3),
    )


def _band(contacts: Contacts, nb: int) -> int:
    """Return how far apart the velocities of one contact can lie."""
    moving = (contacts.a < nb) & (contacts.b < nb)
    return 6 * int(np.abs(contacts.a - contacts.b)[moving].max(initial=0)) + 5
