"""Joints as a user writes them: one word between ideal and loose, what each needs, what is refused."""

import copy
import math
from typing import Any

import pytest

from engine.errors import MechanismError
from engine.mechanism import Mechanism, full_key, get_value, mechanism_from, set_values, settable_keys, unit_of
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put
from tests.engine.mechanism.test_models import faults

LINE = {"point": [0, 0, 0], "axis": [0, 0, 1]}
JOINTS: dict[str, dict[str, Any]] = {
    "revolute": {
        "bearing": {"body": "link", **LINE},
        "journal": {"body": "ground", **LINE, "radius": 1.0},
        "rings": [-1.0, 1.0],
        "radial_clearance": 0.05,
        "flanges": {"radius": 2.0, "phase": 0.5},
        "axial_clearance": 0.1,
        "material": "steel_steel",
    },
    "cylindrical": {
        "bearing": {"body": "link", **LINE},
        "journal": {"body": "ground", **LINE, "radius": 1.0},
        "rings": [-1.0, 1.0],
        "radial_clearance": 0.05,
        "friction": 0.1,
    },
    "prismatic": {
        "guide": {"body": "ground", **LINE, "normal": [0, 1, 0]},
        "slider": {"body": "link", **LINE, "normal": [0, 1, 0]},
        "block": {"half_length": 2.0, "half_height": 0.5, "half_width": 1.0},
        "clearance": 0.05,
        "width_clearance": 0.1,
        "friction": 0.1,
    },
    "spherical": {
        "socket": {"body": "link", "point": [0, 0, 0]},
        "ball": {"body": "ground", "point": [0, 0, 0], "radius": 3.0},
        "radial_clearance": 0.05,
        "friction": 0.1,
    },
}
IDEAL: dict[str, dict[str, Any]] = {
    "fixed": {"a": {"body": "link", "point": [0, 0, 0]}, "b": {"body": "ground", "point": [0, 0, 1]}},
    "planar": {
        "a": {"body": "link", "point": [0, 0, 0], "normal": [0, 0, 1]},
        "b": {"body": "ground", "point": [0, 0, 1], "normal": [0, 0, 1]},
    },
}
SHAFT = {"radius": 0.5, "rings": [-1.0, 1.0]}


def with_joint(kind: str, **changes: Any) -> dict[str, Any]:
    """Describe the pendulum with one joint of the type ``kind``; a change to ... removes the key."""
    joint = copy.deepcopy((JOINTS | IDEAL)[kind.removeprefix("clearance_")])
    data = put(pendulum(), "joints", {"J1": {"type": kind, **joint}})
    for key, value in changes.items():
        put(data, f"joints.J1.{key.replace('__', '.')}", value)
    return data


def loaded(kind: str, **changes: Any) -> Mechanism:
    """Check the pendulum with that joint."""
    return mechanism_from(with_joint(kind, **changes), "FILE")


@pytest.mark.parametrize("kind", JOINTS)
def test_one_word_between_ideal_and_loose(kind):
    """Both load, and say which they are; nothing else in the table differs."""
    loose, ideal = loaded(f"clearance_{kind}").joints["J1"], loaded(kind).joints["J1"]
    assert (loose.ideal, ideal.ideal) == (False, True)
    assert {key for key in loose.entries() if loose.entries()[key] != ideal.entries()[key]} == {"type"}
    assert [side.body for side in loose.sides] == [side.body for side in ideal.sides]


@pytest.mark.parametrize("kind", IDEAL)
def test_joints_without_a_loose_form(kind):
    """They load as they are; with the prefix the type is unknown."""
    assert loaded(kind).joints["J1"].ideal
    data = put(with_joint(kind), "joints.J1.type", f"clearance_{kind}")
    assert f"joints.J1.type = 'clearance_{kind}': unknown type; allowed: revolute, " in faults(data)[0]


@pytest.mark.parametrize(("kind", "key"), [("revolute", "radial_clearance"), ("prismatic", "clearance")])
def test_a_joints_name_is_its_clearance(kind, key):
    """The name reads and sets the clearance of the loose form, in its unit."""
    mechanism = loaded(f"clearance_{kind}")
    assert get_value(mechanism, "J1") == get_value(mechanism, f"joints.J1.{key}") == 0.05
    assert full_key(mechanism, "J1") == f"joints.J1.{key}"
    assert get_value(set_values(mechanism, {"J1": 0.06}), "J1") == 0.06
    assert unit_of(mechanism, "J1") == "mm"
    assert settable_keys(mechanism)[0] == "J1"


@pytest.mark.parametrize("kind", JOINTS)
def test_clearances_set_alone_are_those_set_with_all_else_checked(kind):
    """By a joint's name only its play is checked, by the dotted path its whole table: both give and refuse the same."""
    mechanism = loaded(f"clearance_{kind}")
    limit = getattr(mechanism.joints["J1"], "clearance_limit", 1e100)
    for number in (0.01, limit, math.nextafter(limit, math.inf), 1e-100, 1e-101, 1e-320, 0.0, -0.1, 1e101):
        quick, thorough = (_changed_or_refused(mechanism, key, number) for key in ("J1", full_key(mechanism, "J1")))
        assert quick == thorough, number


def _changed_or_refused(mechanism: Mechanism, key: str, number: float) -> Any:
    """Return the mechanism with another number as data, or the message that refuses it without its key."""
    try:
        return set_values(mechanism, {key: number}).model_dump()
    except MechanismError as error:
        return str(error).replace(f"{key} = ", "")


def test_further_clearances_have_keys_of_their_own():
    """Axial and width clearance, and the angle of the flange's points."""
    assert (
        set_values(loaded("clearance_revolute"), {"joints.J1.axial_clearance": 0.2}).joints["J1"].axial_clearance == 0.2
    )
    mechanism = loaded("clearance_revolute")
    assert unit_of(mechanism, "joints.J1.flanges.phase") == "rad"
    assert unit_of(mechanism, "joints.J1.axial_clearance") == "mm"
    assert get_value(loaded("clearance_prismatic"), "joints.J1.width_clearance") == 0.1


@pytest.mark.parametrize("kind", [*JOINTS, *IDEAL])
def test_of_an_ideal_joint_only_points_and_axes_can_be_set(kind):
    """Its clearance is refused with the word to change: of its numbers only those that have an effect are keys."""
    mechanism = loaded(kind)
    keys = [key.split(".") for key in settable_keys(mechanism) if "J1" in key]
    direction = "normal" if kind == "planar" else "axis"
    assert {(side, what) for _, _, side, what, _ in keys} <= {
        (side, what) for side in mechanism.joints["J1"].SIDES for what in ("point", direction)
    }
    assert len(keys) == (6 if kind in ("spherical", "fixed") else 12)
    for key in ("J1", "joints.J1.radial_clearance", "joints.J1.journal.radius"):
        with pytest.raises(MechanismError, match=f"{key}: a {kind} joint is ideal and has no play to set; ") as caught:
            set_values(mechanism, {key: 0.1})
        with pytest.raises(MechanismError, match="is ideal"):
            get_value(mechanism, key)
        if kind in JOINTS:
            assert f'write type = "clearance_{kind}" into the file first' in str(caught.value)


REFUSED = [
    ("revolute", "rings", ..., "joints.J1.flanges.ends: missing", "end faces"),
    ("revolute", "flanges__ends", [1, 2, 3], "joints.J1.flanges.ends = [1, 2, 3]", "the smaller first"),
    ("revolute", "flanges__ends", [2, 1], "joints.J1.flanges.ends = [2, 1]", "the smaller first"),
    ("revolute", "flanges__radius", 0, "joints.J1.flanges.radius = 0 mm", "allowed: > 0"),
    ("revolute", "flanges__sides", "top", "joints.J1.flanges.sides = 'top'", "'both', 'start' or 'end'"),
    ("revolute", "axial_clearance", ..., "joints.J1.axial_clearance: missing; it is the play at each flange", "ideal"),
    ("revolute", "axial_clearance", 0, "joints.J1.axial_clearance = 0 mm", "allowed: > 0"),
    ("revolute", "flanges", ..., "joints.J1.axial_clearance = 0.1 mm: nothing it would act on", "add flanges"),
    ("revolute", "radial_clearance", ..., "joints.J1.radial_clearance: missing; it is bore radius minus", "add it"),
    ("revolute", "journal__radius", ..., "joints.J1.journal.radius: missing; it is the radius of the pin", "ideal"),
    ("revolute", "material", ..., "joints.J1.material: missing", "give friction"),
    ("cylindrical", "rings", ..., "joints.J1.rings: missing; it is the stations", "make the joint an ideal one"),
    ("cylindrical", "flanges", {"radius": 1}, "joints.J1.flanges: unknown key", "radial_clearance"),
    ("cylindrical", "radial_clearance", 2.0, "joints.J1.radial_clearance = 2.0 mm", "radial_clearance <= 1"),
    ("prismatic", "block", ..., "joints.J1: has no form", "exactly one of block, shaft"),
    ("prismatic", "shaft", SHAFT, "joints.J1: has block and shaft", "keep one"),
    ("prismatic", "guide__normal", ..., "joints.J1.guide.normal: missing; it is the direction", "add it"),
    ("prismatic", "slider__normal", [0, 1, 1], "joints.J1.slider.normal", "not across axis (axis . normal = 0.71)"),
    ("prismatic", "block__half_width", -1, "joints.J1.block.half_width = -1 mm", "allowed: > 0"),
    ("prismatic", "clearance", 0, "joints.J1.clearance = 0 mm", "allowed: > 0"),
    ("spherical", "ball__radius", ..., "joints.J1.ball.radius: missing", "add it"),
    ("spherical", "radial_clearance", ..., "joints.J1.radial_clearance: missing", "socket radius minus ball radius"),
    ("spherical", "ball__body", "bal", "joints.J1.ball.body = 'bal': no such body", "ground, link"),
    ("prismatic", "slider__body", "lnk", "joints.J1.slider.body = 'lnk': no such body", "did you mean 'link'?"),
    ("prismatic", "slider__body", "ground", "joints.J1: both sides are on ground", "two different bodies"),
]


@each(("kind", "key", "value", "where", "allowed"), REFUSED)
def test_a_loose_joint_that_cannot_be_made_says_why(kind, key, value, where, allowed):
    """One line that names key, value, what is allowed and a remedy."""
    (line,) = faults(with_joint(f"clearance_{kind}", **{key: copy.deepcopy(value)}))
    assert line.startswith(where)
    assert allowed in line


@pytest.mark.parametrize("turning", ["held", "free"])
def test_a_shaft_needs_no_height(turning):
    """A shaft has one clearance and no normal; a width is refused."""
    changes = {"block": ..., "shaft": {**SHAFT, "turning": turning}, "guide__normal": ..., "slider__normal": ...}
    (line,) = faults(with_joint("clearance_prismatic", **changes))
    assert line.startswith("joints.J1.width_clearance = 0.1 mm: a shaft has no width")
    assert loaded("clearance_prismatic", width_clearance=..., **changes).joints["J1"].shaft.turning == turning
    (line,) = faults(with_joint("clearance_prismatic", width_clearance=..., clearance=..., **changes))
    assert line.startswith("joints.J1.clearance: missing")


@pytest.mark.parametrize("left", [("clearance",), ("width_clearance",)])
def test_a_block_needs_one_pair_of_faces(left):
    """Either clearance will do; with neither the first is asked for."""
    assert loaded("clearance_prismatic", **dict.fromkeys(left, ...)).joints["J1"].block.half_width == 1.0
    (line,) = faults(with_joint("clearance_prismatic", clearance=..., width_clearance=...))
    assert line.startswith("joints.J1.clearance: missing")


@pytest.mark.parametrize("kind", [*JOINTS, *IDEAL])
def test_names_of_bodies_are_checked_on_both_sides(kind):
    """A body that is not there, for each side of each joint."""
    joint = (JOINTS | IDEAL)[kind]
    for side in [key for key, entry in joint.items() if isinstance(entry, dict) and "body" in entry]:
        (line,) = faults(put(with_joint(kind), f"joints.J1.{side}.body", "rod"))
        assert line.startswith(f"joints.J1.{side}.body = 'rod': no such body; defined here: ground, link")


def test_an_ideal_joint_keeps_unfinished_keys_but_not_wrong_ones():
    """What is not given does not matter; a key that no form has, or a value no form may have, is a fault."""
    assert loaded("revolute", rings=..., material=..., radial_clearance=..., flanges=...).joints["J1"].ideal
    (line,) = faults(with_joint("revolute", ring=[1]))
    assert "joints.J1.ring: unknown key" in line
    assert "did you mean 'rings'?" in line
    (line,) = faults(with_joint("revolute", journal__radius=-1))
    assert line.startswith("joints.J1.journal.radius = -1 mm: not a radius")


def test_flange_stations():
    """The first and the last ring, unless the file says where the bearing ends."""
    assert loaded("clearance_revolute").joints["J1"].flange_stations == {"start": -1.0, "end": 1.0}
    given = loaded("clearance_revolute", flanges__ends=[-2, 3], flanges__sides="end").joints["J1"]
    assert given.flange_stations == {"end": 3.0}
