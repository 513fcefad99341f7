"""The models accept what is right and refuse everything else, naming the key and what is allowed."""

import contextlib
import copy
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import MechanismError
from engine.mechanism import Mechanism, mechanism_from, mechanism_schema, settable_keys
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put


def faults(data: dict[str, Any]) -> list[str]:
    """Return the lines of the one error that ``data`` causes."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    first, *lines = str(caught.value).split("\n")
    assert first == f"FILE: {len(lines)} fault{'s' if len(lines) > 1 else ''}"
    return [line.strip() for line in lines]


def test_what_is_right_is_accepted():
    mechanism = mechanism_from(pendulum(), "FILE")
    assert mechanism.joints["J1"].radii == (1.0, 0.9)
    assert mechanism.joints["J1"].bearing.axis == (0.0, 0.0, 1.0), "directions come out with length 1"
    assert mechanism.bodies["link"].inertia == ((3.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 3.0))
    assert mechanism.bodies["ground"].fixed
    assert [phase.name for phase in mechanism.phases] == ["hold", "free"]
    assert mechanism.response_units() == {"load": "N", "height": "mm"}


def test_defaults():
    data = put(put(pendulum(), "phases", ...), "torques", ...)
    mechanism = mechanism_from(data, "FILE")
    assert [phase.name for phase in mechanism.phases] == ["run"]
    assert mechanism.simulation.tolerance == 1e-8
    assert mechanism.gravity == (0.0, 0.0, 0.0)
    limit = mechanism_from(put(pendulum(), "joints.J1.radial_clearance_limit", ...), "FILE")
    assert limit.joints["J1"].clearance_limit == 0.9, "the smallest journal radius"


def test_contact_sides_do_not_depend_on_the_order_in_the_file():
    stop = pendulum()["contacts"]["stop"]
    there = mechanism_from(put(pendulum(), "contacts.stop", stop), "FILE").contacts["stop"]
    back = {**stop, "a": stop["b"], "b": stop["a"]}
    turned = mechanism_from(put(pendulum(), "contacts.stop", back), "FILE").contacts["stop"]
    assert there.kind == turned.kind == "point-plane"
    assert there.sides == turned.sides
    assert there.sides[0].kind == "point"


def test_contact_law_is_its_own_before_its_material():
    mechanism = mechanism_from(pendulum(), "FILE")
    assert mechanism.contact_law(mechanism.joints["J1"]) == (0.2, 0.1)
    assert mechanism.contact_law(mechanism.contacts["stop"]) == (0.3, 0.0)
    own = mechanism_from(put(pendulum(), "joints.J1.friction", 0), "FILE")
    assert own.contact_law(own.joints["J1"]) == (0.0, 0.1), "friction 0 is a value, not an absence"


TENSOR = [[3.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 3.0]]

REFUSED = [
    ("format", 2, "format = 2", "allowed: 1"),
    ("units", "imperial", "units = 'imperial'", "'mm-g-ms' or 'SI'"),
    ("name", "a b", "name = 'a b'", "letters, digits"),
    ("colour", 1, "colour: unknown key", "contacts"),
    ("bodies.link.mas", 1, "bodies.link.mas: unknown key", "did you mean 'mass'?"),
    ("simulation.stepp", 1, "simulation.stepp: unknown key", "did you mean 'step'?"),
    ("simulation.step", 0, "simulation.step = 0 ms", "allowed: > 0"),
    ("simulation.step", ..., "simulation.step: missing", "the time step"),
    ("simulation.horizon", float("inf"), "simulation.horizon = inf", "not a finite number"),
    ("simulation.tolerance", 0.1, "simulation.tolerance = 0.1", "allowed: <= 0.001"),
    ("phases", [], "phases = []", "empty"),
    ("phases.0.duration", -1, "phases.0.duration = -1 ms", "allowed: > 0"),
    ("phases.1.name", "hold", "phases = 'hold'", "two phases have this name"),
    ("materials.steel_steel.friction", -0.1, "materials.steel_steel.friction = -0.1:", "allowed: >= 0"),
    ("materials.steel_steel.restitution", 1.1, "materials.steel_steel.restitution = 1.1:", "allowed: <= 1"),
    ("bodies.link.mass", 0, "bodies.link.mass = 0 g", "allowed: > 0"),
    ("bodies.link.mass", True, "bodies.link.mass = true", "not a finite number"),
    ("bodies.link.mass", "2", "bodies.link.mass = '2'", "not a finite number"),
    ("bodies.link.mass", 10**400, "bodies.link.mass", "not a finite number"),
    ("bodies.link.mass", ..., "bodies.link.mass: missing", "fixed = true"),
    ("bodies.link.inertia", ..., "bodies.link.inertia: missing", "fixed = true"),
    ("bodies.link.inertia", [1, 2], "bodies.link.inertia = [1, 2]", "three principal moments"),
    ("bodies.link.inertia", [3, 0, 3], "bodies.link.inertia = [3, 0, 3]", "not positive definite"),
    ("bodies.link.inertia", [1, 1, 2.1], "bodies.link.inertia", "triangle inequality"),
    ("bodies.link.inertia", [[3, 0.1, 0], [0, 1, 0], [0, 0, 3]], "bodies.link.inertia", "not symmetric"),
    ("bodies.link.origin", [1, 2], "bodies.link.origin = [1, 2]", "three finite numbers"),
    ("bodies.link.origin", [1, 2, float("nan")], "bodies.link.origin", "three finite numbers"),
    ("bodies.link.axis", [0, 0, 0], "bodies.link.axis = [0, 0, 0]", "has no direction"),
    ("bodies.ground.velocity", [1, 0, 0], "bodies.ground.velocity", "a fixed body does not move"),
    ("bodies.link.outline", [[0, 0], [1, 0]], "bodies.link.outline = [[0, 0], [1, 0]]", "three or more corners"),
    ("bodies.link.outline", [[0, 0], [1, 0], [1]], "bodies.link.outline", "[x, y] or [x, y, z]"),
    ("bodies.link.outline", [[0, 0], [1, 0], [1, float("inf")]], "bodies.link.outline", "finite numbers"),
    ("bodies.link.outline", [], "bodies.link.outline = []", "not a polygon"),
    ("bodies.link.fixed", "yes", "bodies.link.fixed = 'yes'", "not true or false"),
    ("bodies.b c", {"fixed": True}, "bodies.b c", "not a usable name"),
    ("bodies", 3, "bodies = 3", "not a table"),
    ("joints.J1.type", "hinge", "joints.J1.type = 'hinge'", "revolute, clearance_revolute, "),
    ("joints.J1.bearing.body", "lnk", "joints.J1.bearing.body = 'lnk'", "did you mean 'link'?"),
    ("joints.J1.bearing.body", "ground", "joints.J1: both sides are on ground", "two different bodies"),
    ("joints.J1.bearing.axis", [0, 0, 0], "joints.J1.bearing.axis", "has no direction"),
    ("joints.J1.journal.radius", 0, "joints.J1.journal.radius = 0 mm", "a number > 0"),
    ("joints.J1.journal.radius", [1, 2, 3], "joints.J1.journal.radius", "3 radii for 2 rings"),
    ("joints.J1.rings", [], "joints.J1.rings = []", "one or more"),
    ("joints.J1.rings", [1, 1], "joints.J1.rings", "two rings at one station"),
    ("joints.J1.radial_clearance", 0, "joints.J1.radial_clearance = 0.0 mm", "radial_clearance <= 0.3"),
    ("joints.J1.radial_clearance", 0.4, "joints.J1.radial_clearance = 0.4 mm", "radial_clearance <= 0.3"),
    ("joints.J1.material", "stel_steel", "joints.J1.material", "did you mean 'steel_steel'?"),
    ("joints.J1.material", ..., "joints.J1.material: missing", "give friction"),
    ("joints.stop", pendulum()["joints"]["J1"], "contacts.stop: joints.stop has the same name", "rename"),
    ("contacts.stop.b.point", ..., "contacts.stop.b: has no primitive", "exactly one of"),
    ("contacts.stop.a.point", [0, 0, 0], "contacts.stop.a: has point and plane", "exactly one of"),
    ("contacts.stop.a", {"body": "ground", "point": [0] * 3}, "contacts.stop: point against point", "against sphere"),
    ("contacts.stop.a.plane.normal", [0, 0, 0], "contacts.stop.a.plane.normal", "has no direction"),
    ("contacts.stop.friction", ..., "contacts.stop.material: missing", "give friction"),
    ("springs.pull.type", "liner", "springs.pull.type = 'liner'", "did you mean 'linear'?"),
    ("springs.pull.type", ..., "springs.pull.type: missing", "linear, torsion"),
    ("springs.pull.stiffness", 0, "springs.pull.stiffness = 0 N/mm", "allowed: > 0"),
    ("springs.turn.stiffness", -1, "springs.turn.stiffness = -1 N mm/rad", "allowed: > 0"),
    ("springs.turn.a", "grund", "springs.turn.a = 'grund'", "did you mean 'ground'?"),
    ("springs.turn.a", "link", "springs.turn: both sides are on link", "two different bodies"),
    ("springs.pull.b.point", ..., "springs.pull.b.point: missing", "the point"),
    ("forces.weight.frame", "local", "forces.weight.frame = 'local'", "'world' or 'body'"),
    ("torques.brake.phases", ["hld"], "torques.brake.phases = 'hld'", "did you mean 'hold'?"),
    ("responses.load.contact", "stp", "responses.load.contact = 'stp'", "did you mean 'stop'?"),
    ("responses.height.from", {"body": "ground"}, "responses.height.from: needs one reference", "point, axis"),
    ("responses.height.direction.body", "x", "responses.height.direction.body = 'x'", "no such body"),
    ("responses.height.too", 1, "responses.height.too: unknown key", "did you mean 'to'?"),
    ("validity", ["height >"], "validity.0 = 'height >'", "not a condition"),
    ("validity", ["height > nan"], "validity.0 = 'height > nan'", "not a condition"),
    ("validity", ["heigth>0"], "validity = 'heigth>0'", "did you mean 'height'?"),
]


@each(("path", "value", "where", "allowed"), REFUSED)
def test_a_fault_has_a_line_that_names_key_and_remedy(path, value, where, allowed):
    lines = faults(put(pendulum(), path, copy.deepcopy(value)))
    mine = [line for line in lines if line.startswith(where)]
    assert mine, lines
    assert allowed in mine[0]


@pytest.mark.parametrize(("first", "second"), [("plane", "plane"), ("arc", "arc"), ("cylinder", "bore")])
def test_pairs_without_gap_function_are_refused(first, second):
    primitives = {
        "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
        "arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "middle": [1, 0, 0], "radius": 1, "half_angle": 1},
        "cylinder": {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 1},
        "bore": {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 2},
    }
    data = put(pendulum(), "contacts.stop.a", {"body": "ground", first: primitives[first]})
    put(data, "contacts.stop.b", {"body": "link", second: primitives[second]})
    (line,) = faults(data)
    assert line.startswith(f"contacts.stop: {first} against {second} has no gap function")


def test_an_arc_whose_middle_leaves_its_plane_is_refused():
    arc = {"centre": [0, 0, 0], "normal": [0, 0, 1], "middle": [1, 0, 0.1], "radius": 1, "half_angle": 1}
    (line,) = faults(put(pendulum(), "contacts.stop.b", {"body": "link", "arc": arc}))
    assert line.startswith("contacts.stop.b.arc.middle")


def test_two_fixed_bodies_cannot_be_joined():
    data = put(pendulum(), "bodies.wall", {"fixed": True})
    (line,) = faults(put(data, "joints.J1.bearing.body", "wall"))
    assert line.startswith("joints.J1: wall and ground are both fixed")


def test_something_must_move():
    lines = faults(put(pendulum(), "bodies.link.fixed", True))
    assert any(line.startswith("bodies: no body moves") for line in lines)


def test_all_faults_of_a_file_come_at_once_those_of_tables_and_those_between_them():
    data = put(put(pendulum(), "bodies.link.mass", -1), "joints.J1.material", "tin")
    lines = faults(put(data, "responses.load.contact", "door"))
    assert [line.split(" ")[0] for line in lines] == [
        "bodies.link.mass",
        "joints.J1.material",
        "responses.load.contact",
    ]


def test_a_fault_of_references_is_reported_once():
    assert len(faults(put(pendulum(), "joints.J1.material", "tin"))) == 1


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda below: st.lists(below, max_size=3) | st.dictionaries(st.text(max_size=5), below, max_size=3),
    max_leaves=5,
)


@given(key=st.sampled_from(sorted({path for path, *_ in REFUSED if path != "joints.stop"})), value=JSON)
def test_no_value_anywhere_causes_anything_but_a_mechanism_or_its_error(key, value):
    with contextlib.suppress(MechanismError):
        assert isinstance(mechanism_from(put(pendulum(), key, value), "FILE"), Mechanism)


@pytest.mark.parametrize("size", [1e-99, 1e-60, 1.0, 1e60, 1e99])
def test_numbers_of_any_real_size_are_taken_without_overflow(size):
    data = put(pendulum(), "bodies.link.inertia", [2 * size, size, 2 * size])
    mechanism = mechanism_from(put(data, "bodies.link.axis", [0, 0, size]), "FILE")
    assert mechanism.bodies["link"].axis == (0.0, 0.0, 1.0)
    assert mechanism.bodies["link"].inertia[0][0] == 2 * size
    (line,) = faults(put(pendulum(), "bodies.link.inertia", [2 * size, -size, 2 * size]))
    assert "not positive definite" in line


@pytest.mark.parametrize(("size", "text"), [(1e-300, "allowed: all three > 0, from 1e-100"), (1e300, "sizes up to")])
def test_numbers_beyond_any_real_size_are_refused(size, text):
    (line,) = faults(put(pendulum(), "bodies.link.inertia", [2 * size, size, 2 * size]))
    assert text in line


def test_digest_sees_numbers_and_order_but_not_the_order_of_keys():
    base = mechanism_from(pendulum(), "FILE").digest()
    assert len(base) == 64
    assert mechanism_from(dict(reversed(pendulum().items())), "FILE").digest() == base
    assert mechanism_from(put(pendulum(), "bodies.link.mass", 2.0000000001), "FILE").digest() != base
    turned = put(pendulum(), "bodies", dict(reversed(pendulum()["bodies"].items())))
    assert mechanism_from(turned, "FILE").digest() != base


def test_dumped_and_read_again_it_is_the_same():
    mechanism = mechanism_from(pendulum(), "FILE")
    text = mechanism.model_dump_json(by_alias=True, exclude_none=True)
    again = mechanism_from(json.loads(text), "JSON")
    assert again == mechanism
    assert again.digest() == mechanism.digest()


def test_outline_is_a_polygon_of_the_body_frame():
    """Corners without z lie at z = 0; it counts in the digest, is read again, and is no number to be set."""
    plain = mechanism_from(pendulum(), "FILE")
    drawn = mechanism_from(put(pendulum(), "bodies.link.outline", [[0, 0], [1, 0], [1, 2, 3]]), "FILE")
    assert drawn.bodies["link"].outline == ((0, 0, 0), (1, 0, 0), (1, 2, 3))
    assert plain.bodies["link"].outline is None
    assert drawn.digest() != plain.digest()
    assert mechanism_from(drawn.model_dump(by_alias=True, exclude_unset=True), "again") == drawn
    assert settable_keys(drawn) == settable_keys(plain)


def test_validity_condition():
    (condition,) = mechanism_from(pendulum(), "FILE").validity
    assert str(condition) == "height > -5"
    assert condition.holds({"height": -4.9})
    assert not condition.holds({"height": -5.0}), "a limit is not within"
    assert not condition.holds({"height": float("nan")})


def test_schema_names_every_table_and_describes_every_key():
    schema = mechanism_schema()
    assert schema["properties"].keys() >= {"bodies", "joints", "contacts", "springs", "responses"}
    assert schema["additionalProperties"] is False
    tables = [schema, *schema["$defs"].values()]
    for table in tables:
        for key, entry in table.get("properties", {}).items():
            assert "description" in entry, key
    assert schema["$defs"]["Body"]["properties"]["mass"]["x-quantity"] == "mass"
    assert "from" in schema["$defs"]["Position"]["properties"]
