"""The verdict on a run: its status, and a message that says where and why it failed and what may help.

Where a step has no solution, it names the contacts, joints and motions that squeeze what lies between them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array, Integers
from engine.assembly import Assembly
from engine.assembly.start import bodies_of_contact
from engine.friction.arrays import dense_rows
from engine.friction.infeasibility import squeezing_impulses
from engine.kernels import time_loop
from engine.kernels.bilateral import row_violations, slack, whitened_bilateral_rows
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.contacts import whitened_rows
from engine.kernels.model import JOINT_FRICTION
from engine.kernels.projection import REACH
from engine.kernels.time_loop import Course
from engine.loop import CANCELLED
from engine.mechanism import Mechanism
from engine.mechanism.responses import Event, Formula, Mean, in_formulas
from engine.platform.linear_algebra import one_thread
from engine.run import Status

SIDES = 32  # of the pyramid that approximates Coulomb's cone from inside
LITTLE = 1e-6  # share of the largest impulse; anything smaller is a rounding error of zero


@dataclass(frozen=True)
class Jam:
    """A proof that a step has no solution; contacts and rows are the numbers of `Assembly`.

    If it is ``locked``, the balance needs friction: theory does not guarantee a solution, and none was found.
    """

    contacts: tuple[int, ...]  # whose impulses balance each other, whatever the bodies do
    rows: tuple[int, ...]  # joints and motions that balance the rest of these impulses, or contradict each other
    locked: bool = False  # whether the bodies could escape without friction


def find_jam(assembly: Assembly, status: int) -> Jam | None:
    """Return why a run with a final ``status`` has no solution; None if it may. The friction problem is overwritten."""
    with one_thread():
        if status == time_loop.NOT_CONVERGED:
            return _jam_of_velocities(assembly)
        return _jam_of_positions(assembly) if status in (time_loop.PENETRATION, time_loop.VIOLATION) else None


def _jam_of_velocities(assembly: Assembly) -> Jam | None:
    """Look for normal impulses, else impulses with friction, that balance in the friction problem of the last step."""
    problem, chosen = assembly.problem, assembly.work.chosen[: np.count_nonzero(assembly.work.active)]
    nc = chosen.size
    G, J = _contact_rows(assembly, nc), _bilateral_rows(assembly)
    q, mu = problem.q[:nc], problem.mu[:nc, None]
    speed = float(np.abs(q).max(initial=0.0))
    jam = _squeeze(chosen, G[:, 0], q[:, 0], speed, J)
    if jam is None:  # only now: normal impulses alone are a proof, those with friction just leave no guarantee
        angle = 2 * np.pi * np.arange(SIDES) / SIDES
        edges = np.stack(np.broadcast_arrays(1.0, mu * np.cos(angle), mu * np.sin(angle)), axis=2)
        rows, velocities = (edges @ G).reshape(-1, G.shape[2]), np.einsum("isk,ik->is", edges, q)
        jam = _squeeze(np.repeat(chosen, SIDES), rows, velocities.ravel(), speed, J, locked=True)
    return jam


def _jam_of_positions(assembly: Assembly) -> Jam | None:
    """Look for impulses that no displacement evades, from the gaps and joint violations at the last pose."""
    model, state, work, problem = assembly.model, assembly.state, assembly.work, assembly.problem
    contacts, sites, at_pose = model.contacts, work.sites, work.bilateral
    off, point, direction = at_pose.violation, at_pose.point, at_pose.direction
    find_contacts(contacts, state.x, state.R, state.gap, sites.point, sites.frame)
    state.gap[:] += work.depth
    row_violations(model.bilateral, state.x, state.R, at_pose.target[1], off, point, direction)
    direction[_within_slack(assembly)] = 0.0  # such a row constrains nothing
    whitened_bilateral_rows(model.bodies, model.bilateral, state.x, state.R, point, direction, problem.bilateral.J)
    J = _bilateral_rows(assembly)
    worst = float(max(-state.gap.min(initial=0.0), np.abs(off).max(initial=0.0)))
    rigid = (contacts.kind < JOINT_FRICTION) & (contacts.stiffness == 0.0)  # a contact with a stiffness gives way
    chosen = np.flatnonzero(rigid & (state.gap <= REACH * worst))
    for j, i in enumerate(chosen):
        whitened_rows(model.bodies, contacts, state.x, state.R, sites, i, problem.rows, j)
    N = _contact_rows(assembly, chosen.size)[:, 0]
    # each row as two inequalities: what they squeeze is a contradiction between joints and motions
    contradiction = squeezing_impulses(np.vstack([J, -J]), np.concatenate([off, -off]), worst)
    if contradiction is not None:
        pull = contradiction[: len(J)] - contradiction[len(J) :]
        return Jam((), _largest(np.arange(len(J)), np.abs(pull)))
    # contacts are judged after the displacement that closes the joints, as in the projection
    closing = np.linalg.lstsq(J, -off, rcond=None)[0] if len(J) else np.zeros(J.shape[1])
    return _squeeze(chosen, N, state.gap[chosen] + N @ closing, worst, J)


def _within_slack(assembly: Assembly) -> NDArray[np.bool_]:
    """Return the bilateral rows that others hold already, and whose violation therefore does not count, shape (nt,)."""
    model, at_pose = assembly.model, assembly.work.bilateral
    allowed = [slack(model.metric, model.bilateral, at_pose, i) for i in range(len(at_pose.violation))]
    return np.asarray(at_pose.redundant & (np.abs(at_pose.violation) <= allowed))


def _squeeze(numbers: Integers, rows: Array, q: Array, speed: float, J: Array, locked: bool = False) -> Jam | None:
    """Return the contacts that squeeze and the bilateral rows that resist them; None if nothing is squeezed."""
    impulses = squeezing_impulses(rows, q, speed, J)
    if impulses is None:
        return None
    length, held = np.linalg.norm(J, axis=1), np.zeros(len(J))
    acts = length > 0.0
    if acts.any():
        held[acts] = np.linalg.lstsq((J[acts] / length[acts, None]).T, rows.T @ impulses, rcond=None)[0]
    least = LITTLE * np.max(impulses * np.linalg.norm(rows, axis=1))
    return Jam(_largest(numbers, impulses), tuple(map(int, np.flatnonzero(np.abs(held) > least))), locked)


def _largest(numbers: Integers, impulses: Array) -> tuple[int, ...]:
    """Return the distinct numbers whose impulse is not negligible."""
    return tuple(dict.fromkeys(map(int, numbers[impulses > LITTLE * impulses.max()])))


def _contact_rows(assembly: Assembly, nc: int) -> Array:
    """Return the rows (N, T1, T2) of the friction problem's first ``nc`` contacts, shape (nc, 3, n)."""
    rows = assembly.problem.rows
    return dense_rows(rows.node[:nc], rows.G[:nc], assembly.problem.w.size)


def _bilateral_rows(assembly: Assembly) -> Array:
    """Return the bilateral rows of the friction problem, shape (nt, n)."""
    system = assembly.problem.bilateral
    return dense_rows(system.node, system.J[:, None], assembly.problem.w.size)[:, 0]


def judge(
    mechanism: Mechanism, measured: Mapping[str, float], settled: bool, drift: str = "", at_rest: bool = True
) -> tuple[Status, str]:
    """Judge a run that completed its phases: check that all values exist and that the validity conditions hold.

    ``measured`` is NaN where a response has no value. ``drift`` describes a motion that continues although nothing
    measured moves, see `engine.not_at_rest`; empty if there is none. Unless the run had to end ``at_rest``, it matters
    only if it leaves a force without a value. Return status and message.
    """
    known = in_formulas(mechanism.responses)
    missing = [name for name, value in measured.items() if math.isnan(value)]
    for name in missing:
        response = mechanism.responses[name]
        if isinstance(response, Mean) and response.window and response.at == "end":
            return "invalid", f"{name}: the run ended before its window began, {response.window[0]:g} after from_phase"
        if isinstance(response, Formula) and not set(missing) & {known.get(part) for part in response.sources}:
            at = ", ".join(f"{part} = {measured[known[part]]:g}" for part in response.sources if part in known)
            return "invalid", f"{name}: its formula, {response.formula}, has no finite value at {at}"
    events = [name for name in missing if isinstance(mechanism.responses[name].at, Event)]
    if events:
        ended = "; the run ended at rest: give its last phase a duration if it is to go on" if settled else ""
        return "invalid", f"{', '.join(events)}: the event it is read at (`at`) did not happen in this run{ended}"
    if drift and (missing or at_rest):
        rest = mechanism.simulation.rest
        meant = "" if missing else "; if this motion is meant, give the last phase a duration"
        return "not_at_rest", (
            f"{drift}; for {rest.window:g} {mechanism.unit('time')} nothing measured "
            f"moved by {rest.drift:g} {mechanism.unit('length')}: give it more time "
            f"(simulation.horizon, or the duration of the last phase), or hold the body{meant}"
        )
    if missing:
        text = "at rest, but no contact forces were found that balance the loads at this pose"
        return "not_converged", f"{', '.join(missing)}: {text}"
    for condition in mechanism.validity:
        if not condition.holds(measured):
            name, of = condition.response, mechanism.response_units()[condition.response]
            return "invalid", f"validity condition {condition} is broken: {name} = {measured[name]:.6g} {of}"
    return "ok", ""


def unfinished(mechanism: Mechanism, phase: int, settled: bool, motion: str) -> tuple[Status, str]:
    """Return status and message of a run that reached its horizon in a ``phase`` that ends at rest or at an event."""
    sim, awaited, moving = mechanism.simulation, mechanism.phases[phase].until, f": {motion}" if motion else ""
    horizon = f"the horizon of {sim.horizon:g} {mechanism.unit('time')}"
    if awaited is None:
        return "not_at_rest", f"not at rest at {horizon}{moving}"
    beyond = f"above {awaited.above:g}" if awaited.above is not None else f"below {awaited.below:g}"
    of = mechanism.response_units()[awaited.response]
    name = mechanism.phases[phase].name
    missed = f"phase {name} did not end by {horizon}: {awaited.response} was never {beyond} {of}"
    if settled:
        return "invalid", f"{missed}, and the mechanism is at rest; check the event, or give the phase a duration"
    return "not_at_rest", f"{missed}{moving}; raise simulation.horizon, or give the phase a duration"


def failure(mechanism: Mechanism, assembly: Assembly, course: Course) -> tuple[Status, str]:
    """Return the status and message of a run that stopped before its end."""
    sim, n, now = mechanism.simulation, course.counts, course.reals
    length, code, contact = mechanism.unit("length"), int(n[time_loop.STATUS]), int(n[time_loop.CONTACT])
    where = f"contact {assembly.contact_names[contact]}" if contact >= 0 else "no contact"
    at = f"at step {n[time_loop.STEPS]}, t = {now[time_loop.TIME]:.6g} {mechanism.unit('time')}"
    if code == time_loop.DIVERGED:
        moved = float(now[time_loop.STEP] * now[time_loop.FASTEST])
        lost = f"a body moves by {moved:.3g} {length} in a step" if math.isfinite(moved) else "it is not finite"
        return "diverged", f"the motion is lost {at}: {lost} ({where}); a smaller simulation.step may help"
    if jam := find_jam(assembly, code):
        return "jammed", f"{at}: {_reason(mechanism, assembly, jam)}"
    if code == time_loop.NOT_CONVERGED:
        return "not_converged", (
            f"friction problem: residual {now[time_loop.MAX_RESIDUAL]:.3g} {at}, worst at {where}; "
            f"allowed: simulation.tolerance = {sim.tolerance:g}"
        )
    if code == time_loop.PENETRATION:
        return "not_converged", (
            f"{where}: penetration {now[time_loop.MAX_PENETRATION]:.3g} {length} {at}; "
            f"allowed: simulation.penetration = {sim.penetration:g}; a smaller simulation.step may help"
        )
    if code == time_loop.VIOLATION:
        row = int(np.where(_within_slack(assembly), 0.0, abs(assembly.work.bilateral.violation)).argmax())
        return "not_converged", (
            f"joint {assembly.row_names[row]}: off by {now[time_loop.MAX_VIOLATION]:.3g} {length} {at}; "
            f"allowed: simulation.joint_violation = {sim.joint_violation:g}; a smaller simulation.step may help"
        )
    if n[time_loop.STOPPED_BY] == CANCELLED:
        return "cancelled", f"cancelled {at}"
    pace = f"its last step was {now[time_loop.STEP]:.3g} {mechanism.unit('time')} long"
    remedy = "raise the limit, or look for what makes the steps short: clearcap mechanism check warns of known causes"
    return "timeout", f"stopped after {sim.wall_limit:g} s (simulation.wall_limit) {at}; {pace}; {remedy}"


def _reason(mechanism: Mechanism, assembly: Assembly, jam: Jam) -> str:
    """Return a description of the jam in the names of the mechanism, and what may help."""
    held = [assembly.row_names[i] for i in jam.rows]
    target = assembly.work.bilateral.target
    driven = [assembly.row_names[i] for i in jam.rows if target[0, i] != target[1, i]]
    travel = f"give {_list(driven)} less travel" if driven else "check the pose and the loads"
    if not jam.contacts:
        return f"{_list(held)} contradict each other at this pose; {travel}, or remove one of them"
    names = [assembly.contact_names[i] for i in jam.contacts]
    squeezed = [f"{name} ({' and '.join(bodies_of_contact(mechanism, name)[1])})" for name in names]
    contacts = f"contact{'s' if len(names) > 1 else ''} {_list(squeezed)}"
    holding = f" while {_list(held)} {'act' if len(held) > 1 else 'acts'}" if held else ""
    if jam.locked:
        return f"friction locks {contacts}{holding}; {travel}, or allow for less friction, a clearance or a spring"
    reason = f"no motion of the bodies keeps {contacts} from closing{holding}"
    return f"{reason}; {travel}, or allow for a clearance or a spring"


def _list(names: list[str]) -> str:
    """Join names as a list within a sentence."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
