"""Expressions in a mechanism file: numbers that follow from parameters, wherever the file has a number."""

import copy
import json

import pytest

from engine.errors import MechanismError
from engine.mechanism import get_value, load_mechanism, mechanism_from, set_values, settable_keys, unit_of
from engine.mechanism.keys.key_paths import following
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put


def with_parameters(**parameters):
    """Return the pendulum with a length that is used in five tables, in numbers and in lists of numbers."""
    data = put(pendulum(), "parameters", {"length": 8.0, "half": "length / 2", **parameters})
    put(data, "contacts.stop.b.point", [0, "-length", 0])
    put(data, "springs.pull.b.point", [0, "-half", 0])
    put(data, "bodies.link.inertia", ["3.0 * half / 4", 1.0, "3*half/4"])
    put(data, "bodies.link.center_of_mass", [0, "-half", "0 * half"])
    put(data, "responses.height.to.point", [0, "-length", 0])
    put(data, "joints.J1.journal.radius", [1.0, "length/8 - 0.1"])
    put(data, "motions.lift.law.table", [[0, 0], [0.5, "half/2"]])
    return data


FORMULAS = {
    "parameters.half": "length / 2",
    "bodies.link.inertia.xx": "3.0 * half / 4",
    "bodies.link.inertia.zz": "3*half/4",
    "bodies.link.center_of_mass.y": "-half",
    "bodies.link.center_of_mass.z": "0 * half",
    "joints.J1.journal.radius.1": "length/8 - 0.1",
    "contacts.stop.b.point.y": "-length",
    "springs.pull.b.point.y": "-half",
    "motions.lift.law.table.1.1": "half/2",
    "responses.height.to.point.y": "-length",
}


def typed(length):
    """Return the same with every number typed in."""
    data = put(pendulum(), "contacts.stop.b.point", [0, -length, 0])
    half = length / 2
    put(data, "springs.pull.b.point", [0, -half, 0])
    put(data, "bodies.link.inertia", [3.0 * half / 4, 1.0, 3 * half / 4])
    put(data, "bodies.link.center_of_mass", [0, -half, 0 * half])
    put(data, "responses.height.to.point", [0, -length, 0])
    put(data, "joints.J1.journal.radius", [1.0, length / 8 - 0.1])
    put(data, "motions.lift.law.table", [[0, 0], [0.5, half / 2]])
    return mechanism_from(data, "typed")


def numbers(mechanism):
    """Return every number but the parameters."""
    return {key: get_value(mechanism, key) for key in settable_keys(mechanism) if not key.startswith("parameters.")}


@pytest.mark.parametrize("length", [8.0, 7.3, 9.1])
def test_setting_a_parameter_is_typing_its_numbers_in(length):
    """To the last bit, also of what follows from what follows from it; everything else stays."""
    mechanism = mechanism_from(with_parameters(), "FILE")
    assert mechanism.formulas == FORMULAS
    changed = set_values(mechanism, {"parameters.length": length})
    assert numbers(changed) == numbers(typed(length))
    assert (get_value(changed, "parameters.half"), unit_of(changed, "parameters.half")) == (length / 2, "mm")
    assert numbers(mechanism) == numbers(typed(8.0)), "the mechanism itself is left as it is"


def test_dumped_and_read_again_its_parameters_still_vary():
    """In a plan, in a trajectory and on a bench; also after values were set."""
    mechanism = set_values(mechanism_from(with_parameters(), "FILE"), {"parameters.length": 7.0})
    again = mechanism_from(json.loads(mechanism.model_dump_json(by_alias=True, exclude_none=True)), "JSON")
    assert (again, again.formulas, again.digest()) == (mechanism, FORMULAS, mechanism.digest())
    assert numbers(set_values(again, {"parameters.length": 9.0})) == numbers(typed(9.0))
    bench = {"test": {"contacts": {"stop": {**with_parameters()["contacts"]["stop"], "offset": "margin"}}}}
    bench["test"]["parameters"] = {"margin": "length / 100"}
    tested = mechanism_from(put(with_parameters(), "benches", bench), "FILE").on_bench("test")
    assert get_value(tested, "contacts.stop.offset") == 0.08
    assert get_value(set_values(tested, {"parameters.length": 9.0}), "contacts.stop.offset") == 0.09


def test_a_number_that_is_set_itself_follows_no_longer():
    """As when it is typed into the file in the place of its expression."""
    mechanism = mechanism_from(with_parameters(), "FILE")
    changed = set_values(mechanism, {"contacts.stop.b.point.y": -8.5, "parameters.length": 9.0})
    assert get_value(changed, "contacts.stop.b.point.y") == -8.5
    assert get_value(changed, "responses.height.to.point.y") == -9.0
    assert "contacts.stop.b.point.y" not in changed.formulas
    assert get_value(set_values(mechanism, {"parameters.half": 1.0}), "springs.pull.b.point.y") == -1.0


def test_what_follows_from_a_parameter():
    """Directly, and through other parameters; nothing else."""
    assert following(FORMULAS, ["length"]) == {key: {"length"} for key in FORMULAS}
    assert following(FORMULAS, ["half"]).keys() == {key for key, text in FORMULAS.items() if "half" in text}


@pytest.mark.parametrize(
    ("length", "said"),
    [
        (0.0, "parameters.length = 0.0 mm: then bodies.link.inertia.xx = 0: not positive definite"),
        (0.8, "parameters.length = 0.8 mm: then joints.J1.journal.radius.1 = 0: not a radius"),
        (1e101, "parameters.length = 1e+101 mm: implausible for a physical quantity"),
    ],
)
def test_a_refusal_names_the_parameter_and_what_follows(length, said):
    """And the limit that is broken there."""
    with pytest.raises(MechanismError) as caught:
        set_values(mechanism_from(with_parameters(), "FILE"), {"parameters.length": length})
    assert said in str(caught.value)


def faults(data):
    """Return the lines of the error that a file causes."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    return [line.strip() for line in str(caught.value).split("\n")[1:]]


@each(
    ("path", "value", "said"),
    [
        ("parameters.width", 3.0, "parameters.width = 3.0: is not used; write"),
        ("bodies.link.mass", "lenght", "bodies.link.mass = 'lenght': not a finite number, nor is lenght a parameter"),
        ("bodies.link.mass", "1/0", "bodies.link.mass = '1/0': 1 / 0 is not a finite number"),
        ("bodies.link.mass", "-half", "bodies.link.mass = -4.0 g: out of range; allowed: > 0"),
        ("bodies.link.mass", "length", "parameters.length = 8.0: is in g in bodies.link.mass and in mm in "),
        ("bodies.link.origin", ["lenght", 0, 1], "bodies.link.origin.0 = 'lenght': not a finite number"),
        ("motions.lift.law.table", [[0, 0], [1, "x"]], "motions.lift.law.table.1.1 = 'x': not a finite number"),
        ("simulation.penetration", "nothing", "simulation.penetration = 'nothing': not a finite number"),
        ("parameters", {"length": "half", "half": "length"}, "follows from itself"),
        ("parameters", 3, "parameters = 3: not a table"),
    ],
)
def test_faults_of_a_file(path, value, said):
    """The key, the expression, and what to do."""
    assert [line for line in faults(put(with_parameters(), path, copy.deepcopy(value))) if said in line]


def test_all_expressions_at_fault_are_listed():
    """Of one table and of several."""
    data = put(put(with_parameters(), "bodies.link.mass", "x"), "bodies.link.angle", "y")
    assert len(faults(put(data, "springs.pull.stiffness", "1/0"))) == 3


def test_units_follow_from_use():
    """Of a parameter alone or in a sum; in a sine it is an angle; a factor may have any unit."""
    data = with_parameters(tilt=0.1, density=0.25, play=0.05)
    put(data, "bodies.link.mass", "density * length")
    put(data, "springs.turn.axis", ["sin(tilt)", 0, "cos(tilt)"])
    put(data, "joints.J1.radial_clearance", "play")
    mechanism = mechanism_from(data, "FILE")
    assert mechanism.parameter_units == {**{"length": "mm", "half": "mm", "tilt": "rad", "density": "1", "play": "mm"}}


def test_a_parameter_of_a_bench_alone_is_used():
    """The mechanism without the bench has nothing that follows from it."""
    data = put(pendulum(), "parameters", {"pull": 2.0})
    put(data, "benches", {"test": {"forces": {"weight": {"body": "link", "force": [0, "-pull", 0]}}}})
    mechanism = mechanism_from(data, "FILE")
    assert get_value(mechanism.on_bench("test"), "forces.weight.force.y") == -2.0


def test_without_parameters_nothing_of_them_is_written():
    """So the digest of a file without parameters is what it was."""
    assert "parameters" not in load_mechanism("four_bar").model_dump()
    assert "parameters" in load_mechanism("lever").model_dump()
