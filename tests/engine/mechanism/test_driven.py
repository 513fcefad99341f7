"""Dampers, laws of time and prescribed motions as a user writes them: what is taken, refused, and can be set."""

import contextlib
import copy
import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import MechanismError
from engine.mechanism import Mechanism, get_value, mechanism_from, mechanism_schema, set_values, settable_keys, unit_of
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put
from tests.engine.mechanism.test_docs import EXAMPLE, PAGE
from tests.engine.mechanism.test_models import JSON, faults

SHAKE, LIFT, SWING = "forces.shake.law", "motions.lift", "motions.swing"
ACTION = "springs.pull.actions.0"
PUSH = {"body": "link", "force": [1.0, 0.0, 0.0]}
TWIST = {"body": "link", "torque": [0.0, 0.0, 1.0]}

REFUSED = [
    ("springs.pull.acts", "press", "springs.pull.acts = 'press'", "'both', 'push' or 'pull'"),
    ("springs.pull.preload", "1", "springs.pull.preload = '1'", "not a finite number"),
    ("springs.pull.actions", {"body": "link"}, "springs.pull.actions: not a list", "a list of actions"),
    (
        "springs.pull.actions",
        [{"body": "link"}],
        f"{ACTION}: which kind is meant?",
        "exactly one of force (a force at a point)",
    ),
    ("springs.pull.actions", [PUSH | TWIST], f"{ACTION}: which kind is meant?", "exactly one of force"),
    ("springs.pull.actions", [PUSH | {"force": [1, 0]}], f"{ACTION}.force", "three finite numbers"),
    ("springs.pull.actions", [TWIST | {"torque": 1}], f"{ACTION}.torque", "three finite numbers"),
    ("springs.pull.actions", [TWIST | {"point": [1, 0, 0]}], f"{ACTION}.point: unknown key", "body, torque"),
    ("springs.pull.actions", [PUSH | {"body": "lnk"}], f"{ACTION}.body = 'lnk'", "did you mean 'link'?"),
    ("springs.pull.actions", [{"force": [1, 0, 0]}], f"{ACTION}.body: missing", "the body that is acted on"),
    ("dampers.grease.actions", [TWIST], "dampers.grease.actions: unknown key", "damping"),
    ("dampers.grease.damping", 0, "dampers.grease.damping = 0 N mm ms/rad", "allowed: > 0"),
    ("dampers.grease.stiffness", 1, "dampers.grease.stiffness: unknown key", "damping"),
    ("dampers.grease.type", "viscous", "dampers.grease.type = 'viscous'", "linear, torsion"),
    ("dampers.grease.b", "lnk", "dampers.grease.b = 'lnk'", "did you mean 'link'?"),
    ("dampers.grease.b", "ground", "dampers.grease: both sides are on ground", "two different bodies"),
    (SHAKE, 3, f"{SHAKE} = 3", "exactly one of table (points of time), amplitude (a sine)"),
    (SHAKE, {}, f"{SHAKE}: which kind is meant?", "exactly one of table"),
    (SHAKE, {"speed": 1}, f"{SHAKE}: which kind is meant?", "exactly one of table"),
    (f"{SHAKE}.table", [[0, 1], [1, 1]], f"{SHAKE}: which kind is meant?", "exactly one of table"),
    (f"{SHAKE}.period", ..., f"{SHAKE}: its rate is missing, or given twice", "exactly one of frequency, period"),
    (f"{SHAKE}.frequency", 2, f"{SHAKE}: its rate is missing, or given twice", "exactly one of frequency, period"),
    (f"{SHAKE}.period", 0, f"{SHAKE}.period = 0 ms", "allowed: > 0"),
    (f"{SHAKE}.amplitud", 1, f"{SHAKE}.amplitud: unknown key", "did you mean 'amplitude'?"),
    (SHAKE, {"table": [[0, 1]]}, f"{SHAKE}.table = [[0, 1]]", "two or more points"),
    (SHAKE, {"table": [0, 1]}, f"{SHAKE}.table = [0, 1]", "points [time, value]"),
    (SHAKE, {"table": [[0, 1], [1, float("nan")]]}, f"{SHAKE}.table", "finite numbers"),
    (SHAKE, {"table": [[0, 1], [2, 1], [2, 0]]}, f"{SHAKE}.table", "time 2 comes after time 2; allowed: increasing"),
    (SHAKE, {"table": [[0, 1], [1, 1]], "interpolation": "cubic"}, f"{SHAKE}.interpolation", "'linear' or 'smooth'"),
    (LIFT, 4, f"{LIFT} = 4", "exactly one of along (a translation), about (a rotation)"),
    (f"{LIFT}.along", ..., f"{LIFT}: which kind is meant?", "exactly one of along"),
    (f"{LIFT}.about", {"axis": [0, 0, 1]}, f"{LIFT}: which kind is meant?", "exactly one of along"),
    (f"{LIFT}.along.direction", [0, 0, 0], f"{LIFT}.along.direction", "has no direction"),
    (f"{LIFT}.along.direction", ..., f"{LIFT}.along.direction: missing", "in the frame of relative_to"),
    (f"{LIFT}.law", ..., f"{LIFT}.law: missing", "{ table }, { speed } or { amplitude, frequency }"),
    (f"{LIFT}.law.table", [[0, 1], [1, 2]], f"{LIFT}.law.table: begins with [0, 1]", "allowed: [0, 0]"),
    (f"{LIFT}.law.table", [[1, 0], [2, 1]], f"{LIFT}.law.table: begins with [1, 0]", "allowed: [0, 0]"),
    (f"{LIFT}.phases", ["hld"], f"{LIFT}.phases = 'hld'", "did you mean 'hold'?"),
    (f"{LIFT}.phases", [], f"{LIFT}.phases = []", "empty"),
    (f"{LIFT}.since", "fre", f"{LIFT}.since = 'fre'", "did you mean 'free'?"),
    (f"{LIFT}.body", "ground", f"{LIFT}: ground and the world are both fixed", "at least one that moves"),
    (f"{SWING}.body", "lnk", f"{SWING}.body = 'lnk'", "did you mean 'link'?"),
    (f"{SWING}.relative_to", "grund", f"{SWING}.relative_to = 'grund'", "did you mean 'ground'?"),
    (f"{SWING}.relative_to", "link", f"{SWING}: both sides are on link", "two different bodies"),
    (f"{SWING}.law.speed", "fast", f"{SWING}.law.speed = 'fast'", "not a finite number"),
]


@each(("path", "value", "where", "allowed"), REFUSED)
def test_a_fault_has_a_line_that_names_key_and_remedy(path, value, where, allowed):
    """One line, and no other."""
    (line,) = faults(put(pendulum(), path, copy.deepcopy(value)))
    assert line.startswith(where)
    assert allowed in line


@given(key=st.sampled_from(sorted({path for path, *_ in REFUSED})), value=JSON)
def test_no_value_anywhere_causes_anything_but_a_mechanism_or_its_error(key, value):
    """No traceback, whatever is written."""
    with contextlib.suppress(MechanismError):
        assert isinstance(mechanism_from(put(pendulum(), key, value), "FILE"), Mechanism)


UNITS = {
    "springs.pull.preload": ("N", "N"),
    "dampers.grease.damping": ("N mm ms/rad", "N m s/rad"),
    "forces.shake.law.amplitude": ("1", "1"),
    "forces.shake.law.mean": ("1", "1"),
    "forces.shake.law.period": ("ms", "s"),
    "forces.shake.law.phase": ("rad", "rad"),
    "motions.swing.law.speed": ("rad/ms", "rad/s"),
    "motions.lift.law.amplitude": ("mm", "m"),
    "motions.lift.law.frequency": ("1/ms", "Hz"),
}


@each("key", UNITS)
def test_every_single_number_can_be_set_in_its_unit(key):
    """Read, set and read back; a translation's amplitude is a length, a rotation's speed an angular speed."""
    data = put(pendulum(), "motions.lift.law", {"amplitude": 2.0, "frequency": 3.0})
    mechanism, si = (mechanism_from(put(data, "units", units), "FILE") for units in ("mm-g-ms", "SI"))
    assert (unit_of(mechanism, key), unit_of(si, key)) == UNITS[key]
    assert key in settable_keys(mechanism)
    assert get_value(set_values(mechanism, {key: 0.7}), key) == 0.7


def test_a_value_is_checked_when_it_is_set():
    """The other numbers of a law are checked with it."""
    mechanism = mechanism_from(pendulum(), "FILE")
    with pytest.raises(MechanismError, match=r"forces\.shake\.law\.period = 0\.0 ms"):
        set_values(mechanism, {"forces.shake.law.period": 0.0})
    with pytest.raises(MechanismError, match=r"motions\.lift\.law\.table"):
        set_values(mechanism, {"motions.lift.law.table": 1.0})


def test_dumped_and_read_again_it_is_the_same():
    """Also where tables are told apart by a key they have."""
    mechanism = mechanism_from(pendulum(), "FILE")
    text = mechanism.model_dump_json(by_alias=True, exclude_none=True)
    assert mechanism_from(json.loads(text), "JSON") == mechanism


def test_a_spring_with_actions_is_set_and_told_apart():
    """Its numbers are set as without; vectors of actions count in the digest, and their components have keys."""
    plain = mechanism_from(pendulum(), "FILE")
    data = put(put(pendulum(), "springs.pull.actions", [PUSH, TWIST]), "springs.turn.actions", [TWIST])
    mechanism = mechanism_from(data, "FILE")
    added = set(settable_keys(mechanism)) - set(settable_keys(plain))
    assert {key.rpartition(".")[0] for key in added} == {
        *("springs.pull.actions.0.point", "springs.pull.actions.0.force", "springs.pull.actions.1.torque"),
        "springs.turn.actions.0.torque",
    }
    assert unit_of(mechanism, "springs.turn.actions.0.torque.z") == "1"
    changed = set_values(mechanism, {"springs.pull.stiffness": 3.0, "springs.turn.preload": 0.2})
    assert get_value(changed, "springs.pull.stiffness") == 3.0
    assert changed.springs["pull"].actions == mechanism.springs["pull"].actions
    other = mechanism_from(put(data, "springs.turn.actions", [TWIST | {"torque": [0.0, 0.0, 1.5]}]), "FILE")
    assert len({plain.digest(), mechanism.digest(), changed.digest(), other.digest()}) == 4
    text = mechanism.model_dump_json(by_alias=True, exclude_none=True)
    assert mechanism_from(json.loads(text), "JSON") == mechanism


def test_schema_says_what_an_action_can_be():
    """A force has no unit beside a force and one per length beside a torque; a torque the other way round."""
    tables = mechanism_schema()["$defs"]
    found = {}
    for spring in ("LinearSpring", "TorsionSpring"):
        choice = tables[spring]["properties"]["actions"]["items"]["oneOf"]
        names = [entry["$ref"].split("/")[-1] for entry in choice]
        keys = [("force", "torque")["torque" in tables[name]["properties"]] for name in names]
        found[spring] = {k: tables[n]["properties"][k]["x-quantity"] for n, k in zip(names, keys, strict=True)}
    assert found == {
        "LinearSpring": {"force": "number", "torque": "length"},
        "TorsionSpring": {"force": "per length", "torque": "number"},
    }


def test_schema_says_what_a_law_a_law_can_be():
    """The choice between the tables, and the physical quantity of each number."""
    schema = mechanism_schema()
    tables = schema["$defs"]
    law = tables["Rotation"]["properties"]["law"]
    assert {entry["$ref"].split("/")[-1] for entry in law["oneOf"]} == {"TurnTable", "TurnSine", "TurnRamp"}
    assert tables["TurnRamp"]["properties"]["speed"]["x-quantity"] == "angular speed"
    assert tables["TravelSine"]["properties"]["amplitude"]["x-quantity"] == "length"
    assert schema["properties"].keys() >= {"dampers", "motions"}


def test_the_motions_of_the_page_load():
    """The reference's motions, put into its example."""
    motions = next(block.split("```")[0] for block in PAGE.split("```toml\n") if block.startswith("[motions."))
    mechanism = mechanism_from(tomllib.loads(EXAMPLE + motions), "example")
    assert list(mechanism.motions) == ["pull", "spin"]
    assert unit_of(mechanism, "motions.spin.law.speed") == "rad/ms"


def test_the_actions_of_the_page_load():
    """The reference's actions, given to the spring of its example."""
    data = tomllib.loads(EXAMPLE)
    block = next(block.split("```")[0] for block in PAGE.split("```toml\n") if block.startswith("actions = "))
    data["springs"]["return"] |= tomllib.loads(block)
    data["bodies"]["plate"] = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    forces = mechanism_from(data, "example").springs["return"].actions
    assert [action.body for action in forces] == ["plate", "lever"]
