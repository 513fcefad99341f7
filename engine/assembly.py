"""Assembly: the one place where a description becomes flat arrays (`kernels.model`)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from engine.errors import MechanismError
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.kernels.contacts import find_contacts
from engine.kernels.model import (
    ARC_CYLINDER,
    ARC_PLANE,
    CONTACT_FORCE,
    CYLINDER_PLANE,
    POINT_PLANE,
    POSITION,
    RING_BORE,
    Bodies,
    Contacts,
    Laws,
    Loads,
    Model,
    Responses,
    Scratch,
    State,
)
from engine.kernels.rotations import rotation_matrix
from engine.mechanism.loads import Force, Torque
from engine.mechanism.models import Mechanism

Array = NDArray[np.float64]

KINDS = {
    "point-plane": POINT_PLANE,
    "arc-plane": ARC_PLANE,
    "cylinder-plane": CYLINDER_PLANE,
    "arc-cylinder": ARC_CYLINDER,
}


@dataclass(frozen=True)
class Assembly:
    """A mechanism as arrays, at its start pose."""

    model: Model
    state: State
    work: Scratch
    problem: FrictionArrays
    contact_names: tuple[str, ...]


@dataclass(frozen=True)
class _Frame:
    """A body's own frame inside the state's: index, position and rotation, from the state's origin."""

    index: int
    origin: Array
    rotation: Array
    quaternion: Array

    def point(self, p: Iterable[float]) -> Array:
        return np.asarray(self.origin + self.rotation @ np.asarray(p, float))

    def direction(self, d: Iterable[float]) -> Array:
        v = self.rotation @ np.asarray(d, float)
        return np.asarray(v / np.linalg.norm(v))


def assemble(mechanism: Mechanism) -> Assembly:
    """Turn a mechanism into arrays.

    Raises
    ------
    MechanismError
        If parts interpenetrate at the start pose.
    """
    order = _order(mechanism)
    frames, state = _bodies(mechanism, order)
    moving = [mechanism.bodies[name] for name in order]
    inertia = np.array([b.inertia for b in moving], float).reshape(-1, 3, 3)
    names, contacts, laws = _contacts(mechanism, frames)
    mass = np.array([b.mass for b in moving], float)
    model = Model(
        bodies=Bodies(mass, inertia, np.linalg.inv(np.linalg.cholesky(inertia)) if moving else inertia),
        contacts=contacts,
        laws=laws,
        loads=Loads(
            gravity=np.array(mechanism.gravity, float),
            **_springs(mechanism, frames),
            **_torsion_springs(mechanism, frames),
            **_constant_loads(mechanism, frames),
        ),
        responses=_responses(mechanism, frames, names),
        phase_duration=np.array([np.inf if p.duration is None else p.duration for p in mechanism.phases]),
    )
    nb, nc, nr = len(moving), len(names), len(mechanism.responses)
    state = state._replace(r=np.zeros((nc, 3)), slip=np.zeros(nc), gap=np.zeros(nc), speed=np.full(1, np.inf))
    assembly = Assembly(
        model,
        state,
        _scratch(nb, nc, nr),
        friction_arrays(6 * nb, nc, 2, 12, _band(contacts, nb)),
        tuple(names),
    )
    _refuse_interpenetration(mechanism, assembly)
    return assembly


def _quaternion(axis: Iterable[float], angle: float) -> Array:
    n = np.asarray(axis, float)
    return np.concatenate(([np.cos(angle / 2)], np.sin(angle / 2) * n / np.linalg.norm(n)))


def _bodies(mechanism: Mechanism, moving: list[str]) -> tuple[dict[str, _Frame], State]:
    """Place every body; fixed ones share the ground, whose frame is the world."""
    nb = len(moving)
    x, p, R, v = np.zeros((nb + 1, 3)), np.zeros((nb + 1, 4)), np.zeros((nb + 1, 3, 3)), np.zeros((nb + 1, 6))
    p[nb, 0] = 1.0
    R[nb] = np.eye(3)
    frames = {"world": _Frame(nb, np.zeros(3), np.eye(3), p[nb].copy())}
    for name, body in mechanism.bodies.items():
        q = _quaternion(body.axis, body.angle)
        rotation = np.zeros((3, 3))
        rotation_matrix(q, rotation)
        if body.fixed:
            frames[name] = _Frame(nb, np.array(body.origin, float), rotation, q)
            continue
        i, centre = moving.index(name), np.array(body.center_of_mass, float)
        frames[name] = _Frame(i, -centre, np.eye(3), p[nb].copy())
        x[i], p[i], R[i] = np.array(body.origin) + rotation @ centre, q, rotation
        v[i] = [*body.velocity, *body.angular_velocity]
    empty = np.zeros(0)
    return frames, State(x, p, R, v, empty, empty, empty, empty)


def _tangent(n: Array) -> Array:
    """Return a unit vector across n."""
    t = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    return np.asarray(t / np.linalg.norm(t))


def _contacts(mechanism: Mechanism, frames: dict[str, _Frame]) -> tuple[list[str], Contacts, Laws]:
    """Return the contacts' names, arrays and laws: the rings of the joints with clearance, then the contacts."""
    names: list[str] = []
    kinds: list[int] = []
    bodies: list[tuple[int, int]] = []
    geometry: list[tuple[Array, Array]] = []
    clearance: list[float] = []
    law: list[tuple[float, float]] = []
    for name, joint in mechanism.joints.items():
        bearing, journal = frames[joint.bearing.body], frames[joint.journal.body]
        along = bearing.direction(joint.bearing.axis)
        axis = journal.direction(joint.journal.axis)
        for i, (station, radius) in enumerate(zip(joint.rings, joint.radii, strict=True)):
            a, b = np.zeros(11), np.zeros(11)
            a[:3] = bearing.point(joint.bearing.point) + station * along
            b[:3], b[3:6], b[6:9], b[9] = journal.point(joint.journal.point), axis, _tangent(axis), radius
            names.append(f"{name}.ring{i + 1}")
            kinds.append(RING_BORE)
            bodies.append((bearing.index, journal.index))
            geometry.append((a, b))
            clearance.append(joint.radial_clearance)
            law.append(mechanism.contact_law(joint))
    for name, contact in mechanism.contacts.items():
        a_side, b_side = contact.sides
        names.append(name)
        kinds.append(KINDS[contact.kind])
        bodies.append((frames[a_side.body].index, frames[b_side.body].index))
        geometry.append((_primitive(a_side, frames), _primitive(b_side, frames)))
        clearance.append(-contact.offset)
        law.append(mechanism.contact_law(contact))
    laws = np.array(law, float).reshape(-1, 2)
    pairs = np.array(bodies, np.int64).reshape(-1, 2)
    contacts = Contacts(
        kind=np.array(kinds, np.int64),
        a=np.ascontiguousarray(pairs[:, 0]),
        b=np.ascontiguousarray(pairs[:, 1]),
        geometry_a=np.array([g[0] for g in geometry]).reshape(-1, 11),
        geometry_b=np.array([g[1] for g in geometry]).reshape(-1, 11),
        clearance=np.array(clearance, float),
    )
    return names, contacts, Laws(np.ascontiguousarray(laws[:, 0]), np.ascontiguousarray(laws[:, 1]))


def _band(contacts: Contacts, nb: int) -> int:
    """Return how far apart the velocities of one contact can lie."""
    moving = (contacts.a < nb) & (contacts.b < nb)
    return 6 * int(np.abs(contacts.a - contacts.b)[moving].max(initial=0)) + 5


def _order(mechanism: Mechanism) -> list[str]:
    """Return the moving bodies in the order that keeps those in contact near each other (Cuthill-McKee)."""
    moving = [name for name, body in mechanism.bodies.items() if not body.fixed]
    number = {name: i for i, name in enumerate(moving)}
    pairs = [(j.bearing.body, j.journal.body) for j in mechanism.joints.values()]
    pairs += [(c.a.body, c.b.body) for c in mechanism.contacts.values()]
    links = np.array([(number[a], number[b]) for a, b in pairs if a in number and b in number], int).reshape(-1, 2)
    n = len(moving)
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(n, n)).tocsr()
    return [moving[i] for i in reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)]


def _primitive(side: Any, frames: dict[str, _Frame]) -> Array:
    """Return the geometry row of one side of a contact (table in `kernels.contacts`)."""
    frame, g = frames[side.body], np.zeros(11)
    if side.kind == "point":
        g[:3] = frame.point(side.point)
    elif side.kind == "plane":
        n = frame.direction(side.plane.normal)
        g[:3], g[3:6], g[6:9] = frame.point(side.plane.point), n, _tangent(n)
    elif side.kind == "arc":
        n, e = frame.direction(side.arc.normal), frame.direction(side.arc.middle)
        e = e - (e @ n) * n
        g[:3], g[3:6], g[6:9] = frame.point(side.arc.centre), n, e / np.linalg.norm(e)
        g[9], g[10] = side.arc.radius, side.arc.half_angle
    else:
        n = frame.direction(side.cylinder.axis)
        g[:3], g[3:6], g[6:9] = frame.point(side.cylinder.point), n, _tangent(n)
        g[9] = side.cylinder.radius
    return g


def _springs(mechanism: Mechanism, frames: dict[str, _Frame]) -> dict[str, Any]:
    """Return the springs between two points."""
    springs = [s for s in mechanism.springs.values() if s.type == "linear"]
    ends = [(frames[s.a.body], s.a.point, frames[s.b.body], s.b.point) for s in springs]
    return {
        "spring_body": np.array([(a.index, b.index) for a, _, b, _ in ends], np.int64).reshape(-1, 2),
        "spring_point": np.array([(*a.point(p), *b.point(q)) for a, p, b, q in ends], float).reshape(-1, 6),
        "spring_law": np.array([(s.stiffness, s.free_length, s.damping) for s in springs], float).reshape(-1, 3),
    }


def _torsion_springs(mechanism: Mechanism, frames: dict[str, _Frame]) -> dict[str, Any]:
    """Return the torsion springs; the angle at the start picks the branch of the angle."""
    springs = [s for s in mechanism.springs.values() if s.type == "torsion"]
    ends = [(frames[s.a], frames[s.b]) for s in springs]
    axes = [np.asarray(s.axis, float) / np.linalg.norm(s.axis) for s in springs]
    law = [
        (s.stiffness, s.free_angle - s.preload, s.damping, _start_angle(mechanism, s, axis))
        for s, axis in zip(springs, axes, strict=True)
    ]
    return {
        "torsion_body": np.array([(a.index, b.index) for a, b in ends], np.int64).reshape(-1, 2),
        "torsion_frame": np.array([(a.quaternion, b.quaternion) for a, b in ends], float).reshape(-1, 2, 4),
        "torsion_axis": np.array(axes, float).reshape(-1, 3),
        "torsion_law": np.array(law, float).reshape(-1, 4),
    }


def _start_angle(mechanism: Mechanism, spring: Any, axis: Array) -> float:
    """Angle of body b's frame about the spring's axis, from body a's, as the file places them."""
    a, b = mechanism.bodies[spring.a], mechanism.bodies[spring.b]
    qa, qb = _quaternion(a.axis, a.angle), _quaternion(b.axis, b.angle)
    vector = qa[0] * qb[1:] - qb[0] * qa[1:] - np.cross(qa[1:], qb[1:])
    return float(2 * np.arctan2(vector @ axis, qa @ qb))


def _constant_loads(mechanism: Mechanism, frames: dict[str, _Frame]) -> dict[str, Any]:
    """Return constant forces (with their points) and torques, each with the phases in which it acts."""
    phases = [p.name for p in mechanism.phases]
    body, vector, in_body, active = [], [], [], []
    loads: list[Force | Torque] = [*mechanism.forces.values(), *mechanism.torques.values()]
    for load in loads:
        frame = frames[load.body]
        turn = frame.rotation if load.frame == "body" else np.eye(3)
        body.append(frame.index)
        if isinstance(load, Force):
            vector.append([*frame.point(load.point), *(turn @ load.force), *np.zeros(3)])
        else:
            vector.append([*np.zeros(6), *(turn @ load.torque)])
        in_body.append(load.frame == "body")
        active.append([load.phases is None or name in load.phases for name in phases])
    return {
        "force_body": np.array(body, np.int64),
        "force_vector": np.array(vector, float).reshape(-1, 9),
        "force_in_body": np.array(in_body, bool),
        "force_phase": np.array(active, bool).reshape(-1, len(phases)),
    }


def _responses(mechanism: Mechanism, frames: dict[str, _Frame], contacts: list[str]) -> Responses:
    """Return what is measured."""
    n = len(mechanism.responses)
    kind, body, point = np.zeros(n, np.int64), np.zeros((n, 3), np.int64), np.zeros((n, 12))
    offset = np.zeros(n)
    for i, response in enumerate(mechanism.responses.values()):
        if response.type == "contact_force":
            kind[i], body[i, 0] = CONTACT_FORCE, contacts.index(response.contact)
            continue
        start, end, way = response.from_, response.to, response.direction
        turned = frames[way.body or "world"]
        kind[i], offset[i] = POSITION, response.offset
        body[i] = frames[start.body].index, frames[end.body].index, turned.index
        if start.axis is not None:
            point[i, 0:3] = frames[start.body].point(start.axis.point)
            point[i, 3:6] = frames[start.body].direction(start.axis.axis)
        else:
            point[i, 0:3] = frames[start.body].point(start.point or (0.0, 0.0, 0.0))
        point[i, 6:9], point[i, 9:12] = frames[end.body].point(end.point), turned.direction(way.vector)
    return Responses(kind, body, point, offset)


def _scratch(nb: int, nc: int, nr: int) -> Scratch:
    """Allocate the work space of a run."""
    bodies, contacts = np.zeros((2, nb + 1, 6)), np.zeros((3, nc, 3))
    return Scratch(
        wrench=bodies[0],
        free=bodies[1],
        gap=np.zeros(nc),
        point=contacts[0],
        frame=np.zeros((nc, 3, 3)),
        q=contacts[1],
        shift=np.zeros(nc),
        u=contacts[2],
        active=np.zeros(nc, bool),
        chosen=np.zeros(nc, np.int64),
        values=np.zeros(nr),
        anchor=np.zeros(nr),
        travel=np.zeros(nc),
        a=np.zeros(3),
        b=np.zeros(3),
    )


def _refuse_interpenetration(mechanism: Mechanism, assembly: Assembly) -> None:
    """Raise if any pair of the assembled parts overlaps at the start."""
    gap = assembly.state.gap
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, gap, work.point, work.frame)
    allowed = mechanism.simulation.penetration
    faults = [
        _overlap(mechanism, name, float(g), assembly.model.contacts.clearance[i])
        for i, (name, g) in enumerate(zip(assembly.contact_names, gap, strict=True))
        if not g >= -allowed
    ]
    if faults:
        lines = "\n".join(f"  {fault}" for fault in dict.fromkeys(faults))  # the rings of a joint share a fault
        raise MechanismError(f"{mechanism.name}: parts overlap at the start pose\n{lines}")


def _overlap(mechanism: Mechanism, name: str, gap: float, clearance: float) -> str:
    """Say which pair overlaps and what would be allowed."""
    unit = mechanism.unit("length")
    joint = name.split(".")[0]
    if joint in mechanism.joints:
        return (
            f"joints.{joint}.radial_clearance = {clearance:.6g} {unit}: the journal lies {clearance - gap:.6g} {unit} "
            f"off its bearing's centre at the start; allowed: at least {clearance - gap:.6g} {unit}, or move the bodies"
        )
    return (
        f"contacts.{name}: gap {gap:.6g} {unit} at the start; allowed: >= 0; move the bodies, the features or `offset`"
    )
