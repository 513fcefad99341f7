"""Assembly: convert the description of a mechanism to flat arrays (`kernels.model`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Block
from engine.assembly.bilateral import BilateralRow, Unknowns, bilateral_arrays, layout, motion_rows, rank_metric
from engine.assembly.bushings import bushing_arrays, bushing_rows, placed_bushings
from engine.assembly.contacts import contact_arrays, contact_pairs
from engine.assembly.couplings import coupling_pairs, gear_pairs, joint_couplings, term_arrays
from engine.assembly.frames import BodyFrame, order_bodies, place_bodies
from engine.assembly.joints import FaceWithPlay, add_play, faces_with_play, joint_pairs, joint_rows, without_play
from engine.assembly.loads import laws_over, load_arrays, phase_arrays, time_law_arrays
from engine.assembly.outlines import outline_pairs
from engine.assembly.responses import coordinate_arrays, numbers_of, reads_motions, response_arrays
from engine.assembly.rolling import rolling_pairs
from engine.assembly.solids import solid_pairs
from engine.assembly.start import free_start, refuse_long_step
from engine.assembly.table_cache import cached
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.kernels.loads import apply_loads
from engine.kernels.model import (
    FRICTION_WORK,
    JOINT_FRICTION,
    ROLLING,
    SPINNING,
    BilateralState,
    Bodies,
    BroadPhase,
    Contacts,
    ContactSites,
    Model,
    Responses,
    RunArrays,
    Scratch,
    State,
    StepStart,
)
from engine.mechanism.models import Mechanism

__all__ = ["Assembly", "assemble", "lent_assembly"]


WEIGHTED = (JOINT_FRICTION, ROLLING, SPINNING)  # which a weight presses, see `kernels.contacts.press`


@dataclass(frozen=True)
class Assembly:
    """A mechanism as arrays, at its start pose."""

    model: Model
    state: State  # a run changes it
    work: Scratch
    problem: FrictionArrays  # of a step
    contact_names: tuple[str, ...]  # in the order of the arrays, as are row_names
    row_names: tuple[str, ...]
    travel: float  # of the body that the assembly step moves farthest, see `start.free_start`; 0: as drawn
    block: Block  # in which all these arrays lie

    @property
    def arrays(self) -> RunArrays:
        """The arrays, as passed to the time loop."""
        return RunArrays(self.model, self.state, self.work, self.problem)

    def copied(self) -> "Assembly":
        """Return the same with a copy of what a run writes, but not of the friction problem, which each step writes.

        The next call overwrites the copy.
        """
        copy: RunArrays = self.block.twin().arrays
        return replace(self, state=copy.state, work=copy.work)

    def numbers(self, contact: str) -> list[int]:
        """Return the numbers of a contact by its name: one, or if it is one of two profiles, those of its points."""
        return numbers_of(self.contact_names, contact)


@dataclass(frozen=True)
class _Prepared:
    """The arrays of a mechanism without play; they are never modified, because runs get copies."""

    arrays: Block  # `RunArrays`
    contact_names: tuple[str, ...]
    row_names: tuple[str, ...]
    held: list[BilateralRow]  # the rows of the ideal joints
    faces: tuple[FaceWithPlay, ...]
    spare: list[Block]  # copies that no run uses any more; changed by all threads


def assemble(mechanism: Mechanism) -> Assembly:
    """Convert a mechanism to arrays.

    If only the play differs from an earlier mechanism, as from sample to sample, all other arrays are copied from it.
    Where parts overlap as drawn or ideal joints are open, the bodies start from the nearest pose in which that is not
    so. Raise NotAssemblable if there is none nearby, MechanismError if the step is longer than the horizon.
    """
    refuse_long_step(mechanism)
    prepared = _prepared(without_play(mechanism))
    return _at_start(mechanism, prepared, Block(prepared.arrays.arrays))


@contextmanager
def lent_assembly(mechanism: Mechanism) -> Iterator[Assembly]:
    """Yield what `assemble` returns, for the block only: the next run with other play gets the same arrays."""
    refuse_long_step(mechanism)
    prepared = _prepared(without_play(mechanism))
    try:
        copy = prepared.spare.pop()
    except IndexError:
        copy = Block(prepared.arrays.arrays)
    else:
        copy.assign(prepared.arrays)
    try:
        yield _at_start(mechanism, prepared, copy)
    finally:
        prepared.spare.append(copy)


def _at_start(mechanism: Mechanism, prepared: _Prepared, copy: Block) -> Assembly:
    """Return the assembly of a mechanism in a fresh copy of the prepared arrays."""
    arrays: RunArrays = copy.arrays
    add_play(mechanism, prepared.faces, arrays.model.contacts.clearance)
    travel = free_start(mechanism, prepared.held, prepared.contact_names, arrays)
    if arrays.model.loads.bushings.body.size:  # their forces at the start
        model, work = arrays.model, arrays.work
        apply_loads(model.bodies, model.loads, model.time_laws, arrays.state, 0, 0.0, work.wrench, work.vectors)
    return Assembly(*arrays, prepared.contact_names, prepared.row_names, travel, copy)


@cached
def _prepared(mechanism: Mechanism) -> _Prepared:
    """Assemble a mechanism without play."""
    order, frames, state = _placed(mechanism)
    moving = [mechanism.bodies[name] for name in order]
    sizes = np.array([frames[name].scale for name in order], float).reshape(-1, 1, 1)
    inertia = np.array([b.inertia for b in moving], float).reshape(-1, 3, 3) * sizes**2
    mass = np.array([b.mass for b in moving], float)
    couplings = joint_couplings(mechanism, frames, state)
    of_joints = [*joint_pairs(mechanism, frames, state.R), *coupling_pairs(couplings)]
    found = [*contact_pairs(mechanism, frames), *outline_pairs(mechanism, frames, state)]
    found += solid_pairs(mechanism, frames)
    pairs = [*of_joints, *gear_pairs(mechanism, frames, state), *found]
    pairs += rolling_pairs(mechanism, found, len(pairs) - len(found))
    time_laws, law_numbers = time_law_arrays(mechanism)
    held = [*joint_rows(mechanism, frames, state.R)]
    bushings = placed_bushings(mechanism, frames, state)
    yielding = bushing_rows(bushings, len(mechanism.phases))
    rows = [*held, *motion_rows(mechanism, frames, state, law_numbers), *yielding]
    pressed = [i for i, pair in enumerate(pairs) if pair.kind in WEIGHTED or pair.spring[0] > 0.0]
    coupled = [coupling.members for coupling in couplings]
    unknowns = layout(len(moving), rows, [(pair.a, pair.b) for pair in pairs], pressed, coupled)
    runs = max(3 if pressed else 2, *map(len, coupled), 2)  # nodes that a contact acts on
    terms = term_arrays(couplings, unknowns.coupled, runs)
    contacts, laws = contact_arrays(pairs, unknowns.contact_pair, unknowns.weight, terms, law_numbers)
    root = np.linalg.inv(np.linalg.cholesky(inertia)) if moving else inertia
    bodies = Bodies(mass, inertia, root, unknowns.body)
    model = Model(
        bodies=bodies,
        metric=rank_metric(bodies, rows),
        contacts=contacts,
        laws=laws,
        bilateral=bilateral_arrays(rows, len(mechanism.phases), reads_motions(mechanism)),
        time_laws=time_laws,
        loads=load_arrays(
            mechanism,
            frames,
            law_numbers,
            coordinate_arrays(mechanism, laws_over(mechanism), frames, state),
            bushing_arrays(bushings),
        ),
        responses=response_arrays(mechanism, frames, state, pairs, [row.name for row in rows]),
        phases=phase_arrays(mechanism),
    )
    nc = len(pairs)
    arrays = RunArrays(
        model,
        state._replace(r=np.zeros((nc, 3)), u=np.zeros((nc, 3)), slip=np.zeros(nc), gap=np.zeros(nc)),
        _scratch(len(moving), len(rows), model.responses, contacts),
        _problem(unknowns, runs),
    )
    names = tuple(pair.name for pair in pairs), tuple(row.name for row in rows)
    return _Prepared(Block(arrays), *names, held, faces_with_play(mechanism, pairs), [])


@cached
def _placed(mechanism: Mechanism) -> tuple[list[str], dict[str, BodyFrame], State]:
    """Return the moving bodies in order, the frames of all bodies, and the state at the start."""
    order = order_bodies(mechanism)
    return order, *place_bodies(mechanism, order)


def _problem(unknowns: Unknowns, runs: int) -> FrictionArrays:
    """Allocate the friction problem of a step with its bilateral rows; a contact acts on at most ``runs`` nodes."""
    nc, nt = unknowns.contact_pair.size, unknowns.at.size
    problem = friction_arrays(unknowns.system, nc, runs, bilateral=nt)
    rows = problem.bilateral
    rows.at[:], rows.node[:], rows.pair[:] = unknowns.at, unknowns.row_body, unknowns.row_pair
    rows.owner[unknowns.at] = np.arange(nt)
    return problem


def _scratch(nb: int, nt: int, responses: Responses, pairs: Contacts) -> Scratch:
    """Allocate the workspace of a run."""
    offset, nc = responses.offset, len(pairs.stiffness)
    bodies, contacts = np.zeros((3, nb + 1, 6)), np.zeros((5, nc, 3))
    return Scratch(
        broad_phase=BroadPhase(np.zeros((nb + 1, 2)), np.zeros(nc), np.zeros(nc), np.zeros(nc, bool)),
        bilateral=BilateralState(
            np.zeros((3, nt)),
            np.zeros(nt),
            np.zeros((nt, 3)),
            np.zeros((nt, 3)),
            np.zeros(nt, bool),
            *np.zeros((4, nt)),
        ),
        start=StepStart(np.zeros((nb + 1, 16)), bodies[2], contacts[3], contacts[4]),
        sites=ContactSites(contacts[0], np.zeros((nc, 3, 3))),
        wrench=bodies[0],
        free=bodies[1],
        gap=np.zeros(nc),
        q=contacts[1],
        shift=np.zeros(nc),
        begun=np.zeros(nc),
        guess=np.full(nc if pairs.hertz.any() else 0, -1.0),
        depth=np.where(pairs.stiffness > 0.0, np.inf, 0.0),
        u=contacts[2],
        active=np.zeros(nc, bool),
        chosen=np.zeros(nc, np.int64),
        values=offset.copy(),  # the full turns of an angle are counted from its value at the start
        previous=offset.copy(),
        reported=np.full(offset.size, np.nan),
        peak=np.full(offset.size, np.nan),
        impact=np.zeros(2),
        at_impact=np.zeros(offset.size, bool),
        anchor=np.zeros(offset.size),
        travel=np.zeros(nc),
        rubbed=np.zeros(nc if (responses.kind == FRICTION_WORK).any() else 0),
        touched=np.zeros(offset.size, bool),
        vectors=np.zeros((2, 3)),
    )
