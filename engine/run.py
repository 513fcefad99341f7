"""The result of a run: its status, its responses, and a certificate of its accuracy."""

from dataclasses import dataclass, field
from typing import Literal

Status = Literal["ok", "not_at_rest", "not_converged", "jammed", "diverged", "timeout", "cancelled", "invalid"]


@dataclass(frozen=True)
class Certificate:
    """The accuracy of a run as measured by the run itself.

    Attributes
    ----------
    steps : int
        Time steps made.
    time : float
        Simulated time, in the mechanism's unit.
    wall_s : float
        Real time [s].
    max_residual : float
        Largest relative residual of a friction problem (see `engine.friction`).
    max_penetration : float
        Largest penetration left after a step, in the mechanism's unit of length.
    max_violation : float
        Largest violation of an ideal joint or prescribed motion left after a step, in the same unit.
    max_created_energy : float
        Largest energy that contacts and projection created in one step, in the mechanism's unit of energy.
    created_energy : float
        Sum of the energy created over all steps that created any, in the same unit.
    settled : bool
        Whether the mechanism was at rest at the end.
    iterations : int
        Newton iterations of the friction solver, summed over all time steps.
    repeated : int
        Number of time steps that were repeated with half their length.
    """

    steps: int
    time: float
    wall_s: float
    max_residual: float
    max_penetration: float
    max_violation: float
    max_created_energy: float
    created_energy: float
    settled: bool
    iterations: int
    repeated: int


@dataclass(frozen=True)
class Run:
    """The result of a run.

    Attributes
    ----------
    status : str
        "ok", or the reason why the run does not count.
    message : str
        Empty if the status is "ok"; otherwise what went wrong, where, and what may help.
    responses : dict
        Response -> value; empty unless ``status`` is "ok".
    units : dict
        Response -> unit.
    certificate : Certificate
    measured : dict
        Response -> value measured at the end, also for a failed run.
    ranges : dict
        For each contact force read at rest: the smallest and largest value that friction allows in that pose.
    """

    status: Status
    message: str
    responses: dict[str, float]
    units: dict[str, str]
    certificate: Certificate
    measured: dict[str, float] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
