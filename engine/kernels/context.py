"""The inputs of a run and of a step, and the result of a step."""

from typing import NamedTuple

from engine.friction.arrays import FrictionArrays
from engine.jit import by_address
from engine.kernels.model import Model, Scratch, State


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
    residual: float  # relative residual of the step's last friction problem, which contains the earlier ones' contacts
    penetration: float  # largest remaining penetration
    contact: int  # number of the contact with that penetration, or with the largest residual if not converged; -1: none
    violation: float  # largest remaining joint violation
    created: float  # energy that contacts and projection created; negative: dissipated
    speed: float  # of the fastest body at the end of the step, see `motion.fastest_body`
    iterations: int  # of the friction solver
