"""Assembly: the description of a mechanism becomes flat arrays (`kernels.model`)."""

from dataclasses import dataclass

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.bilateral import bilateral_arrays, layout, row_runs
from engine.assembly.contacts import contact_arrays, contact_pairs
from engine.assembly.frames import order_bodies, place_bodies
from engine.assembly.ideal_joints import joint_rows
from engine.assembly.joints import joint_pairs
from engine.assembly.loads import load_arrays
from engine.assembly.motions import motion_rows
from engine.assembly.phases import phase_arrays
from engine.assembly.responses import response_arrays
from engine.assembly.start import refuse_long_step, refuse_open_joints, refuse_overlap
from engine.assembly.time_laws import time_law_arrays
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.kernels.context import RunArrays
from engine.kernels.model import BilateralState, Bodies, BroadPhase, ContactSites, Model, Scratch, State, StepStart
from engine.mechanism.models import Mechanism

__all__ = ["Assembly", "assemble"]


@dataclass(frozen=True)
class Assembly:
    """A mechanism as arrays, at its start pose.

    Attributes
    ----------
    model : Model
        Constants of the run.
    state : State
        The motion; a run changes it.
    work : Scratch
    problem : FrictionArrays
        The friction problem of a step.
    contact_names : tuple of str
        Name of each contact, in the order of the arrays.
    row_names : tuple of str
        Name of each bilateral row, in the order of the arrays.
    """

    model: Model
    state: State
    work: Scratch
    problem: FrictionArrays
    contact_names: tuple[str, ...]
    row_names: tuple[str, ...]

    @property
    def arrays(self) -> RunArrays:
        """The arrays, as the time loop takes them."""
        return RunArrays(self.model, self.state, self.work, self.problem)


def assemble(mechanism: Mechanism) -> Assembly:
    """Turn a mechanism into arrays.

    Raises
    ------
    MechanismError
        If parts overlap at the start pose, or an ideal joint is open there, or the step is longer than the horizon.
    """
    refuse_long_step(mechanism)
    order = order_bodies(mechanism)
    frames, state = place_bodies(mechanism, order)
    moving = [mechanism.bodies[name] for name in order]
    inertia = np.array([b.inertia for b in moving], float).reshape(-1, 3, 3)
    mass = np.array([b.mass for b in moving], float)
    pairs = [*joint_pairs(mechanism, frames, state.R), *contact_pairs(mechanism, frames)]
    time_laws, law_numbers = time_law_arrays(mechanism)
    joints = [*joint_rows(mechanism, frames, state.R)]
    rows = [*joints, *motion_rows(mechanism, frames, state, law_numbers)]
    at, multiplier = layout(len(moving), rows)
    contacts, laws = contact_arrays(pairs)
    names = [pair.name for pair in pairs]
    model = Model(
        bodies=Bodies(mass, inertia, np.linalg.inv(np.linalg.cholesky(inertia)) if moving else inertia, at),
        contacts=contacts,
        laws=laws,
        bilateral=bilateral_arrays(rows, len(mechanism.phases)),
        time_laws=time_laws,
        loads=load_arrays(mechanism, frames, law_numbers),
        responses=response_arrays(mechanism, frames, state, pairs),
        phases=phase_arrays(mechanism),
    )
    nc = len(pairs)
    assembly = Assembly(
        model,
        state._replace(r=np.zeros((nc, 3)), slip=np.zeros(nc), gap=np.zeros(nc)),
        _scratch(len(moving), nc, len(rows), model.responses.offset),
        _problem(model, multiplier),
        tuple(names),
        tuple(row.name for row in rows),
    )
    refuse_open_joints(mechanism, joints, state)
    refuse_overlap(mechanism, contacts, names, assembly.state, assembly.work)
    return assembly


def _problem(model: Model, multiplier: Integers) -> FrictionArrays:
    """Allocate the friction problem of a step, with its bilateral rows at their places, which never change."""
    contacts, at = model.contacts, model.bodies.at
    nb, nt = at.size, multiplier.size
    start, width = row_runs(model.bilateral, at)
    spans = [abs(at[a] - at[b]) + 5 for a, b in zip(contacts.a, contacts.b, strict=True) if a < nb and b < nb]
    spans += [place - min(start[i][width[i] > 0]) for i, place in enumerate(multiplier)]
    problem = friction_arrays(6 * nb + nt, contacts.a.size, 2, 12, int(max(spans, default=5)), nt)
    problem.bilateral.at[:], problem.bilateral.start[:], problem.bilateral.width[:] = multiplier, start, width
    return problem


def _scratch(nb: int, nc: int, nt: int, offset: Array) -> Scratch:
    """Allocate the work space of a run."""
    bodies, contacts = np.zeros((3, nb + 1, 6)), np.zeros((4, nc, 3))
    return Scratch(
        broad_phase=BroadPhase(np.zeros((nb + 1, 2)), np.zeros(nc), np.zeros(nc), np.zeros(nc, bool)),
        bilateral=BilateralState(np.zeros((3, nt)), np.zeros(nt), np.zeros((nt, 3)), np.zeros((nt, 3))),
        start=StepStart(np.zeros((nb + 1, 16)), bodies[2], contacts[3]),
        sites=ContactSites(contacts[0], np.zeros((nc, 3, 3))),
        wrench=bodies[0],
        free=bodies[1],
        gap=np.zeros(nc),
        q=contacts[1],
        shift=np.zeros(nc),
        u=contacts[2],
        active=np.zeros(nc, bool),
        chosen=np.zeros(nc, np.int64),
        values=offset.copy(),  # an angle's full turns count from its value at the start
        previous=offset.copy(),
        reported=np.full(offset.size, np.nan),
        peak=np.full(offset.size, np.nan),
        anchor=np.zeros(offset.size),
        travel=np.zeros(nc),
        vectors=np.zeros((2, 3)),
    )
