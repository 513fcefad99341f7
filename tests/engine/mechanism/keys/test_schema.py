"""The JSON Schema takes an expression wherever the file format takes a number, and nowhere else."""

import tomllib
from importlib.resources import files

import jsonschema
import pytest

from engine.mechanism import mechanism_schema
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put

SCHEMA = mechanism_schema()


def valid(data):
    """Return whether a file is valid by the schema."""
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(data)


def test_the_shipped_lever_is_valid():
    """Its expressions stand in single numbers, in vectors and in an inertia."""
    assert valid(tomllib.loads(files("engine.mechanism").joinpath("library", "lever.toml").read_text("utf-8")))
    assert valid(pendulum())


@each(
    ("path", "expression"),
    [
        ("bodies.link.mass", "a"),
        ("bodies.link.inertia", ["a", 1, "b"]),
        ("joints.J1.journal.radius", ["a", "b"]),
        ("joints.J1.radial_clearance", "a / 2"),
        ("gravity", [0, "-a", 0]),
        ("motions.lift.law.table", [[0, 0], ["a", "b"]]),
        ("parameters", {"a": 1.0, "b": "a / 2"}),
        ("phases.0.duration", "a"),
    ],
)
def test_an_expression_may_stand_for_a_number(path, expression):
    """In every kind of list, too."""
    assert valid(put(pendulum(), path, expression))


@pytest.mark.parametrize(("path", "value"), [("bodies.link.fixed", "a"), ("format", "1"), ("bodies.link.mass", True)])
def test_not_for_anything_else(path, value):
    """A truth and a version are no numbers, and a truth is no expression."""
    assert not valid(put(pendulum(), path, value))


def test_presets_have_numbers():
    """They set parameters, and use none."""
    assert valid(put(pendulum(), "presets", {"worn": {"values": {"J1": 0.1}}}))
    assert not valid(put(pendulum(), "presets", {"worn": {"values": {"J1": "a"}}}))
    assert SCHEMA["$defs"]["Body"]["properties"]["mass"]["x-quantity"] == "mass"
