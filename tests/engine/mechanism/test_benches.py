"""Test benches and presets: what is added, replaced, taken away and refused."""

import copy
from typing import Any

import pytest

from engine.errors import MechanismError
from engine.mechanism import Mechanism, get_value, load_mechanism, mechanism_from, set_values, settable_keys
from tests.engine.mechanism.plain import pendulum

BENCH: dict[str, Any] = {
    "title": "pull test",
    "without": ["contacts.stop", "responses.load"],
    "plot": {"x": "height", "y": "pull"},
    "simulation": {"step": 2e-3},
    "phases": [{"name": "pull", "until": {"response": "height", "above": 3.0}}, {"name": "hold"}],
    "validity": [],
    "forces": {"hand": {"body": "link", "force": [0, 2, 0], "phases": ["pull"]}},
    "responses": {"pull": {"type": "spring_force", "spring": "pull", "at": {"response": "height", "peak": "maximum"}}},
}


def described(**bench: Any) -> dict[str, Any]:
    """Describe the pendulum with a bench and a preset."""
    data = copy.deepcopy(pendulum())
    data["benches"] = {"test": BENCH | bench}
    data["presets"] = {"worn": {"title": "after a year", "values": {"J1": 0.1, "springs.pull.stiffness": 1.5}}}
    return data


def mechanism(**bench: Any) -> Mechanism:
    """Make it."""
    return mechanism_from(described(**bench), "FILE")


def test_a_bench_adds_replaces_and_takes_away():
    """All else stays, and the mechanism itself is as it was."""
    plain = mechanism()
    tested = plain.on_bench("test")
    assert "stop" in plain.contacts
    assert not tested.contacts
    assert set(tested.responses) == {"height", "pull"}
    assert set(tested.forces) == {"weight", "shake", "hand"}
    assert (tested.simulation.step, tested.simulation.horizon) == (2e-3, 1.0)
    assert tested.simulation.joint_violation == plain.simulation.joint_violation
    assert [phase.name for phase in tested.phases] == ["pull", "hold"]
    assert (tested.name, tested.bench, tested.title) == ("pendulum", "test", "pull test")
    assert (tested.validity, tested.benches, tested.presets) == ((), {}, {})
    assert tested.digest() != plain.digest()


def test_values_set_before_go_with_it():
    """A clearance or stiffness that was changed is changed on the bench, too."""
    tested = set_values(mechanism(), {"J1": 0.2, "springs.pull.stiffness": 7.0}).on_bench("test")
    assert (get_value(tested, "J1"), get_value(tested, "springs.pull.stiffness")) == (0.2, 7.0)
    assert tested.bodies["link"].angle == 0.25


def test_the_numbers_of_benches_and_presets_are_no_keys_of_the_mechanism():
    """They are set on the bench, under the keys that they have there."""
    assert not [key for key in settable_keys(mechanism()) if key.startswith(("benches", "presets"))]
    assert get_value(mechanism().on_bench("test"), "simulation.step") == 2e-3


def test_a_preset_is_a_named_set_of_values():
    """As they can be set."""
    assert mechanism().preset("worn") == {"J1": 0.1, "springs.pull.stiffness": 1.5}


REFUSED = [
    ({"without": ["contacts.stp"]}, "benches.test.without = 'contacts.stp'", "did you mean 'contacts.stop'?"),
    ({"forces": {"hand": {"body": "lnk", "force": [0, 1, 0]}}}, "forces.hand.body = 'lnk'", "did you mean 'link'?"),
    ({"without": ["contacts.stop"]}, "responses.load.contact = 'stop'", "no such contact"),
    ({"plot": {"x": "height", "y": "pul"}}, "plot.y = 'pul'", "did you mean 'pull'?"),
    ({"simulation": {"step": -1}}, "simulation.step = -1 ms", "allowed: > 0"),
    (
        {"phases": [{"name": "pull", "until": {"response": "hight", "above": 1.0}}]},
        "phases.0.until.response = 'hight'",
        "did you mean 'height'?",
    ),
    (
        {"phases": [{"name": "pull", "until": {"response": "pull", "above": 1.0}}]},
        "phases.0.until.response = 'pull'",
        "itself read at a peak or an event",
    ),
]


@pytest.mark.parametrize(("bench", "where", "allowed"), REFUSED, ids=lambda x: str(x)[:40])
def test_a_fault_of_the_whole_has_a_line(bench, where, allowed):
    """It names bench, key and remedy."""
    with pytest.raises(MechanismError) as caught:
        mechanism(**bench).on_bench("test")
    (line,) = [line for line in str(caught.value).splitlines() if where in line]
    assert allowed in line


ORDER = [
    ("motions", "lift", {"phases": ["a", "c"]}, "motions.lift.phases = ['a', 'c']", "phases that follow each other"),
    ("motions", "lift", {"phases": ["b", "c"], "since": "a"}, "motions.lift.since = 'a'", "b or later"),
    (
        "responses",
        "height",
        {"at": "maximum", "from_phase": "c", "to_phase": "b"},
        "responses.height.to_phase = 'b'",
        "c or later",
    ),
]


@pytest.mark.parametrize(("table", "name", "keys", "where", "allowed"), ORDER, ids=lambda x: str(x)[:30])
def test_phases_in_an_impossible_order_are_refused(table, name, keys, where, allowed):
    """A motion that stops and starts again, a law before its motion, a search that ends before it begins."""
    data = copy.deepcopy(pendulum())
    data["phases"] = [{"name": phase} for phase in "abc"]
    data["torques"], data["validity"] = {}, []
    data[table][name] |= keys
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    _, line = str(caught.value).splitlines()
    assert where in line
    assert allowed in line


def test_an_unknown_bench_or_preset_is_refused_with_those_there_are():
    """So is a table that no bench has."""
    with pytest.raises(MechanismError, match=r"'tst'.*'test'"):
        mechanism().on_bench("tst")
    with pytest.raises(MechanismError, match=r"'old'.*worn"):
        mechanism().preset("old")
    with pytest.raises(MechanismError, match=r"incline: .*'x'"):
        load_mechanism("incline").on_bench("x")
    with pytest.raises(MechanismError, match=r"benches\.test\.body"):
        mechanism(body={})
