"""The list of keys says of every number what it is, and how it may be set."""

from engine.mechanism import load_mechanism, mechanism_from, set_values, settable_keys, unit_of
from engine.mechanism.keys.values import settable_numbers
from tests.engine.mechanism.plain import pendulum


def test_every_key_is_listed_and_has_unit_and_meaning():
    """Those of `settable_keys`, in the order of the file's tables; each can be set to the value that is listed."""
    for name in ("c60", "lever"):
        mechanism = load_mechanism(name)
        entries = settable_numbers(mechanism)
        keys = [entry.key for entry in entries]
        assert keys == [key for key in settable_keys(mechanism) if key not in mechanism.joints]
        assert all(entry.unit == unit_of(mechanism, entry.key) for entry in entries[::20])
        assert [entry.key for entry in entries if not entry.description] == []
        assert set_values(mechanism, {entry.key: entry.value for entry in entries if not entry.expression}) == mechanism
        tables = list(dict.fromkeys(key.partition(".")[0] for key in keys))
        assert tables == [field for field in type(mechanism).model_fields if field in tables]


def test_limits():
    """As they are declared, and of a radial clearance what the bore allows."""
    mechanism = mechanism_from(pendulum(), "FILE")
    limits = {entry.key: (entry.lower, entry.upper, entry.limits) for entry in settable_numbers(mechanism)}
    assert limits["joints.J1.radial_clearance"] == (0.0, 0.3, "> 0, <= 0.3")
    assert limits["materials.steel_steel.restitution"] == (0.0, 1.0, ">= 0, <= 1")
    assert limits["bodies.link.mass"] == (0.0, None, "> 0")
    assert limits["joints.J1.journal.radius.0"] == (0.0, None, "> 0")
    assert limits["bodies.link.angle"] == (None, None, "")


def test_filter():
    """A part of the key, a pattern of the whole key, or the name of a joint."""
    mechanism = load_mechanism("c60")
    assert [entry.key for entry in settable_numbers(mechanism, "A3.PRE")] == ["springs.A3.preload"]
    both = [entry.key for entry in settable_numbers(mechanism, "*.A?.preload")]
    assert both == ["springs.A2.preload", "springs.A3.preload"]
    assert "joints.J1.radial_clearance" in [entry.key for entry in settable_numbers(mechanism, "J1")]
    assert [entry.short for entry in settable_numbers(mechanism, "J[12]")] == ["J1", "J2"]
    assert settable_numbers(mechanism, "no such") == []


def test_what_follows_from_parameters_says_so():
    """And a parameter says where it is used; settings of a simulation do not vary."""
    entries = {entry.key: entry for entry in settable_numbers(load_mechanism("lever"))}
    assert entries["forces.load.point.x"].expression == "long"
    assert entries["parameters.load"].description == "used in forces.load.force.y"
    assert (entries["parameters.load"].unit, entries["parameters.long"].unit) == ("N", "mm")
    assert [entries[key].varies for key in ("simulation.step", "parameters.long")] == [False, True]
