"""One run of one mechanism: from a description and a set of values to responses and a certificate.

The compiled kernels are imported by the functions that need them: Numba alone takes longer to load than a description.
"""

import math
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from engine.mechanism import Mechanism, set_values

if TYPE_CHECKING:
    from engine.assembly import Assembly

Status = Literal["ok", "not_converged", "diverged", "timeout", "invalid"]


@dataclass(frozen=True)
class Certificate:
    """What a run proves of itself.

    Attributes
    ----------
    steps : time steps made
    time : simulated time, in the mechanism's unit
    wall_s : real time [s]
    max_residual : largest relative residual of a friction problem (see `engine.friction`)
    max_penetration : largest gap violation left after a step, in the mechanism's unit of length
    settled : at rest at the end
    iterations : Newton steps of the friction solver, all steps together
    """

    steps: int
    time: float
    wall_s: float
    max_residual: float
    max_penetration: float
    settled: bool
    iterations: int


@dataclass(frozen=True)
class Run:
    """Result of a run; ``responses`` is empty unless ``status`` is "ok"."""

    status: Status
    message: str
    responses: dict[str, float]
    units: dict[str, str]
    certificate: Certificate
    measured: dict[str, float] = field(default_factory=dict)
    """The responses as measured at the end of the run, also of a run that failed."""


def simulate(
    mechanism: Mechanism,
    values: Mapping[str, float] | None = None,
    *,
    step: float | None = None,
    horizon: float | None = None,
    full_horizon: bool = False,
) -> Run:
    """Simulate a mechanism until it is at rest and measure its responses (paper, sections 2 and 4.1).

    Parameters
    ----------
    mechanism : the description, see `load_mechanism`
    values : what to change in it, e.g. ``{"J1": 0.05, "springs.A3.preload": 0.9}``
    step : one fixed step, in the place of the description's steps [its unit of time]
    horizon : override the description's ``[simulation]`` [its unit of time]
    full_horizon : do not stop at rest in the last phase

    Raises
    ------
    MechanismError
        If a value is not allowed, or parts overlap at the start pose.
    """
    from engine.assembly import assemble

    settings = {"simulation.step": step, "simulation.horizon": horizon}
    changes = {**(values or {}), **{key: value for key, value in settings.items() if value is not None}}
    mechanism = set_values(mechanism, changes) if changes else mechanism
    if step is not None:
        fixed = mechanism.simulation.model_copy(update={"adaptive": None})
        mechanism = mechanism.model_copy(update={"simulation": fixed})
    return _execute(mechanism, assemble(mechanism), full_horizon)


def check(mechanism: Mechanism, values: Mapping[str, float] | None = None) -> None:
    """Raise `MechanismError` if the mechanism with these values could not start: bad values, overlapping parts."""
    from engine.assembly import assemble

    assemble(set_values(mechanism, values) if values else mechanism)


def warm_up() -> float:
    """Compile the engine, or load it from the cache; return how long that took [s]."""
    from engine.mechanism import load_mechanism

    start = time.perf_counter()
    simulate(load_mechanism("incline"), horizon=1e-2)
    return time.perf_counter() - start


def _execute(mechanism: Mechanism, assembly: "Assembly", full_horizon: bool) -> Run:
    """Run the time loop under a time limit and translate its outcome."""
    import numpy as np

    from engine.kernels.run import OK, Control, new_certificate, run

    sim = mechanism.simulation
    adaptive = sim.adaptive
    control = Control(
        step=sim.step,
        longest=max(sim.step, adaptive.longest) if adaptive else sim.step,
        travel=adaptive.travel if adaptive else np.inf,
        horizon=sim.horizon,
        tolerance=sim.tolerance,
        penetration=sim.penetration,
        window=sim.rest.window,
        drift=sim.rest.drift,
        full_horizon=full_horizon,
    )
    record = new_certificate()
    stop = np.zeros(1, np.uint8)
    state, work, problem = assembly.state, assembly.work, assembly.problem
    backup = type(state)(*map(np.copy, state))
    if not getattr(
        run, "signatures", True
    ):  # compile, or load from the cache, before the clock starts: a run to the horizon 0
        run(assembly.model, state, backup, work, problem, control._replace(horizon=0.0), new_certificate(), stop)
    timer = threading.Timer(sim.wall_limit, stop.__setitem__, (0, 1))
    timer.daemon = True
    start = time.perf_counter()
    timer.start()
    try:
        run(assembly.model, state, backup, work, problem, control, record, stop)
    finally:
        timer.cancel()
    certificate = Certificate(
        steps=int(record.steps[0]),
        time=float(record.time[0]),
        wall_s=time.perf_counter() - start,
        max_residual=float(record.residual[0]),
        max_penetration=float(record.penetration[0]),
        settled=bool(record.settled[0]),
        iterations=int(record.iterations[0]),
    )
    measured = dict(zip(mechanism.responses, map(float, assembly.work.values), strict=True))
    code = int(record.status[0])
    if code == OK and certificate.settled:
        measured |= _forces_at_rest(mechanism, assembly, int(record.phase[0]))
    if code == OK:
        status, message = _judge(mechanism, measured, bool(record.completed[0]) or full_horizon)
    else:
        where = assembly.contact_names[int(record.contact[0])] if record.contact[0] >= 0 else "no contact"
        status, message = _failure(mechanism, code, where, certificate)
    return Run(status, message, measured if status == "ok" else {}, mechanism.response_units(), certificate, measured)


def _forces_at_rest(mechanism: Mechanism, assembly: "Assembly", phase: int) -> dict[str, float]:
    """Return the contact forces among the responses as the pose at rest determines them; NaN if it does not."""
    from engine.equilibrium import forces_at_rest

    wanted = {name: r.contact for name, r in mechanism.responses.items() if r.type == "contact_force"}
    if not wanted:
        return {}
    sim = mechanism.simulation
    forces = forces_at_rest(assembly, phase, sim.step, sim.penetration)
    at = assembly.contact_names.index
    return {name: math.nan if forces is None else float(forces[at(contact), 0]) for name, contact in wanted.items()}


def _judge(mechanism: Mechanism, measured: Mapping[str, float], completed: bool) -> tuple[Status, str]:
    """Judge a run without failure: have its phases ended, and is the result within the validity conditions."""
    unit, sim = mechanism.unit("time"), mechanism.simulation
    if not completed:
        return "not_converged", (
            f"not at rest at the horizon of {sim.horizon:g} {unit}: for {sim.rest.window:g} {unit} no measured length "
            f"may move by {sim.rest.drift:g} {mechanism.unit('length')}; raise simulation.horizon, or give the phase "
            "a duration"
        )
    if any(math.isnan(value) for value in measured.values()):
        return (
            "not_converged",
            "at rest, but no contact forces were found that balance the loads at this pose",
        )
    for condition in mechanism.validity:
        if not condition.holds(measured):
            value, of = measured[condition.response], mechanism.response_units()[condition.response]
            return (
                "invalid",
                f"validity condition {condition} is broken: {condition.response} = {value:.6g} {of}",
            )
    return "ok", ""


def _failure(mechanism: Mechanism, code: int, where: str, certificate: Certificate) -> tuple[Status, str]:
    """Say what ended a run before its end, and where."""
    from engine.kernels.run import DIVERGED, NOT_CONVERGED, PENETRATION

    sim = mechanism.simulation
    at = f"at step {certificate.steps}, t = {certificate.time:.6g} {mechanism.unit('time')}"
    if code == DIVERGED:
        return "diverged", f"the motion is not finite {at}; a smaller simulation.step may help"
    if code == NOT_CONVERGED:
        return "not_converged", (
            f"friction problem: residual {certificate.max_residual:.3g} {at}; "
            f"allowed: simulation.tolerance = {sim.tolerance:g}"
        )
    if code == PENETRATION:
        return "not_converged", (
            f"contact {where}: penetration {certificate.max_penetration:.3g} {mechanism.unit('length')} {at}; "
            f"allowed: simulation.penetration = {sim.penetration:g}"
        )
    return "timeout", f"stopped after {sim.wall_limit:g} s (simulation.wall_limit) {at}"
