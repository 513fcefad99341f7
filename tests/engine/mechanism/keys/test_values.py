"""Numbers are read and set by joint name or dotted path, in the unit the file's system gives them."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import MechanismError
from engine.mechanism import get_value, load_mechanism, mechanism_from, set_values, settable_keys, unit_of
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put

MECHANISM = mechanism_from(pendulum(), "FILE")


def refused(changes, mechanism=MECHANISM):
    """Return the lines with which ``changes`` are refused."""
    with pytest.raises(MechanismError) as caught:
        set_values(mechanism, changes)
    first, *lines = str(caught.value).split("\n")
    assert first == f"mechanism {mechanism.name}: values that cannot be set"
    return [line.strip() for line in lines]


def test_a_joint_name_is_its_radial_clearance():
    changed = set_values(MECHANISM, {"J1": 0.1})
    assert changed.joints["J1"].radial_clearance == 0.1
    assert get_value(changed, "J1") == get_value(changed, "joints.J1.radial_clearance") == 0.1
    assert get_value(MECHANISM, "J1") == 0.05, "the mechanism itself is left as it is"


def test_only_the_tables_on_the_way_are_new():
    changed = set_values(MECHANISM, {"springs.turn.preload": 0.2})
    assert changed.springs["turn"].preload == 0.2
    assert changed.springs["pull"] is MECHANISM.springs["pull"]
    assert changed.bodies is MECHANISM.bodies


UNITS = {
    "J1": ("mm", "m"),
    "joints.J1.radial_clearance_limit": ("mm", "m"),
    "springs.turn.stiffness": ("N mm/rad", "N m/rad"),
    "springs.turn.damping": ("N mm ms/rad", "N m s/rad"),
    "springs.pull.stiffness": ("N/mm", "N/m"),
    "springs.pull.damping": ("N ms/mm", "N s/m"),
    "springs.pull.free_length": ("mm", "m"),
    "materials.steel_steel.friction": ("1", "1"),
    "contacts.stop.friction": ("1", "1"),
    "bodies.link.mass": ("g", "kg"),
    "bodies.link.angle": ("rad", "rad"),
    "simulation.step": ("ms", "s"),
    "simulation.wall_limit": ("s", "s"),
    "phases.0.duration": ("ms", "s"),
    "responses.height.offset": ("mm", "m"),
}


@each("key", UNITS)
def test_units(key):
    si = mechanism_from(put(pendulum(), "units", "SI"), "FILE")
    assert (unit_of(MECHANISM, key), unit_of(si, key)) == UNITS[key]
    assert set_values(MECHANISM, {key: get_value(MECHANISM, key)}) == MECHANISM


def test_settable_keys_are_all_numbers_and_every_one_can_be_set():
    mechanism = load_mechanism("c60")
    keys = settable_keys(mechanism)
    assert keys[:8] == ["J1", "J2", "J3", "J4", "J5", "J6", "J7", "S3"]
    assert "springs.A3.preload" in keys
    assert "materials.plastic_plastic.friction" in keys
    assert "format" not in keys
    follow = mechanism.formulas  # a number with an expression is no longer one once it is set
    same = set_values(mechanism, {key: get_value(mechanism, key) for key in keys if key not in follow})
    assert same.digest() == mechanism.digest(), "putting every number back changes no bit"


@given(st.floats(min_value=1e-6, max_value=0.3))
def test_what_is_set_is_read_back_to_the_last_bit(clearance):
    assert get_value(set_values(MECHANISM, {"J1": clearance}), "J1") == clearance


@pytest.mark.parametrize("number", [np.float64(0.1), np.float32(0.125), np.int64(0) + 0.1, 0.1])
def test_numbers_of_numpy_are_numbers(number):
    assert get_value(set_values(MECHANISM, {"J1": number}), "J1") == float(number)


@each("number", ["0.1", None, True, float("nan"), float("inf"), 10**400, [0.1], np.bool_(True)])
def test_what_is_not_a_finite_number_is_refused(number):
    (line,) = refused({"J1": number})
    assert line.startswith("J1: " if number is None else "J1 = ")
    assert "not a finite number; allowed: a number in mm" in line


@pytest.mark.parametrize("clearance", [0.0, -0.01, 0.31, 1])
def test_a_clearance_outside_the_bore_is_refused_with_the_range(clearance):
    (line,) = refused({"J1": clearance})
    assert line.startswith(f"J1 = {float(clearance)} mm: ")
    assert "allowed: 0 < radial_clearance <= 0.3" in line


@each(
    ("key", "text"),
    [
        ("J2", "unknown key; allowed: a joint (J1), whose clearance"),
        ("joint.J1.radial_clearance", "did you mean 'joints.J1.radial_clearance'?"),
        ("springs.turn.prelaod", "did you mean 'springs.turn.preload'?"),
        ("J1.x", "unknown key"),
        ("", "unknown key"),
        ("..", "unknown key"),
        ("format", "not a single number"),
        ("name", "not a single number"),
        ("joints.J1", "inside it: joints.J1.radial_clearance"),
        ("bodies.link.inertia", "inside it: bodies.link.inertia.xx, bodies.link.inertia.xy, "),
        ("bodies.link.origin.0", "bodies.link.origin has x, y, z; did you mean 'bodies.link.origin.x'?"),
        ("bodies.link.inertia.zy", "did you mean 'bodies.link.inertia.yz'?"),
        ("bodies.link.inertia.y", "did you mean 'bodies.link.inertia.yy'?"),
        ("joints.J1.rings.2", "joints.J1.rings has 0, 1"),
        ("J1.bearing.point.x", "did you mean 'joints.J1.bearing.point.x'?"),
        ("pull.stifness", "did you mean 'springs.pull.stiffness'?"),
        ("stiffness", "did you mean 'springs.pull.stiffness'?"),
        ("bodies.link.mass.x", "bodies.link.mass has nothing inside"),
        ("bodies.ground.center_of_mass.x", "the body ground is fixed, and its center_of_mass has no effect"),
        ("joints.J1.journal.radius", "not a single number"),
        ("joints.J1.friction", "has no number in this mechanism"),
        ("phases.1.duration", "has no number in this mechanism"),
        ("phases.7.duration", "unknown key"),
    ],
)
def test_what_is_no_single_number_is_refused(key, text):
    (line,) = refused({key: 0.1})
    assert line.startswith(f"{key}: ")
    assert text in line
    for read in (get_value, unit_of):
        with pytest.raises(MechanismError, match=text.split(" (")[0].replace("?", r"\?")):
            read(MECHANISM, key)


COMPONENTS = {
    "gravity.y": "mm/ms2",
    "bodies.link.origin.z": "mm",
    "bodies.link.center_of_mass.y": "mm",
    "bodies.link.velocity.x": "mm/ms",
    "bodies.link.axis.x": "1",
    "bodies.link.inertia.xy": "g mm2",
    "joints.J1.bearing.point.x": "mm",
    "joints.J1.bearing.axis.x": "1",
    "joints.J1.journal.radius.1": "mm",
    "joints.J1.rings.0": "mm",
    "contacts.stop.a.plane.normal.x": "1",
    "contacts.stop.b.point.y": "mm",
    "springs.turn.axis.y": "1",
    "forces.weight.force.x": "N",
    "torques.brake.torque.z": "N mm",
    "motions.lift.law.table.1.0": "ms",
    "motions.lift.law.table.1.1": "mm",
    "responses.height.from.axis.point.x": "mm",
    "responses.height.direction.vector.z": "1",
}


@each("key", COMPONENTS)
def test_a_component_is_set_as_if_it_were_typed_in(key):
    """A mechanism with the number in its file is the same, bit for bit; the other components stay as written."""
    *tables, last = key.split(".")
    data, typed = pendulum(), pendulum()
    owner = ".".join(tables)
    if owner in ("gravity", "bodies.link.velocity", "bodies.link.center_of_mass", "bodies.link.axis"):
        for one in (data, typed):
            put(one, owner, [0.0, 0.0, 0.5])
    if owner == "bodies.link.inertia":
        put(typed, owner, [[3.0, 0.7, 0.0], [0.7, 1.0, 0.0], [0.0, 0.0, 3.0]])
    else:
        put(typed, f"{owner}.{'xyz'.index(last) if last in 'xyz' else last}", 0.7)
    mechanism = mechanism_from(data, "FILE")
    changed = set_values(mechanism, {key: 0.7})
    assert changed == mechanism_from(typed, "FILE")
    assert changed.digest() == mechanism_from(typed, "FILE").digest() != mechanism.digest()
    assert (get_value(changed, key), unit_of(mechanism, key)) == (0.7, COMPONENTS[key])
    assert key in settable_keys(mechanism)


def test_components_of_a_direction_are_those_of_the_file():
    """A direction has length 1 for the engine; it is set by the vector that was written, all components at once."""
    mechanism = mechanism_from(pendulum(), "FILE")
    assert get_value(mechanism, "joints.J1.bearing.axis.z") == 2.0
    changed = set_values(mechanism, {"joints.J1.bearing.axis.x": 3.0, "joints.J1.bearing.axis.z": 4.0})
    assert changed.joints["J1"].bearing.axis == (3.0 / 5.0, 0.0, 4.0 / 5.0)
    assert refused({"joints.J1.bearing.axis.z": 0.0}) == [
        "joints.J1.bearing.axis.z = 0.0: has no direction; allowed: any vector but [0, 0, 0]; write the direction"
    ]


def test_components_that_only_fit_together_are_set_together():
    """An inertia that would break the triangle inequality on the way, and directions that are perpendicular."""
    moments = {"bodies.link.inertia.xx": 30.0, "bodies.link.inertia.yy": 10.0, "bodies.link.inertia.zz": 30.0}
    assert np.diag(np.array(set_values(MECHANISM, moments).bodies["link"].inertia)).tolist() == [30.0, 10.0, 30.0]
    (line,) = refused({"bodies.link.inertia.xx": 30.0})
    assert line.startswith("bodies.link.inertia.xx = 30.0 g mm2: breaks the triangle inequality")


def test_an_outline_is_no_number_of_the_motion():
    """It is refused with the reason, and not listed."""
    drawn = mechanism_from(put(pendulum(), "bodies.link.outline", [[0, 0], [1, 0], [1, 1]]), "FILE")
    (line,) = refused({"bodies.link.outline.1.0": 2.0}, drawn)
    assert "an outline is drawn, and has no effect on the motion" in line
    assert not [key for key in settable_keys(drawn) if "outline" in key]


def test_a_value_that_breaks_another_names_both():
    (line,) = refused({"joints.J1.radial_clearance_limit": 0.01})
    where = "joints.J1.radial_clearance_limit = 0.01 mm: then joints.J1.radial_clearance = 0.05 mm: "
    assert line.startswith(where)


def test_all_faults_come_at_once():
    lines = refused({"J1": 0, "J9": 1, "bodies.link.mass": -1, "springs.turn.preload": 0.3})
    assert [line.split(" ")[0] for line in lines] == ["J1", "J9:", "bodies.link.mass"]


def test_setting_the_clearances_of_a_sample_is_quick():
    """Once for each sample of a campaign: some 140 calls of functions, about 0.05 ms; to check all anew takes more."""
    mechanism = load_mechanism("c60")
    values = {f"J{i}": 0.05 for i in range(1, 8)}
    assert _calls(set_values, mechanism, values) < 300
    assert _calls(mechanism_from, mechanism.model_dump(by_alias=True, exclude_unset=True), "FILE") > 2000


def _calls(function, *arguments):
    """Return how many functions of Python a call calls."""
    called, before = [], sys.getprofile()
    sys.setprofile(lambda frame, event, argument: called.append(frame.f_code) if event == "call" else None)
    try:
        function(*arguments)
    finally:
        sys.setprofile(before)
    return len(called)


def test_one_number_is_set_once():
    """A joint's name and its path are one key; the same number under both is no contradiction."""
    (line,) = refused({"J1": 0.1, "joints.J1.radial_clearance": 0.2})
    assert line == "joints.J1.radial_clearance: J1 stands for the same number; set it once"
    assert get_value(set_values(MECHANISM, {"J1": 0.1, "joints.J1.radial_clearance": 0.1}), "J1") == 0.1
