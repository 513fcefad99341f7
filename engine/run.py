"""The result of a run: its status, its responses, and a certificate of what it proves of itself."""

from dataclasses import dataclass, field
from typing import Literal

Status = Literal["ok", "not_at_rest", "not_converged", "jammed", "diverged", "timeout", "cancelled", "invalid"]


@dataclass(frozen=True)
class Certificate:
    """What a run proves of itself.

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
        Largest gap violation left after a step, in the mechanism's unit of length.
    max_violation : float
        Largest violation of an ideal joint or prescribed motion left after a step, in the same unit.
    max_created_energy : float
        Largest energy that contacts and projection created in a step, in the mechanism's unit of energy.
    created_energy : float
        The sum of what they created in all steps that did, in the same unit.
    settled : bool
        Whether the mechanism was at rest at the end.
    iterations : int
        Newton steps of the friction solver, all time steps together.
    repeated : int
        Time steps that were repeated with half their length.
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
        "ok", or why the run does not count.
    message : str
        Empty when ok; otherwise what went wrong, where, and what may help.
    responses : dict
        Response -> value; empty unless ``status`` is "ok".
    units : dict
        Response -> unit.
    certificate : Certificate
    measured : dict
        Response -> value as measured at the end, also of a run that failed.
    ranges : dict
        For each contact force read at rest: the least and the largest value that friction allows at that pose.
    """

    status: Status
    message: str
    responses: dict[str, float]
    units: dict[str, str]
    certificate: Certificate
    measured: dict[str, float] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
