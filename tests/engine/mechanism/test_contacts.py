"""Contact primitives and pairs of materials as they are written: what is taken, what is refused, and in which words."""

import copy
import math
from typing import Any

import numpy as np
import pytest

from engine.assembly import assemble
from engine.errors import MechanismError
from engine.mechanism import Mechanism, mechanism_from, set_values, unit_of
from engine.mechanism.contacts import FLATS, PAIRS, PRIMITIVES, SEVERAL
from tests.each import each
from tests.engine.mechanism.plain import pendulum, put

SHAPES: dict[str, Any] = {
    "point": [0, 0, 0],
    "sphere": {"centre": [0, 0, 0], "radius": 0.5},
    "arc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.5},
    "ring": {"centre": [0, 0, 0], "radius": 0.5},
    "cylinder": {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 0.4},
    "bore": {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 1},
    "socket": {"centre": [0, 0, 0], "radius": 1},
    "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
    "disc": {"centre": [0, 0, 0], "normal": [0, 0, 1], "radius": 2},
    "rectangle": {"centre": [0, 0, 0], "normal": [0, 0, 1], "along": [1, 0, 0], "half_lengths": [2, 1]},
    "turned": {"point": [0, 0, 0], "axis": [0, 0, 1], "start": [0, -1], "profile": [{"to": [1, -1]}, {"to": [0, 1]}]},
    "extruded": {
        **{"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0]},
        **{"start": [1, 0], "profile": [{"to": [1, 0], "centre": [0, 0], "turn": "left"}]},
    },
    "capsule": {"point": [0, 0, 0], "axis": [0, 0, 1], "radius": 0.4, "half_length": 1},
    "box": {"centre": [0, 0, 0], "half_lengths": [0.4, 0.3, 0.2]},
    "mesh": {"pieces": [[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]]},
    "surface": {"patches": [[[[x, y, 0] for y in range(4)] for x in range(4)]]},
}


def touching(first: Any, second: Any) -> dict[str, Any]:
    """Describe the pendulum with a contact of two primitives, (kind, changed keys) each."""
    data = pendulum()
    for side, body, (kind, changes) in (("a", "link", first), ("b", "ground", second)):
        shape = copy.deepcopy(SHAPES[kind])
        for key, value in changes.items():
            put(shape, key, value)
        put(data, f"contacts.stop.{side}", {"body": body, kind: shape})
    return data


def faults(data: dict[str, Any]) -> list[str]:
    """Return the lines of the one error that ``data`` causes."""
    with pytest.raises(MechanismError) as caught:
        mechanism_from(data, "FILE")
    return [line.strip() for line in str(caught.value).split("\n")[1:]]


def row(mechanism: Mechanism, side: str = "b") -> np.ndarray:
    """Return the geometry row of the stop, as assembled, whatever overlaps."""
    simulation = mechanism.simulation.model_copy(update={"penetration": 1e6})
    assembly = assemble(mechanism.model_copy(update={"simulation": simulation}))
    rows = assembly.model.contacts.geometry_a if side == "a" else assembly.model.contacts.geometry_b
    return rows[assembly.contact_names.index("stop")]


SOLID = {"cylinder", "capsule", "box"}


@each("first", PRIMITIVES)
@each("second", PRIMITIVES)
def test_every_pair_is_taken_in_both_orders_or_refused(first, second):
    ends = {"half_length": 1} if first == second == "cylinder" else {}
    data = touching((first, ends), (second, {}))
    allowed = (*PAIRS, *SEVERAL)
    if f"{first}-{second}" in allowed or f"{second}-{first}" in allowed:
        contact = mechanism_from(data, "FILE").contacts["stop"]
        assert contact.kind in allowed
        assert [side.kind for side in contact.sides] == contact.kind.split("-")
        assert {contact.sides[0].body, contact.sides[1].body} == {"link", "ground"}
    else:
        (line,) = faults(data)
        assert line.startswith(
            f"contacts.stop: {first} against {second} has no gap function; allowed: {first} against "
        )
        met = line.partition(f"allowed: {first} against ")[2].partition(";")[0].split(", ")
        assert met == [kind for kind in PRIMITIVES if f"{first}-{kind}" in allowed or f"{kind}-{first}" in allowed]
        remedy = "three points" if {first, second} <= set(FLATS) else ""
        remedy = "as an extruded profile" if "extruded" in (first, second) and {first, second} & SOLID else remedy
        remedy = "rings, circles" if {first, second} <= {"cylinder", "bore"} else remedy
        remedy = "for a pin write a capsule" if "mesh" in (first, second) else remedy
        assert (remedy or "points, spheres or arcs") in line


def test_an_arc_without_middle_and_angle_is_a_full_circle():
    circle = mechanism_from(touching(("arc", {}), ("plane", {})), "FILE").contacts["stop"].a.arc
    assert circle.half_angle == math.pi
    assert circle.edge_radius == 0
    g = row(mechanism_from(touching(("arc", {}), ("plane", {})), "FILE"), "a")
    assert np.linalg.norm(g[6:9]) == pytest.approx(1)
    assert g[3:6] @ g[6:9] == pytest.approx(0)


@each(
    ("kind", "changes", "bounds"),
    [
        ("disc", {}, [-math.inf, 2, -2, 0]),
        ("disc", {"depth": 0.5}, [-math.inf, 2, -0.5, 0]),
        ("rectangle", {}, [2, 1, -1, 0]),
        ("rectangle", {"depth": 0.5}, [2, 1, -0.5, 0]),
        ("cylinder", {}, [-math.inf, 0.4, -math.inf, math.inf]),
        ("cylinder", {"half_length": 3}, [-math.inf, 0.4, -3, 3]),
        ("bore", {"half_length": 3}, [1, math.inf, -3, 3]),
        ("sphere", {}, [-math.inf, 0.5, -math.inf, math.inf]),
        ("socket", {}, [1, math.inf, -math.inf, math.inf]),
    ],
)
def test_bounds_of_a_solid(kind, changes, bounds):
    assert row(mechanism_from(touching(("point", {}), (kind, changes)), "FILE"))[9:13].tolist() == bounds


REFUSED = [
    (("sphere", {"radius": 0}), ("plane", {}), "contacts.stop.a.sphere.radius = 0 mm", "allowed: > 0"),
    (("arc", {"half_angle": 1}), ("plane", {}), "contacts.stop.a.arc.middle: missing", "drop half_angle"),
    (("arc", {"half_angle": 3.2}), ("plane", {}), "contacts.stop.a.arc.half_angle = 3.2 rad", "allowed: <= 3.14159"),
    (("arc", {"half_angle": 0}), ("plane", {}), "contacts.stop.a.arc.half_angle = 0 rad", "allowed: > 0"),
    (("arc", {"edge_radius": -1}), ("plane", {}), "contacts.stop.a.arc.edge_radius = -1 mm", "allowed: >= 0"),
    (("arc", {"middle": [1, 0, 0.1]}), ("plane", {}), "contacts.stop.a.arc.middle = ", "perpendicular to normal"),
    (("point", {}), ("rectangle", {"along": [1, 0, 1]}), "contacts.stop.b.rectangle.along = ", "perpendicular"),
    (("point", {}), ("rectangle", {"half_lengths": [1, 0]}), "contacts.stop.b.rectangle.half_lengths", "numbers > 0"),
    (
        ("point", {}),
        ("rectangle", {"half_lengths": 2}),
        "contacts.stop.b.rectangle.half_lengths = 2 mm",
        "half the width",
    ),
    (("point", {}), ("disc", {"depth": 0}), "contacts.stop.b.disc.depth = 0 mm", "allowed: > 0"),
    (("point", {}), ("disc", {"normal": [0, 0, 0]}), "contacts.stop.b.disc.normal", "has no direction"),
    (
        ("sphere", {"radius": 1}),
        ("socket", {}),
        "contacts.stop.a.sphere.radius = 1.0 mm",
        "radius < 1; make it smaller",
    ),
    (("sphere", {"radius": 2}), ("bore", {}), "contacts.stop.a.sphere.radius = 2.0 mm", "does not fit into the bore"),
    (("ring", {"radius": 0.3}), ("cylinder", {}), "contacts.stop.a.ring.radius = 0.3 mm", "radius > 0.4"),
    (("ring", {}), ("cylinder", {"half_length": 1}), "contacts.stop.b.cylinder.half_length = 1.0 mm", "write arcs"),
    (("cylinder", {"half_length": 1}), ("plane", {}), "contacts.stop.a.cylinder.half_length = 1.0 mm", "end circles"),
]


@each(("first", "second", "where", "remedy"), REFUSED)
def test_a_primitive_that_cannot_be_says_where_and_what_to_do(first, second, where, remedy):
    (line,) = faults(touching(first, second))
    assert line.startswith(where)
    assert remedy in line


def test_single_numbers_of_primitives_can_be_set():
    mechanism = mechanism_from(touching(("sphere", {}), ("disc", {"depth": 0.5})), "FILE")
    changed = set_values(mechanism, {"contacts.stop.b.disc.radius": 3, "contacts.stop.a.sphere.radius": 0.25})
    assert row(changed)[10] == 3
    assert unit_of(mechanism, "contacts.stop.b.disc.depth") == "mm"
    with pytest.raises(MechanismError, match=r"contacts\.stop\.b\.disc\.depth = 0\.0 mm"):
        set_values(mechanism, {"contacts.stop.b.disc.depth": 0})


# ---------------------------------------------------------------------------------------------------------------------
# pairs of materials


def paired() -> dict[str, Any]:
    """Describe the pendulum with materials of bodies, and pairs between them."""
    data = pendulum()
    put(data, "materials.mixed", {"friction": 0.4, "restitution": 0.3, "between": ["steel", "plastic"]})
    put(data, "materials.same", {"friction": 0.6, "between": ["steel", "steel"]})
    put(data, "bodies.link.material", "plastic")
    put(data, "bodies.ground.material", "steel")
    put(data, "contacts.stop.friction", ...)
    return put(data, "joints.J1.material", ...)


def law(data: dict[str, Any], table: str, name: str) -> tuple[float, float]:
    """Return friction and restitution of a joint or contact."""
    mechanism = mechanism_from(data, "FILE")
    return mechanism.contact_law(getattr(mechanism, table)[name])


def test_bodies_materials_choose_the_pair():
    assert law(paired(), "contacts", "stop") == (0.4, 0.3)
    assert law(paired(), "joints", "J1") == (0.4, 0.3)
    assert law(put(paired(), "bodies.link.material", "steel"), "joints", "J1") == (0.6, 0.0)


def test_a_pair_that_is_named_and_numbers_of_the_contact_come_before_it():
    assert law(put(paired(), "contacts.stop.material", "steel_steel"), "contacts", "stop") == (0.2, 0.1)
    assert law(put(paired(), "contacts.stop.friction", 0.0), "contacts", "stop") == (0.0, 0.3)
    assert law(put(paired(), "joints.J1.restitution", 0.0), "joints", "J1") == (0.4, 0.0)


def test_no_pair_between_two_materials_names_both_and_what_there_is():
    lines = faults(put(paired(), "bodies.link.material", "brass"))
    assert [line.split(":")[0] for line in lines] == ["joints.J1.material", "contacts.stop.material"]
    for line in lines:
        assert "link (brass)" in line
        assert "ground (steel)" in line
        assert "mixed (steel and plastic)" in line
        assert "name a pair, or give friction, or add `between`" in line
    (line, _) = faults(put(paired(), "bodies.link.material", ...))
    assert "link (no material)" in line


def test_two_pairs_between_the_same_materials_are_refused():
    (line,) = faults(put(paired(), "materials.again", {"friction": 0.1, "between": ["plastic", "steel"]}))
    assert line.startswith("materials.again.between = ['plastic', 'steel']: materials.mixed is between the same two")
    assert faults(put(paired(), "materials.mixed.between", ["steel"]))[0].startswith("materials.mixed.between")
