"""The arrays of a mechanism and of its motion, which the kernels read and write, and the inputs of a run and a step.

Body ``n_body`` (the last one) is the ground: it is fixed, and its frame is the world. All local geometry is given from
the centre of mass of a body in its body axes.
"""

from typing import NamedTuple

import numpy as np

from engine.friction.arrays import FrictionArrays
from engine.jit import by_address

RING_BORE, POINT_PLANE, ARC_PLANE, CYLINDER_PLANE, ON_ROUND, ON_DISC, ON_RECTANGLE, ON_BALL = range(8)
ON_TURNED, ON_EXTRUDED, ON_SURFACE = range(8, 11)
GEARS, ROUNDS, BOXES, HULLS = range(11, 15)
COUPLED, JOINT_FRICTION, ONE_WAY = range(15, 18)  # of ideal joints, the last two always closed
ROLLING, SPINNING = range(18, 20)  # what a contact resists besides sliding
POSITION, VELOCITY, ANGLE, ANGULAR_VELOCITY, GAP, SPRING_FORCE, SPRING_TORQUE, TIME, CONTACT_IMPULSE = range(9)
MOTION_TRAVEL, MOTION_WORK, IMPULSE, MEAN, BOUNCES, FRICTION_WORK, BUSHING_FORCE, BUSHING_TORQUE = range(9, 17)
# impulses of a whole step, divided by its length
CONTACT_FORCE, FRICTION_FORCE, JOINT_FORCE, MOTION_FORCE = range(17, 21)
DERIVED = 21  # computed from other responses, after the run
END, PEAK, EVENT = range(3)
SLIDE, TURN = range(2)

GEOMETRY = 13  # numbers per primitive
PIECE = 19  # numbers per line or arc of a profile


@by_address
class Bodies(NamedTuple):
    """The ``nb`` moving bodies; units of the mechanism file."""

    mass: np.ndarray  # (nb,)
    inertia: np.ndarray  # (nb, 3, 3) about the centre of mass, body axes
    inverse_root: np.ndarray  # (nb, 3, 3) L^-1 with inertia = L L'
    node: np.ndarray  # (nb,) int64, node of each body's velocities among the unknowns of a step


@by_address
class Surfaces(NamedTuple):
    """Surfaces of bicubic patches: trees of their pieces, from the centre of mass; see patches.py."""

    box: np.ndarray  # (nn, 6) middle and half sides of the axis-aligned bounding box of everything below each node
    size: np.ndarray  # (nn,) half the diagonal of that box
    after: np.ndarray  # (nn,) int64, the node after everything below; the first of a fork's two is the next node
    parent: np.ndarray  # (nn,) int64, the fork above; -1 for the root
    piece: np.ndarray  # (nn,) int64, number of a leaf's piece; -1: a fork
    slab: np.ndarray  # (np, 3, 5) a box aligned with the piece: for each of its axes, axis, middle, half the side
    coefficient: np.ndarray  # (np, 3, 4, 4) of x^i y^j in each coordinate, |x| and |y| <= 1
    bound: np.ndarray  # (np, 9) bounds of derivatives, see `engine.assembly.surface_trees`


@by_address
class Hulls(NamedTuple):
    """Convex polyhedra, from the centre of mass, and the pairs of them that can touch; see hulls.py."""

    span: np.ndarray  # (nh, 6) int64, of each: its first corner, face and edge, each with the one after its last
    vertex: np.ndarray  # (nv, 3)
    face: np.ndarray  # (nf, 4) normal out of it, and its height along that over the centre of mass
    ring: np.ndarray  # (nf, 2) int64, the first of the corners around it, and the one after the last; equal: unbounded
    corner: np.ndarray  # (nk,) int64, numbers of corners of its polyhedron, counterclockwise around each face
    edge: np.ndarray  # (ne, 4) int64, numbers of its two corners and two faces, those of its polyhedron; -1: none
    of: np.ndarray  # (nc, 2) int64, the polyhedra of a contact's sides; -1: none
    pair: np.ndarray  # (nc,) int64, its row of what was found
    found: np.ndarray  # (np, FOUND) pose of a pair, and what was found there; written by the run, as are the next
    placed: np.ndarray  # (largest nv, 3) workspace
    placed_face: np.ndarray  # (largest nf, 4)
    polygon: np.ndarray  # (2, corners, 3)


@by_address
class Terms(NamedTuple):
    """The ``nk`` terms of all couplings of joint coordinates, see couplings.py."""

    first: np.ndarray  # (couplings + 1,) int64, first term of each coupling
    kind: np.ndarray  # (nk,) int64 SLIDE or TURN
    body: np.ndarray  # (nk, 2) int64, of the joint's first and second side
    geometry: np.ndarray  # (nk, 9) see bilateral.py
    factor: np.ndarray  # (nk,)
    start: np.ndarray  # (nk,) displacement at the start
    angle: np.ndarray  # (nk,) rad since the start, when it was last measured; written by the run
    place: np.ndarray  # (nk, 2) int64, which of the coupling's members the two bodies are; -1: the ground
    member: np.ndarray  # (couplings, runs) int64, its moving bodies; -1: no more
    pair: np.ndarray  # (couplings, runs, runs) int64, first piece of the system for each two of them


@by_address
class Contacts(NamedTuple):
    """The ``nc`` potential contacts."""

    kind: np.ndarray  # (nc,) int64
    a: np.ndarray  # (nc,) int64, the body pushed along +N
    b: np.ndarray  # (nc,) int64
    geometry_a: np.ndarray  # (nc, GEOMETRY) see gaps.py
    geometry_b: np.ndarray  # (nc, GEOMETRY)
    clearance: np.ndarray  # (nc,) radial clearance of a ring in a bore; minus the contact offset elsewhere
    reach: np.ndarray  # (nc,) distance of the farthest point of side a's primitive from its body's centre of mass
    pair: np.ndarray  # (nc,) int64, first piece of the two bodies in the system of a step, see `engine.friction.blocks`
    profile: np.ndarray  # (nc, 2) int64, first piece of side b's profile, and the piece after its last
    piece: np.ndarray  # (np, PIECE) see solids.py
    surface: np.ndarray  # (nc,) int64, first node of side b's surface; -1: it has none
    coupling: np.ndarray  # (nc,) int64, the coupling of which it is a flank; -1: none
    flank: np.ndarray  # (nc,) 1 or -1, the side of the coordinate that it limits, or of the teeth of gears
    terms: Terms
    bound: np.ndarray  # (nc,) largest force, or torque, of a JOINT_FRICTION, whatever presses; 0: that of a cone
    breakaway: np.ndarray  # (nc,) the same of one that sticks, at least as large
    partner: np.ndarray  # (nc,) int64, the contact whose rolling or spinning it resists; -1: none; (0,) if none does
    arm: np.ndarray  # (nc,) largest moment against it per normal force; 0: none; (0,) if none does
    grain: (
        np.ndarray
    )  # (nc, 6) direction in a body's axes, body, lengths of T1 and T2, see grain.py; (0, 6) without any
    weight: np.ndarray  # (nc, 3) int64, node of a JOINT_FRICTION's weight or a spring (-1: none); pieces with a, b
    stiffness: np.ndarray  # (nc,) force per penetration; 0: rigid, see compliance.py
    damping: np.ndarray  # (nc,) force per closing speed, of contacts with a stiffness
    hertz: np.ndarray  # (nc,) bool, whether the stiffness is the force per penetration to the power 3/2
    surfaces: Surfaces
    hulls: Hulls | None  # None: there are none, and kernels are compiled without them


@by_address
class Laws(NamedTuple):
    """The contact laws."""

    mu: np.ndarray  # (nc,)
    restitution: np.ndarray  # (nc,)
    sticking: np.ndarray  # (nc,) coefficients of friction of contacts that stick; (0,) if all are mu
    table: np.ndarray  # (nc,) int64, number of the table of factors of mu over the speed, -1: none; (0,) without any


@by_address
class TimeLaws(NamedTuple):
    """Functions of time: cubic pieces plus a sine."""

    first: np.ndarray  # (nl + 1,) int64, first piece of each law
    time: np.ndarray  # (np,) start of each piece; before the first and after the last, a law is constant
    piece: np.ndarray  # (np, 4) c0 + c1 s + c2 s^2 + c3 s^3, s from the start of the piece
    sine: np.ndarray  # (nl, 3) amplitude, angular frequency, phase: a sin(w t + phi) - a sin(phi)
    since: np.ndarray  # (nl,) int64, the phase at whose start the law's time begins
    begun: np.ndarray  # (n_phase,) start time of each phase; inf before it; written by the run


@by_address
class BilateralRows(NamedTuple):
    """Bilateral constraints, one row each: ideal joints and prescribed motions (eqs. 14-16)."""

    kind: np.ndarray  # (nt,) int64
    a: np.ndarray  # (nt,) int64
    b: np.ndarray  # (nt,) int64
    geometry: np.ndarray  # (nt, 9) see bilateral.py
    arm: np.ndarray  # (nt,) length that multiplies a TURN's angle; 1 for a SLIDE
    law: np.ndarray  # (nt,) int64 number of its target's time law, -1: none
    phase: np.ndarray  # (nt, n_phase) bool, whether it acts
    offset: np.ndarray  # (nt,) target where the law is 0 [length or rad]; start of the motion; written by the run
    acts: np.ndarray  # (nt,) bool, in the current phase; written by the run
    closed: np.ndarray  # (1,) bool, whether joints and motions close loops; otherwise no row is redundant
    read: np.ndarray  # (1,) bool, whether forces or work of motions are read; otherwise no step computes them
    yielding: np.ndarray  # (ny,) int64, the rows of bushings, which never act but within a step, see bushings.py
    coordinate: np.ndarray  # (ny,) int64, number of the coordinate of each, six per bushing


@by_address
class Bushings(NamedTuple):
    """The ``ny`` bushings, see bushings.py; the last five are written by the run."""

    body: np.ndarray  # (ny, 2) int64
    place: np.ndarray  # (ny, 2, 3) the points on both
    axes: np.ndarray  # (ny, 9) x, y, z of its frame, fixed in the first body
    turn: np.ndarray  # (ny, 4) quaternion; b's attitude times it equals a's where there is no torque
    law: np.ndarray  # (ny, 12) stiffnesses along and about x, y, z, then dampings
    point: np.ndarray  # (ny, 3) b's point in the world
    way: np.ndarray  # (ny, 6, 3) directions of the rates of its coordinates, in the world
    off: np.ndarray  # (ny, 6) its coordinates: displacements, and the rotation vector
    effort: np.ndarray  # (ny, 6) forces and torques along these directions
    anchor: np.ndarray  # (ny, 6) the coordinates at the start of the current pause


@by_address
class Loads(NamedTuple):
    """Forces and torques."""

    gravity: np.ndarray  # (3,)
    spring_body: np.ndarray  # (ns, 2) int64
    spring_point: np.ndarray  # (ns, 6) the two points
    spring_law: np.ndarray  # (ns, 5) stiffness, free length, damping, preload, 1: only pushes, -1: only pulls, 0: both
    spring_table: np.ndarray  # (ns, 2) int64, numbers of the laws of its force over its length and its rate; -1: none
    torsion_body: np.ndarray  # (nt, 2) int64
    torsion_axis: np.ndarray  # (nt, 3) fixed in the first body
    torsion_turn: np.ndarray  # (nt, 4) quaternion; b's attitude times it equals a's where the angle is 0
    torsion_law: np.ndarray  # (nt, 4) stiffness, angle without torque, damping, angle at the start
    torsion_table: np.ndarray  # (nt, 2) int64, the same of its torque over its angle and its rate
    action_first: np.ndarray  # (ns + nt + 1,) int64, first action of each spring; without any it acts along its line
    action_body: np.ndarray  # (na,) int64
    action_vector: np.ndarray  # (na, 9) point, force, torque in body axes, for a spring force or torque of 1
    force_body: np.ndarray  # (nf,) int64
    force_vector: np.ndarray  # (nf, 9) point, force, torque
    force_in_body: np.ndarray  # (nf,) bool: components in body axes
    force_law: np.ndarray  # (nf,) int64, number of the time law that multiplies it; -1: none
    force_phase: np.ndarray  # (nf, n_phase) bool
    force_over: np.ndarray  # (nf,) int64, what its law depends on, one of the following; -1: time
    force_against: np.ndarray  # (nf,) int64, the body that bears the reaction; -1: none
    over_kind: np.ndarray  # (nm,) int64 POSITION, VELOCITY, ANGLE or ANGULAR_VELOCITY
    over_body: np.ndarray  # (nm, 3) int64, see responses.py, as is over_point
    over_point: np.ndarray  # (nm, 12)
    over_offset: np.ndarray  # (nm,)
    over_value: np.ndarray  # (nm,) an angle when it was last measured, without its offset; written by the run
    over_work: np.ndarray  # (3,) workspace
    bushings: Bushings


@by_address
class Responses(NamedTuple):
    """The responses and their instants; responses.py describes the rows of ``body`` and ``point``."""

    kind: np.ndarray  # (nr,) int64
    body: np.ndarray  # (nr, 3) int64
    point: np.ndarray  # (nr, 12)
    offset: np.ndarray  # (nr,)
    averaged_over: np.ndarray  # (nr,) time constant of the mean of a force; 0: the force of the last step
    window: np.ndarray  # (nr, 2) of an IMPULSE or a MEAN: begin and end, since from_phase began
    measures_motion: np.ndarray  # (nr,) bool: a length or angle at the end of the run, which is constant at rest
    at: np.ndarray  # (nr,) int64 END, PEAK or EVENT
    from_phase: np.ndarray  # (nr,) int64, the phase at whose start the search for peaks and events begins
    to_phase: np.ndarray  # (nr,) int64, the phase at whose end it ends
    trigger: np.ndarray  # (nr,) int64, the response whose crossing or peak determines the instant
    limit: np.ndarray  # (nr, 2) limit of the trigger; side: 1 above it or a maximum, -1 below it or a minimum


@by_address
class Phases(NamedTuple):
    """The parts of a run, in order."""

    duration: np.ndarray  # (n_phase,) longest time; inf: until its event, or until rest
    trigger: np.ndarray  # (n_phase,) int64, the response whose crossing ends it; -1: none
    limit: np.ndarray  # (n_phase, 2) limit of the trigger; side: 1 above it, -1 below it
    damping: np.ndarray  # (n_phase,) rate [1/time]


@by_address
class Model(NamedTuple):
    """The constants of a run."""

    bodies: Bodies
    metric: Bodies  # the same with mass 1 and a radius of gyration that no joint exceeds, see `redundancy`
    contacts: Contacts
    laws: Laws
    bilateral: BilateralRows
    time_laws: TimeLaws
    loads: Loads
    responses: Responses
    phases: Phases


@by_address
class State(NamedTuple):
    """The motion at one instant; the last body is the ground."""

    x: np.ndarray  # (nb + 1, 3) centres of mass
    p: np.ndarray  # (nb + 1, 4) unit quaternions
    R: np.ndarray  # (nb + 1, 3, 3) their rotations
    v: np.ndarray  # (nb + 1, 6) velocity of the centre of mass (world), angular velocity (body axes)
    r: np.ndarray  # (nc, 3) contact impulses of the last step, (N, T1, T2)
    u: np.ndarray  # (nc, 3) relative velocities at its end, where r is not 0
    slip: np.ndarray  # (nc,) relative tangential speed of the contacts that carried load in the last step
    gap: np.ndarray  # (nc,) at the end of the step; for contacts that are not near, a lower bound


@by_address
class BroadPhase(NamedTuple):
    """Data of the broad phase, which finds the near contacts, see broad_phase.py."""

    speed: np.ndarray  # (nb + 1, 2) speed and angular speed of each body
    budget: np.ndarray  # (nc,) distance that the bodies can still move before the gap can have closed
    lever: np.ndarray  # (nc,) lever arm of body b's angular speed in that distance
    near: np.ndarray  # (nc,) bool, updated at this pose


@by_address
class BilateralState(NamedTuple):
    """The bilateral rows at one pose, see bilateral.py."""

    target: np.ndarray  # (3, nt) at the start of the step, at its end, and the rate at its end
    violation: np.ndarray  # (nt,) a length, or its rate
    point: np.ndarray  # (nt, 3)
    direction: np.ndarray  # (nt, 3)
    redundant: np.ndarray  # (nt,) bool, others hold it already, see `engine.friction.redundancy`
    impulse: np.ndarray  # (nt,) on b along the direction, in the last step
    work: np.ndarray  # (nt,) of that impulse
    force: np.ndarray  # (nt,) of a motion in the last step in which its speed did not jump; the torque of a TURN
    speed: np.ndarray  # (nt,) rate of a motion at the start of the step


@by_address
class StepStart(NamedTuple):
    """The state at the start of a step, to which a repeated step returns."""

    pose: np.ndarray  # (nb + 1, 16) position, quaternion and rotation
    v: np.ndarray  # (nb + 1, 6)
    r: np.ndarray  # (nc, 3)
    u: np.ndarray  # (nc, 3)


@by_address
class ContactSites(NamedTuple):
    """Points and frames of the contacts at one pose, in the world."""

    point: np.ndarray  # (nc, 3) contact points
    frame: np.ndarray  # (nc, 3, 3) rows N, T1, T2


@by_address
class Scratch(NamedTuple):
    """Workspace of a step."""

    broad_phase: BroadPhase
    bilateral: BilateralState
    start: StepStart
    sites: ContactSites
    wrench: np.ndarray  # (nb + 1, 6) force and torque about the centre of mass, world axes
    free: np.ndarray  # (nb + 1, 6) twists at the end without contact impulses; displacement in projection
    gap: np.ndarray  # (nc,) gaps at the pose within the step
    q: np.ndarray  # (nc, 3) relative velocities without impulses
    shift: np.ndarray  # (nc,) the impact law's addition to the normal component of q
    begun: np.ndarray  # (nc,) gap at the start of the step, of contacts with a stiffness
    guess: np.ndarray  # (nc,) overlap at which the law of Hertz is a line in the step; -1: none yet; (0,) without Hertz
    depth: np.ndarray  # (nc,) how far contacts may penetrate without being projected; 0: rigid ones
    u: np.ndarray  # (nc, 3) relative velocities
    active: np.ndarray  # (nc,) bool
    chosen: np.ndarray  # (nc,) int64, contacts of the friction problem
    values: np.ndarray  # (nr,) measured at the end of the last step
    previous: np.ndarray  # (nr,) measured at its start
    reported: np.ndarray  # (nr,) the responses, each at its own instant
    peak: np.ndarray  # (nr,) largest or smallest value so far of the response whose peak is sought
    impact: np.ndarray  # (2,) largest impulse of an impact divided by the step: in the last step, in the one before
    at_impact: np.ndarray  # (nr,) bool, whether the reported value is a force at an impact
    anchor: np.ndarray  # (nr,) values at the start of the current pause
    travel: np.ndarray  # (nc,) slip since then
    rubbed: np.ndarray  # (nc,) energy that friction has taken in the last step; (0,) if it is not read
    touched: np.ndarray  # (nr,) bool, whether the contact of BOUNCES has carried load since it was last open
    vectors: np.ndarray  # (2, 3)


# The inputs of a run and of a step, and the result of a step.


@by_address
class Control(NamedTuple):
    """Settings of a run; lengths and times in the mechanism's units."""

    step: float  # the shortest step; the only one unless longest is larger
    longest: float  # longest step
    travel: float  # the step doubles while no body's mass moves farther than this per step (root mean square)
    theta: float  # share of the step after the instant at which loads and contacts are evaluated
    slow: float  # theta is 1, without restitution, while no body is faster than this, in a phase that ends at rest
    plain: bool  # Moreau-Jean's scheme without projection
    horizon: float  # longest simulated time
    tolerance: float  # relative residual of every friction problem
    penetration: float  # largest penetration allowed after a step
    violation: float  # largest violation of an ideal joint or prescribed motion allowed after a step
    window: float  # the mechanism is at rest once nothing measured has moved for this time
    drift: float  # length by which something may move in that time and still count as unmoved
    full_horizon: bool  # go on to the horizon even at rest
    pauses: bool  # return at the end of a phase at rest in which forces are read, so that they can be balanced
    lost: float  # displacement of a body in a step with which a run has lost the mechanism


class RunArrays(NamedTuple):
    """All arrays of a run."""

    model: Model
    state: State
    work: Scratch
    problem: FrictionArrays


class StepContext(NamedTuple):
    """Everything that one time step reads and writes; created anew for each step."""

    model: Model
    state: State
    work: Scratch
    problem: FrictionArrays
    control: Control
    phase: int  # number of the current phase
    t: float  # time at the start of the step, since the start of the run
    h: float  # length of the step
    theta: float  # share of the step after the instant of loads and contacts: 1/2 is second order, 1 damps
    bounce: float  # factor of the coefficients of restitution


class StepResult(NamedTuple):
    """The outcome of one time step."""

    status: int  # of the friction solver: CONVERGED or NOT_CONVERGED
    residual: float  # largest relative residual of the step's friction problems
    penetration: float  # largest remaining penetration
    contact: int  # number of the contact with that penetration, or with the largest residual if not converged; -1: none
    violation: float  # largest remaining joint violation that counts, see `projection.project_positions`
    widest: float  # largest remaining joint violation, also of rows that others hold already
    created: float  # energy that contacts and projection created; negative: dissipated
    lost: float  # energy that joints, lasting contacts and projection removed, see `energy`; negative: added
    braked: float  # the part of it that joints removed, if closed loops hold anything twice; otherwise 0
    speed: float  # of the fastest body at the end of the step, see `motion.fastest_body`
    spin: float  # largest angular speed of a body at the end of the step
    iterations: int  # of the friction solver
