"""The result of a run: its status, its responses, and a certificate of its accuracy."""

from dataclasses import dataclass, field
from html import escape
from typing import Literal

Status = Literal["ok", "not_at_rest", "not_converged", "jammed", "diverged", "timeout", "cancelled", "invalid"]

LARGEST_TURN = 0.5  # rad, of a body in a step: the gyroscopic moment is that of the middle of the step
_SHOWN = 4  # responses in a line
MUCH_LOST = 0.1  # share of the largest kinetic energy


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
        Largest violation of an ideal joint or prescribed motion left after a step, in the same unit; also of what
        closed loops hold twice, where `simulation.joint_violation` does not limit it.
    max_created_energy : float
        Largest energy that contacts and projection created in one step, in the mechanism's unit of energy.
    created_energy : float
        Sum of the energy created over all steps that created any, in the same unit.
    max_lost_energy : float
        Largest energy that one step lost to its own length: by joints, lasting contacts, bushings and projection, in
        the same unit. What friction, impacts and dampers dissipate is not lost.
    lost_energy : float
        Sum of the energy lost over all steps that lost any, in the same unit.
    max_kinetic_energy : float
        Largest kinetic energy of all bodies together, in the same unit; at least that of bodies as slow as the test of
        rest can tell.
    max_turn : float
        Largest angle by which a body turned in one step [rad]; above 0.5 its spin is not accurate.
    settled : bool
        Whether the mechanism was at rest at the end.
    iterations : int
        Newton iterations of the friction solver, summed over all time steps.
    repeated : int
        Number of time steps that were repeated with half their length.
    start_travel : float
        How far the assembly step moved a body from its drawn place: the root mean square over its mass, of the body
        that moved farthest, in the mechanism's unit of length. 0 where the run starts as drawn.
    """

    steps: int
    time: float
    wall_s: float
    max_residual: float
    max_penetration: float
    max_violation: float
    max_created_energy: float
    created_energy: float
    max_lost_energy: float
    lost_energy: float
    max_kinetic_energy: float
    max_turn: float
    settled: bool
    iterations: int
    repeated: int
    start_travel: float = 0.0

    def doubts(self) -> list[str]:
        """Return what may be inaccurate in the motion although every step met its tolerances; empty: nothing."""
        found = []
        if self.max_turn > LARGEST_TURN:
            found.append(
                f"a body turns by {self.max_turn:.3g} rad in a step, and its spin is not accurate above"
                f" {LARGEST_TURN:g} rad; shorten simulation.step"
            )
        if not self.settled and self.lost_energy > MUCH_LOST * self.max_kinetic_energy:
            found.append(
                f"the steps lost {100 * self.lost_energy / self.max_kinetic_energy:.3g} % of the largest kinetic"
                " energy to their own length (lost_energy); shorten simulation.step"
            )
        return found


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
    at_impact : tuple of str
        Responses that are forces of an impact, or were read at the peak of one: they depend on the length of the step,
        and are no property of the mechanism.
    ambiguous : bool
        Whether motion would have solved the equations as well where the mechanism rests, or rested between two phases.
    """

    status: Status
    message: str
    responses: dict[str, float]
    units: dict[str, str]
    certificate: Certificate
    measured: dict[str, float] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    at_impact: tuple[str, ...] = ()
    ambiguous: bool = False

    def __repr__(self) -> str:
        """Return the status and the first responses in a line."""
        shown = [f"{name} = {self._with_unit(name)}" for name in list(self.responses)[:_SHOWN]]
        more = len(self.responses) - len(shown)
        words = ", ".join(shown + ([f"and {more} more"] if more else [])) or self.message[:200]
        return f"<Run {self.status}: {words}>" if words else f"<Run {self.status}>"

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: status, responses, remarks."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(self._with_unit(name))}</td></tr>" for name in self.responses
        )
        said = "".join(f"<p>{escape(text)}</p>" for text in (self.message, *self.remarks) if text)
        return f"<p>{escape(self.status)}</p><table>{rows}</table>{said}"

    def _with_unit(self, name: str) -> str:
        unit = self.units.get(name, "")
        return f"{self.responses[name]:.6g}{'' if unit in ('', '1') else f' {unit}'}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know about the values of the run, in sentences."""
        said = [
            f"{name}: a contact closed in the step of this force, so it is its impulse divided by the step, and no "
            'property of the mechanism; measure the impulse (type = "contact_impulse"), the mean over a time '
            "(averaged_over), or drive so slowly that nothing strikes"
            for name in self.at_impact
        ]
        if self.ambiguous:
            said.append(
                "friction holds what would move as well: with these loads rest and motion both solve the equations, "
                "and the mechanism stayed at rest; whether it holds depends on how it came there"
            )
        return tuple(said)
