"""What is wrong, as data: its parts, and the line that is made from them."""

import pickle

import pytest

from engine import MechanismError, load_mechanism, load_mechanism_text, set_values
from engine.errors import LONGEST_FAULT, Fault
from tests.engine.mechanism.test_load import MINIMAL

PARTS = {
    "out of range; allowed: > 0; give the mass": ("out of range", "> 0", "give the mass"),
    "unknown key; allowed here: a, b; did you mean 'a'?": ("unknown key", "a, b", "did you mean 'a'?"),
    "not a vector; allowed: three numbers [x, y, z]": ("not a vector", "three numbers [x, y, z]", ""),
    "allowed: up to 60 letters; rename the campaign": ("", "up to 60 letters", "rename the campaign"),
    "missing; add it": ("missing", "", "add it"),
    "missing; it is the name; add it": ("missing; it is the name", "", "add it"),
    "empty": ("empty", "", ""),
}


@pytest.mark.parametrize("text", PARTS)
def test_parts_of_a_text(text):
    """What is wrong; what is allowed; what to do."""
    fault = Fault(("a",), text)
    assert (fault.what, fault.allowed, fault.remedy) == PARTS[text]


def test_the_line():
    """Key, value with unit, text; without key or value where there is none; one line whatever it holds."""
    assert str(Fault(("bodies", "a", "mass"), "no", -1.0, "g")) == "bodies.a.mass = -1.0 g: no"
    assert str(Fault(("x",), "no", True, "1")) == "x = true: no"
    assert str(Fault(("J1",), "no", others=("J2",))) == "J1, J2: no"
    assert str(Fault((), "the whole\nfile")) == "the whole\\nfile"
    assert len(str(Fault(("x",), "no", "y" * 5000))) < 100
    assert len(str(Fault(("x",), "no" * 5000))) <= LONGEST_FAULT


def test_plain_data():
    """What a program gets."""
    inner = Fault(("a",), "missing; add it")
    fault = Fault(("mechanism",), "bad; allowed: good; mend it", "a.toml", within=(inner,), line=3, column=1)
    assert fault.to_json() == {
        "keys": ["mechanism"],
        "value": "'a.toml'",
        "text": "bad; allowed: good; mend it",
        "what": "bad",
        "allowed": "good",
        "remedy": "mend it",
        "line": 3,
        "column": 1,
        "others": [],
        "within": [inner.to_json()],
        "said": "mechanism = 'a.toml': bad; allowed: good; mend it",
    }


def faults_of_text(text):
    """Return the faults of a mechanism's text, after checking that the message is made from them."""
    with pytest.raises(MechanismError) as refused:
        load_mechanism_text(text, "m.toml")
    error = pickle.loads(pickle.dumps(refused.value))
    assert error.faults == refused.value.faults
    said = [str(fault) for fault in error.faults]
    assert str(error) in ("\n  ".join([str(error).split("\n")[0], *said]), f"m.toml: {said[0]}")
    return error.faults


def test_faults_of_a_mechanism_know_key_and_line():
    """Of tables, of references between them, of parameters, and of what is no TOML."""
    [fault] = faults_of_text(MINIMAL.replace("mass = 1", "mass = -1"))
    assert (fault.keys, fault.value, fault.unit, fault.allowed) == (("bodies", "ball", "mass"), -1, "kg", "> 0")
    assert MINIMAL.split("\n")[fault.line - 1] == "mass = 1"
    joint = (
        '[joints.J]\ntype = "revolute"\na = {body = "ball", point = [0, 0, 0]}\nb = {body = "bal", point = [0, 0, 0]}'
    )
    found = {fault.keys: fault for fault in faults_of_text(f"{MINIMAL}{joint}\naxis = [0, 0, 1]\n")}
    assert all(fault.line > len(MINIMAL.splitlines()) for fault in found.values())
    [fault] = faults_of_text(MINIMAL + '[parameters]\n"a b" = 1\n')
    assert (fault.keys, fault.line) == (("parameters", "a b"), MINIMAL.count("\n") + 2)
    [fault] = faults_of_text("a = 1\n b = = 2\n")
    assert (fault.keys, fault.line, fault.column) == ((), 2, 6)
    [fault] = faults_of_text("a = [1,")
    assert (fault.line, fault.column) == (1, 8)
    [fault] = faults_of_text("a = 1\nb = [[[[[[[[[[[[[[[[[[[")
    assert fault.line == 2


def test_faults_of_values_that_are_set():
    """A form marks the fields whose numbers are refused."""
    with pytest.raises(MechanismError) as refused:
        set_values(load_mechanism("c60"), {"J1": -1.0, "springs.A3.stiffness": 1.0, "J9": 1.0, "J2": float("nan")})
    faults = refused.value.faults
    assert [fault.key for fault in faults] == ["J1", "J9", "J2"]
    assert [fault.shown for fault in faults] == ["-1.0 mm", "", "nan"]
    assert str(refused.value).split("\n  ")[1:] == [str(fault) for fault in faults]
