"""What is measured, against hand calculation and finite differences; what is reported, on sequences by hand."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import Assembly, assemble
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.responses import measure, update_reported
from tests.each import each
from tests.engine.small import made, place, small

SEEDS = range(6)
TILTED = {"axis": [1.0, 2.0, -1.0], "angle": 0.8}
CENTRES = {"a": np.array([0.1, 0.2, -0.1]), "b": np.array([-0.2, 0.05, 0.15]), "c": np.array([0.3, 0.0, -0.2])}
MASSES = {"a": 2.0, "b": 3.0, "c": 4.0}
FROM, TO = np.array([0.3, -0.2, 0.5]), np.array([-0.4, 0.6, 0.1])
AXIS, WAY = np.array([1.0, -2.0, 2.0]) / 3, np.array([2.0, 3.0, -6.0]) / 7
H = 0.5


def mechanism(responses: dict[str, Any], **tables: Any) -> Assembly:
    """Assemble three free bodies whose centres are not their origins, and a fixed one that stands askew."""
    bodies = {
        name: {"mass": MASSES[name], "inertia": [1, 1.2, 1.4], "center_of_mass": centre.tolist()}
        for name, centre in CENTRES.items()
    }
    return assemble(made(small(bodies={"ground": {"fixed": True, **TILTED}, **bodies}, responses=responses, **tables)))


def index(assembly: Assembly, name: str) -> int:
    """Return the number of a body in the arrays: assembly orders bodies as it likes."""
    return int(np.flatnonzero(assembly.model.bodies.mass == MASSES[name])[0])


def read(assembly: Assembly, t: float = 0.0) -> np.ndarray:
    """Measure all responses at the present pose, with the impulses of a step of length H."""
    model, state, work = assembly.model, assembly.state, assembly.work
    measure(model, state, work.sites, work.bilateral, work.values, work.vectors, (t, H))
    return work.values.copy()


def scatter(assembly: Assembly, rng: np.random.Generator) -> None:
    """Put all bodies anywhere, with any twists."""
    for body in range(3):
        place(assembly, body, rng.normal(size=3), Rotation.random(random_state=rng))
        assembly.state.v[body] = rng.normal(size=6)


def rate(assembly: Assembly, dt: float = 1e-5) -> np.ndarray:
    """Differentiate all responses along the present twists by central differences."""
    state = assembly.state
    poses = [(state.x[i].copy(), Rotation.from_matrix(state.R[i]), state.v[i].copy()) for i in range(3)]
    values = []
    for way in (-dt, dt):
        for i, (x, rotation, v) in enumerate(poses):
            place(assembly, i, x + way * v[:3], rotation * Rotation.from_rotvec(way * v[3:]))
        values.append(read(assembly))
    for i, (x, rotation, _) in enumerate(poses):
        place(assembly, i, x, rotation)
    return (values[1] - values[0]) / (2 * dt)


STARTS = {
    "point": {"body": "a", "point": FROM.tolist()},
    "axis": {"body": "a", "axis": {"point": FROM.tolist(), "axis": AXIS.tolist()}},
}
WAYS = {"world": {"vector": WAY.tolist()}, "body": {"body": "c", "vector": WAY.tolist()}}
PLACES = [(start, way) for start in STARTS for way in WAYS]


def ways(kind: str, **keys: Any) -> dict[str, Any]:
    """Describe a position or velocity for each kind of reference and direction."""
    to = {"body": "b", "point": TO.tolist()}
    return {
        f"{kind}_{start}_{way}": {"type": kind, "from": STARTS[start], "to": to, "direction": WAYS[way], **keys}
        for start, way in PLACES
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_positions_are_components_of_the_way_between_points(seed):
    """The component by hand, for every reference and direction."""
    assembly = mechanism(ways("position", offset=0.25))
    scatter(assembly, np.random.default_rng(seed))
    x, R, at = assembly.state.x, assembly.state.R, {name: index(assembly, name) for name in MASSES}
    start = x[at["a"]] + R[at["a"]] @ (FROM - CENTRES["a"])
    end = x[at["b"]] + R[at["b"]] @ (TO - CENTRES["b"])
    axis = R[at["a"]] @ AXIS
    foot = start + (end - start) @ axis * axis
    expected = [
        {"world": WAY, "body": R[at["c"]] @ WAY}[way] @ (end - {"point": start, "axis": foot}[begin]) + 0.25
        for begin, way in PLACES
    ]
    np.testing.assert_allclose(read(assembly), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_velocities_are_the_rates_of_positions(seed):
    """Moving reference, sliding foot point, turning direction: the finite difference of the position."""
    assembly = mechanism(ways("position") | ways("velocity"))
    scatter(assembly, np.random.default_rng(seed))
    np.testing.assert_allclose(read(assembly)[4:], rate(assembly)[:4], atol=1e-8)


def test_a_velocity_without_reference_is_that_of_the_point_in_the_world():
    """Speed of the centre and omega x r, along the direction."""
    assembly = mechanism(
        {"v": {"type": "velocity", "to": {"body": "b", "point": TO.tolist()}, "direction": WAYS["world"]}}
    )
    scatter(assembly, np.random.default_rng(0))
    i = index(assembly, "b")
    R, v = assembly.state.R[i], assembly.state.v[i]
    speed = v[:3] + R @ np.cross(v[3:], TO - CENTRES["b"])
    np.testing.assert_allclose(read(assembly), WAY @ speed, atol=1e-13)


def turns(**keys: Any) -> dict[str, Any]:
    """Describe angle and angular velocity of b about the axis."""
    return {kind: {"type": kind, "body": "b", "axis": AXIS.tolist(), **keys} for kind in ("angle", "angular_velocity")}


def turn(assembly: Assembly, name: str, rotation: Rotation) -> None:
    """Turn a body in the world, from where it is."""
    i = index(assembly, name)
    place(assembly, i, assembly.state.x[i], rotation * Rotation.from_matrix(assembly.state.R[i]))


def test_an_angle_counts_from_the_start_also_of_a_body_that_is_flipped_there():
    """Turned over by half a turn across the axis at the start, b is at angle 0, and turns on from there."""
    across = np.cross(AXIS, [0, 0, 1.0])
    data = small(
        bodies={
            "a": {"mass": 2.0, "inertia": [1, 1, 1], **TILTED},
            "b": {"mass": 3.0, "inertia": [1, 1, 1], "axis": across.tolist(), "angle": np.pi},
        },
        responses=turns() | {"from_a": {**turns(relative_to="a")["angle"], "offset": 0.1}},
    )
    assembly = assemble(made(data))
    np.testing.assert_allclose(read(assembly), [0.0, 0.0, 0.1], atol=1e-14)
    turn(assembly, "b", Rotation.from_rotvec(0.7 * AXIS))
    assert read(assembly)[0] == pytest.approx(0.7, abs=1e-14)


def test_an_angle_is_seen_from_the_other_body():
    """About an axis of a, b turns by 0.9; both carried along by any rotation, nothing changes."""
    assembly = mechanism({"angle": turns(relative_to="a")["angle"]})
    turn(assembly, "b", Rotation.from_rotvec(0.9 * AXIS))
    for name in ("a", "b"):
        turn(assembly, name, Rotation.from_rotvec([0.3, -1.1, 0.4]))
    assert read(assembly)[0] == pytest.approx(0.9, abs=1e-14)


def test_an_axis_is_given_in_the_frame_of_a_fixed_body_that_stands_askew():
    """The fixed body's own orientation turns the axis, and is no angle."""
    tilt = np.array(TILTED["axis"])
    axis = Rotation.from_rotvec(TILTED["angle"] * tilt / np.linalg.norm(tilt)).apply(AXIS)
    assembly = mechanism(turns(relative_to="ground"))
    turn(assembly, "b", Rotation.from_rotvec(-0.6 * axis))
    assembly.state.v[index(assembly, "b"), 3:] = Rotation.from_rotvec(0.6 * axis).apply(-1.5 * axis)
    np.testing.assert_allclose(read(assembly), [-0.6, -1.5], atol=1e-14)


@pytest.mark.parametrize("way", [-0.5, 0.5])
def test_full_turns_count(way):
    """Three turns and a bit, in steps of half a radian, with an offset of more than half a turn."""
    assembly = mechanism({"angle": {**turns()["angle"], "offset": 4.0}})
    for i in range(41):
        assert read(assembly)[0] == pytest.approx(4.0 + i * way, abs=1e-12)
        turn(assembly, "b", Rotation.from_rotvec(way * AXIS))


@pytest.mark.parametrize("seed", SEEDS)
def test_an_angular_velocity_is_relative_and_about_the_moving_axis(seed):
    """The component of omega_b - omega_a, all in the world."""
    assembly = mechanism({"spin": turns(relative_to="a")["angular_velocity"]})
    scatter(assembly, np.random.default_rng(seed))
    a, b, R, v = index(assembly, "a"), index(assembly, "b"), assembly.state.R, assembly.state.v
    expected = (R[a] @ AXIS) @ (R[b] @ v[b, 3:] - R[a] @ v[a, 3:])
    assert read(assembly)[0] == pytest.approx(expected, abs=1e-13)


def pin(**responses: Any) -> Assembly:
    """Assemble a pin with play in a bore, held at z = 0 by nothing; the axis is z."""
    side = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    return assemble(
        made(
            small(
                bodies={"ground": {"fixed": True}, "a": {"mass": 2.0, "inertia": [1, 1, 1]}},
                joints={
                    "J1": {
                        "type": "clearance_revolute",
                        "bearing": {"body": "ground", **side},
                        "journal": {"body": "a", **side, "radius": 1.0},
                        "rings": [-1.0, 2.0],
                        "radial_clearance": 0.05,
                        "friction": 0.2,
                    }
                },
                responses=responses,
            )
        )
    )


def test_gap_and_forces_of_one_contact_of_a_joint():
    """The gap is clearance minus eccentricity; forces are the step's impulses by its length."""
    assembly = pin(
        gap={"type": "gap", "contact": "J1.ring2"},
        normal={"type": "contact_force", "contact": "J1.ring2"},
        friction={"type": "contact_force", "contact": "J1.ring2", "component": "friction"},
    )
    place(assembly, 0, [0.03, 0, 0], Rotation.identity())
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
    state.r[:] = [[1.0, 1.0, 1.0], [7.0, 3.0, -4.0]]
    np.testing.assert_allclose(read(assembly), [0.02, 7.0 / H, 5.0 / H], rtol=1e-14)


def test_the_force_of_a_joint_is_the_resultant_on_its_journal():
    """A pin that leans on the bore's +x side is pushed back to -x, and rubbed along its axis."""
    assembly = pin(
        size={"type": "joint_force", "joint": "J1"},
        x={"type": "joint_force", "joint": "J1", "direction": {"vector": [2, 0, 0]}},
        own_z={"type": "joint_force", "joint": "J1", "direction": {"body": "a", "vector": [0, 0, 1]}},
    )
    place(assembly, 0, [0.05, 0, 0], Rotation.identity())
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
    state.r[:] = [[1.0, 0.0, 0.0], [2.0, 4.0, 0.0]]  # T1 is the journal's axis
    np.testing.assert_allclose(read(assembly), [5.0 / H, -3.0 / H, -4.0 / H], rtol=1e-14)


def test_the_force_of_a_slider_is_on_the_slider_whichever_body_has_the_faces():
    """A block on the bottom of its slot, whose faces are the slot's, is pushed up."""
    side = {"point": [0, 0, 0], "axis": [1, 0, 0], "normal": [0, 0, 1]}
    assembly = assemble(
        made(
            small(
                bodies={"ground": {"fixed": True}, "a": {"mass": 2.0, "inertia": [1, 1, 1]}},
                joints={
                    "J1": {
                        "type": "clearance_prismatic",
                        "guide": {"body": "ground", **side},
                        "slider": {"body": "a", **side},
                        "block": {"half_length": 2.0, "half_height": 1.0, "half_width": 1.0},
                        "clearance": 0.05,
                        "friction": 0.2,
                    }
                },
                responses={"up": {"type": "joint_force", "joint": "J1", "direction": {"vector": [0, 0, 1]}}},
            )
        )
    )
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, state.gap, work.sites.point, work.sites.frame)
    state.r[[name.startswith("J1.bottom") for name in assembly.contact_names], 0] = 1.0
    assert read(assembly)[0] == pytest.approx(4.0 / H, rel=1e-14)


def test_a_joint_sums_its_own_contacts_only():
    """A joint whose name begins like another's, and its neighbours, stay out of the sum."""
    data = made(
        small(
            bodies={"ground": {"fixed": True}, "a": {"mass": 2.0, "inertia": [1, 1, 1]}},
            joints={
                name: {
                    "type": "clearance_revolute",
                    "bearing": {"body": "ground", "point": [0, 0, 0], "axis": [0, 0, 1]},
                    "journal": {"body": "a", "point": [0, 0, 0], "axis": [0, 0, 1], "radius": 1.0},
                    "rings": rings,
                    "radial_clearance": 0.05,
                    "friction": 0.2,
                }
                for name, rings in (("J", [0.0]), ("J1", [1.0, 2.0]), ("J11", [3.0]))
            },
            responses={name: {"type": "joint_force", "joint": name} for name in ("J", "J1", "J11")},
        )
    )
    assembly = assemble(data)
    assembly.work.sites.frame[:] = np.eye(3)
    assembly.state.r[:, 0] = [1.0, 10.0, 20.0, 100.0]
    np.testing.assert_allclose(read(assembly), np.array([1.0, 30.0, 100.0]) / H)


def test_forces_and_torques_of_springs():
    """Of the right spring among several: k (free - length) - c rate; -k (phi - free + preload) - c rate."""
    linear = {"type": "linear", "stiffness": 2.0, "free_length": 7.0, "damping": 0.5}
    torsion = {"type": "torsion", "a": "ground", "b": "a", "axis": [0, 0, 1], "stiffness": 5.0, "free_angle": 0.5}
    assembly = assemble(
        made(
            small(
                bodies={"ground": {"fixed": True}, "a": {"mass": 2.0, "inertia": [1, 1, 1], "angle": 0.2}},
                springs={
                    "turn": {**torsion, "preload": 0.1, "damping": 0.25},
                    "other": {
                        **linear,
                        "a": {"body": "ground", "point": [9, 9, 9]},
                        "b": {"body": "a", "point": [0, 0, 0]},
                    },
                    "push": {
                        **linear,
                        "a": {"body": "ground", "point": [0, 0, 0]},
                        "b": {"body": "a", "point": [0, 0, 0]},
                    },
                    "free": torsion,
                },
                responses={
                    "push": {"type": "spring_force", "spring": "push"},
                    "turn": {"type": "spring_torque", "spring": "turn"},
                    "free": {"type": "spring_torque", "spring": "free"},
                },
            )
        )
    )
    place(assembly, 0, [3, 4, 0], Rotation.from_rotvec([0, 0, 1.2]))
    assembly.state.v[0] = [0.6, 0.8, 5.0, 0.0, 0.0, 2.0]  # the spring of length 5 lengthens at 1
    turn = -5.0 * (1.2 - 0.5 + 0.1) - 0.25 * 2.0
    np.testing.assert_allclose(read(assembly), [2.0 * (7 - 5) - 0.5 * 1, turn, -5.0 * (1.2 - 0.5)], rtol=1e-13)


def test_time_is_the_time_given():
    """At the end of the step."""
    assert read(mechanism({"t": {"type": "time"}}), t=1.25)[0] == 1.25


def test_only_lengths_and_angles_at_the_end_count_for_rest():
    """Speeds, forces, times and what is read earlier go on changing, or have changed, at rest."""
    position = ways("position")["position_point_world"]
    responses = {
        "p": position,
        "peak": {**position, "at": "maximum"},
        "then": {**position, "at": {"response": "clock", "above": 1.0}},
        "clock": {"type": "time"},
        **ways("velocity"),
        **turns(),
    }
    counted = mechanism(responses).model.responses.measures_motion
    assert [name for name, counts in zip(responses, counted, strict=True) if counts] == ["p", "angle"]


ANGLE = {"type": "angle", "body": "b", "axis": [0, 0, 1]}
FORCE = {"type": "contact_force", "contact": "stop"}
STOP = {
    "a": {"body": "ground", "plane": {"point": [0, 0, -99], "normal": [0, 0, 1]}},
    "b": {"body": "b", "point": [0, 0, 0]},
    "friction": 0.1,
}


def report(responses: dict[str, Any], history: list[list[float]], phases: list[int]) -> np.ndarray:
    """Return what is reported after each step of a history.

    ``history`` has a list for each response: what it measures at the start, and after each step.
    """
    two = [{"name": "one", "duration": 1.0}, {"name": "two"}]
    assembly, seen = mechanism(responses, contacts={"stop": STOP}, phases=two), []
    work = assembly.work
    work.reported[:], work.peak[:], work.impact[:] = np.nan, np.nan, 0.0
    for phase, (previous, now) in zip(phases, pairwise(np.array(history).T), strict=True):
        work.values[:], work.previous[:] = now, previous
        update_reported(assembly.model.responses, work, phase, H)
        seen.append(work.reported.tolist())
    return np.array(seen)


NAN = float("nan")
HIGH, LOW, LATER = {"at": "maximum"}, {"at": "minimum"}, {"from_phase": "two"}


def test_the_end_is_the_last_value():
    """Whatever was before."""
    np.testing.assert_array_equal(report({"s": ANGLE}, [[0.0, 3.0, 1.0, 2.0]], [0, 0, 1])[:, 0], [3.0, 1.0, 2.0])


def test_peaks_are_the_largest_and_smallest_values_the_start_included():
    """Of a function of time the value at the start counts like any other."""
    seen = report({"high": ANGLE | HIGH, "low": ANGLE | LOW}, 2 * [[4.0, 3.0, -1.0, 2.0]], [0, 0, 0])
    np.testing.assert_array_equal(seen, [[4.0, 3.0], [4.0, -1.0], [4.0, -1.0]])


def test_a_peak_from_a_phase_begins_where_the_phase_does():
    """The instant between two phases belongs to both."""
    seen = report({"high": ANGLE | HIGH | LATER, "low": ANGLE | LOW}, 2 * [[9.0, 3.0, 1.0, 2.0]], [0, 1, 1])
    np.testing.assert_array_equal(seen, [[NAN, 3.0], [3.0, 1.0], [3.0, 1.0]])


def test_the_force_of_the_step_before_is_no_peak_of_the_phase():
    """A force belongs to its step, and a step to one phase: neither the start nor the last phase's end counts."""
    seen = report({"high": FORCE | HIGH | LATER, "low": FORCE | LOW}, 2 * [[0.0, 9.0, 4.0, 5.0]], [0, 1, 1])
    np.testing.assert_array_equal(seen, [[NAN, 9.0], [4.0, 4.0], [5.0, 4.0]])


def test_the_end_may_be_that_of_a_phase():
    """The value at the end of the first phase stays."""
    seen = report({"s": ANGLE | {"to_phase": "one"}}, [[0.0, 3.0, 1.0, 2.0]], [0, 0, 1])
    np.testing.assert_array_equal(seen[:, 0], [3.0, 1.0, 1.0])


def test_a_peak_to_a_phase_ends_where_the_phase_does():
    """What comes later is not looked at."""
    seen = report({"high": ANGLE | HIGH | {"to_phase": "one"}}, [[0.0, 3.0, 9.0]], [0, 1])
    np.testing.assert_array_equal(seen[:, 0], [3.0, 3.0])


def test_something_else_is_read_at_the_peak_of_a_response():
    """Where the force is largest, from the second phase on; and where an angle is smallest, start included."""
    at_force = ANGLE | {"at": {"response": "f", "peak": "maximum"}} | LATER
    at_low = ANGLE | {"at": {"response": "s", "peak": "minimum"}}
    history = [[9.0, 8.0, 2.0, 5.0, 4.0], [-3.0, 1.0, 0.0, -4.0, 2.0], [10.0, 11.0, 12.0, 13.0, 14.0]]
    seen = report(
        {"f": FORCE, "s": ANGLE, "at_force": at_force, "at_low": at_low}, [*history, history[2]], [0, 1, 1, 1]
    )
    np.testing.assert_array_equal(seen[:, 2], [NAN, 12.0, 13.0, 13.0])
    np.testing.assert_array_equal(seen[:, 3], [10.0, 10.0, 13.0, 13.0])


EVENTS = [
    ({"above": 1.0}, {}, [NAN, 12.5, 12.5, 12.5]),
    ({"above": 0.5}, {}, [NAN, 12.0, 12.0, 12.0]),  # on the limit is not above it
    ({"above": 1.5}, {}, [NAN, NAN, NAN, NAN]),  # reached, and left again
    ({"below": 0.0}, {}, [10.0, 10.0, 10.0, 10.0]),  # already at the start
    ({"below": -1.5}, {}, [NAN, NAN, NAN, NAN]),
    ({"below": -1.0}, LATER, [NAN, NAN, NAN, NAN]),
    ({"above": 0.25}, LATER, [NAN, NAN, 13.0, 13.0]),  # already at the beginning of the phase
    ({"below": 0.25}, LATER, [NAN, NAN, NAN, 17.5]),
]


@each(("limit", "search", "expected"), EVENTS)
def test_an_event_is_the_first_crossing_and_stays(limit, search, expected):
    """Its time lies where the straight line between two steps crosses the limit."""
    event = {"type": "time", "at": {"response": "s", **limit}, **search}
    history = [[-1.0, 0.5, 1.5, 1.5, -1.0], [10.0, 12.0, 13.0, 14.0, 21.0]]
    np.testing.assert_allclose(report({"s": ANGLE, "when": event}, history, [0, 0, 1, 1])[:, 1], expected, rtol=1e-15)


def test_something_else_is_read_at_the_instant_of_an_event():
    """From -2 to -6 over a step, a quarter of which is over at the crossing: -3."""
    then = ANGLE | {"at": {"response": "s", "below": 0.75}}
    seen = report({"s": ANGLE, "then": then}, [[1.0, 1.0, 0.0], [0.0, -2.0, -6.0]], [0, 0])
    np.testing.assert_array_equal(seen[:, 1], [NAN, -3.0])
