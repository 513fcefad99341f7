"""Phases, time laws and loads as arrays: when the phases end, which loads act in them, and how they vary with time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from engine.arrays import Array, Integers
from engine.assembly.frames import BodyFrame, quaternion
from engine.kernels.model import Bushings, Loads, Phases, TimeLaws
from engine.mechanism.loads import (
    FactorSine,
    FactorTable,
    Force,
    ForceAction,
    Law,
    Led,
    LinearDamper,
    LinearSpring,
    Sine,
    TableLaw,
    Torque,
    TorqueAction,
    TorsionDamper,
    TorsionSpring,
)
from engine.mechanism.models import Mechanism
from engine.mechanism.responses import Event

ACTS = {"both": 0.0, "push": 1.0, "pull": -1.0}


def phase_arrays(mechanism: Mechanism) -> Phases:
    """Return the phases of a run, in order."""
    names, phases = list(mechanism.responses), mechanism.phases
    return Phases(
        duration=np.array([np.inf if p.duration is None else p.duration for p in phases], float),
        trigger=np.array([names.index(p.until.response) if p.until else -1 for p in phases], np.int64),
        limit=np.array([event_limit(p.until) if p.until else (0.0, 1.0) for p in phases], float),
        damping=np.array([p.damping for p in phases], float),
    )


def event_limit(event: Event) -> tuple[float, float]:
    """Return the limit of an event and its side: 1 above it, -1 below it."""
    return (event.above, 1.0) if event.above is not None else (event.below or 0.0, -1.0)


def active_phases(mechanism: Mechanism, phases: Sequence[str] | None) -> Array:
    """Return the phases in which a load or motion acts, shape (n_phase,) bool; ``phases`` None means all."""
    return np.array([phases is None or phase.name in phases for phase in mechanism.phases], bool)


# Time laws as arrays: cubic pieces plus a sine.


def time_law_arrays(mechanism: Mechanism) -> tuple[TimeLaws, dict[str, int]]:
    """Return all time laws as arrays, and the number of each by the key of its owner, such as ``"forces.push"``."""
    owners = {
        f"{table}.{name}": entry
        for table in ("forces", "torques", "motions", "springs", "dampers")
        for name, entry in getattr(mechanism, table).items()
        if entry.law is not None
    }
    laws: dict[str, Law] = {key: entry.law for key, entry in owners.items()}
    for table in ("joints", "contacts"):  # a table over a speed, see `FrictionOverSpeed`
        for name, pair in getattr(mechanism, table).items():
            if not getattr(pair, "ideal", False) and (over_speed := mechanism.friction_over_speed(pair)) is not None:
                laws[f"{table}.{name}"] = over_speed
    pieces = [_pieces(law) for law in laws.values()]
    rows = np.concatenate([np.zeros((0, 5)), *pieces])
    arrays = TimeLaws(
        first=np.cumsum([0, *map(len, pieces)], dtype=np.int64),
        time=rows[:, 0].copy(),
        piece=rows[:, 1:].copy(),
        sine=np.array([_sine(law) for law in laws.values()], float).reshape(-1, 3),
        since=np.array([_since(mechanism, owners[key]) if key in owners else 0 for key in laws], np.int64),
        begun=np.array([0.0, *(np.inf for _ in mechanism.phases[1:])]),
    )
    return arrays, {owner: number for number, owner in enumerate(laws)}


def _since(mechanism: Mechanism, entry: Any) -> int:
    """Return the phase at whose start a law's time begins: the named one, or the first in which a motion acts."""
    phases = [phase.name for phase in mechanism.phases]
    if isinstance(entry, LinearSpring | TorsionSpring | LinearDamper | TorsionDamper):
        return 0  # its law is none of time
    if entry.since is None and isinstance(entry, Led) and entry.phases:
        return min(phases.index(phase) for phase in entry.phases)
    return phases.index(entry.since or phases[0])


def _pieces(law: Law) -> Array:
    """Return the start time of each piece and its four coefficients, shape (pieces, 5)."""
    if isinstance(law, TableLaw):
        return _table(law)
    if isinstance(law, Sine):
        mean = law.mean + law.amplitude * np.sin(law.phase) if isinstance(law, FactorSine) else 0.0
        return np.array([[0.0, mean, 0.0, 0.0, 0.0]])
    # a second piece that never begins, because a law is constant from its last piece on
    return np.array([[0.0, 0.0, law.speed, 0.0, 0.0], [np.inf, 0.0, 0.0, 0.0, 0.0]])


def _table(law: TableLaw) -> Array:
    """Return the pieces of a table; a smooth one is flat at both ends, where it continues as a constant."""
    t, y = np.array(law.points).T
    rows = np.zeros((t.size, 5))
    rows[:, 0], rows[:, 1] = t, y
    if law.interpolation == "smooth":
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # 0.3 s to load

        slopes = PchipInterpolator(t, y).derivative()(t)
        slopes[[0, -1]] = 0.0
        rows[:-1, 2:] = CubicHermiteSpline(t, y, slopes).c[2::-1].T
    else:
        rows[:-1, 2] = np.diff(y) / np.diff(t)
    return rows


def _sine(law: Law) -> tuple[float, float, float]:
    """Return amplitude, angular frequency and phase; zeros for a law that is not a sine."""
    if not isinstance(law, Sine):
        return 0.0, 0.0, 0.0
    return law.amplitude, law.angular_frequency, law.phase  # type: ignore[attr-defined]


# Springs, dampers, forces and torques as arrays.


def load_arrays(
    mechanism: Mechanism,
    frames: dict[str, BodyFrame],
    laws: dict[str, int],
    coordinates: dict[str, Any],
    bushings: Bushings,
) -> Loads:
    """Return all loads as arrays; a damper is stored as a spring without stiffness.

    ``laws`` gives the number of each law by the key of its owner, and ``coordinates`` are those that laws depend on,
    see `laws_over`.
    """
    return Loads(
        gravity=np.array(mechanism.gravity, float),
        **_springs(mechanism, frames, laws),
        **_torsion_springs(mechanism, frames, laws),
        **_actions(mechanism, frames),
        **_forces(mechanism, frames, laws),
        **coordinates,
        over_work=np.zeros(3),
        bushings=bushings,
    )


def laws_over(mechanism: Mechanism) -> list[str]:
    """Return the responses that laws of forces and torques depend on, each once."""
    loads: tuple[Force | Torque, ...] = (*mechanism.forces.values(), *mechanism.torques.values())
    return list(dict.fromkeys(load.law.over for load in loads if isinstance(load.law, FactorTable) and load.law.over))


def _of_type(mechanism: Mechanism, kind: str) -> list[Any]:
    """Return the springs of one type, followed by the dampers of this type."""
    return [s for s in (*mechanism.springs.values(), *mechanism.dampers.values()) if s.type == kind]


def _tables(mechanism: Mechanism, kind: str, laws: dict[str, int]) -> Integers:
    """Return the numbers of the laws of `_of_type`, (n, 2): of springs over length or angle, of dampers over speed."""
    springs = [laws.get(f"springs.{name}", -1) for name, s in mechanism.springs.items() if s.type == kind]
    dampers = [laws.get(f"dampers.{name}", -1) for name, d in mechanism.dampers.items() if d.type == kind]
    return np.array([(i, -1) for i in springs] + [(-1, i) for i in dampers], np.int64).reshape(-1, 2)


def _springs(mechanism: Mechanism, frames: dict[str, BodyFrame], laws: dict[str, int]) -> dict[str, Any]:
    """Return the springs and dampers between two points."""
    springs = _of_type(mechanism, "linear")
    ends = [(frames[s.a.body], s.a.point, frames[s.b.body], s.b.point) for s in springs]
    law = [
        (s.stiffness or 0.0, s.free_length or 0.0, s.damping, s.preload, ACTS[s.acts])
        if isinstance(s, LinearSpring)
        else (0.0, 0.0, s.damping or 0.0, 0.0, 0.0)
        for s in springs
    ]
    return {
        "spring_body": np.array([(a.index, b.index) for a, _, b, _ in ends], np.int64).reshape(-1, 2),
        "spring_point": np.array([(*a.point(p), *b.point(q)) for a, p, b, q in ends], float).reshape(-1, 6),
        "spring_law": np.array(law, float).reshape(-1, 5),
        "spring_table": _tables(mechanism, "linear", laws),
    }


def _torsion_springs(mechanism: Mechanism, frames: dict[str, BodyFrame], laws: dict[str, int]) -> dict[str, Any]:
    """Return the torsion springs and dampers; the angle at the start selects the branch of the angle."""
    springs = _of_type(mechanism, "torsion")
    ends = [(frames[s.a], frames[s.b]) for s in springs]
    elastic = [
        (s.stiffness or 0.0, (s.free_angle or 0.0) - s.preload) if isinstance(s, TorsionSpring) else (0.0, 0.0)
        for s in springs
    ]
    law = [(*k, s.damping or 0.0, _start_angle(mechanism, s)) for k, s in zip(elastic, springs, strict=True)]
    axes = [a.direction(s.axis) for (a, _), s in zip(ends, springs, strict=True)]
    return {
        "torsion_body": np.array([(a.index, b.index) for a, b in ends], np.int64).reshape(-1, 2),
        "torsion_axis": np.array(axes, float).reshape(-1, 3),
        "torsion_turn": np.array([_turn(a.quaternion, b.quaternion) for a, b in ends], float).reshape(-1, 4),
        "torsion_law": np.array(law, float).reshape(-1, 4),
        "torsion_table": _tables(mechanism, "torsion", laws),
    }


def _turn(a: Array, b: Array) -> Array:
    """Return b times the conjugate of a: b's attitude times it equals a's where the angle is 0."""
    return np.array([a @ b, *(a[0] * b[1:] - b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def _start_angle(mechanism: Mechanism, spring: TorsionSpring | TorsionDamper) -> float:
    """Return the angle of body b relative to body a about the spring's axis, in the pose given in the file."""
    a, b = mechanism.bodies[spring.a], mechanism.bodies[spring.b]
    qa, qb = quaternion(a.axis, a.angle), quaternion(b.axis, b.angle)
    vector = qa[0] * qb[1:] - qb[0] * qa[1:] - np.cross(qa[1:], qb[1:])
    return float(2 * np.arctan2(vector @ np.array(spring.axis), qa @ qb))


def _actions(mechanism: Mechanism, frames: dict[str, BodyFrame]) -> dict[str, Any]:
    """Return the actions of the springs that do not act along their line or as a couple about their axis."""
    springs = [*_of_type(mechanism, "linear"), *_of_type(mechanism, "torsion")]
    actions = [getattr(spring, "actions", ()) for spring in springs]
    each = [action for of_one in actions for action in of_one]
    rows = [_load_row(frames[a.body], a, frames[a.body].rotation) for a in each]
    return {
        "action_first": np.cumsum([0, *map(len, actions)]),
        "action_body": np.array([frames[a.body].index for a in each], np.int64),
        "action_vector": np.array(rows, float).reshape(-1, 9),
    }


def _load_row(frame: BodyFrame, load: Force | Torque | ForceAction | TorqueAction, turn: Array) -> list[float]:
    """Return the point, force and torque of a load, with its vector rotated by ``turn``."""
    if isinstance(load, Force | ForceAction):
        return [*frame.point(load.point), *(turn @ load.force), *np.zeros(3)]
    return [*np.zeros(6), *(turn @ load.torque)]


def _forces(mechanism: Mechanism, frames: dict[str, BodyFrame], laws: dict[str, int]) -> dict[str, Any]:
    """Return forces (with their points) and torques, each with the phases in which it acts and its time law."""
    body, vector, in_body, active, law, over, against = [], [], [], [], [], [], []
    measured = laws_over(mechanism)
    loads: dict[str, Force | Torque] = {f"forces.{name}": force for name, force in mechanism.forces.items()}
    loads |= {f"torques.{name}": torque for name, torque in mechanism.torques.items()}
    for key, load in loads.items():
        frame = frames[load.body]
        turn = frame.rotation if load.frame == "body" else np.eye(3)
        body.append(frame.index)
        vector.append(_load_row(frame, load, turn))
        in_body.append(load.frame == "body")
        active.append(active_phases(mechanism, load.phases))
        law.append(laws.get(key, -1))
        over.append(measured.index(load.law.over) if isinstance(load.law, FactorTable) and load.law.over else -1)
        against.append(frames[load.against].index if load.against else -1)
    return {
        "force_body": np.array(body, np.int64),
        "force_vector": np.array(vector, float).reshape(-1, 9),
        "force_in_body": np.array(in_body, bool),
        "force_law": np.array(law, np.int64),
        "force_over": np.array(over, np.int64),
        "force_against": np.array(against, np.int64),
        "force_phase": np.array(active, bool).reshape(-1, len(mechanism.phases)),
    }
