"""Bodies that expand or have grown: closed forms of lengths, angles and clearances, and of shapes a file may state."""

from math import asin
from typing import Any

import numpy as np
import pytest

from engine import simulate
from engine.assembly import assemble
from engine.assembly.contacts import profile_pieces, rows
from engine.assembly.frames import BodyFrame
from engine.assembly.surface_trees import surface_tree
from engine.errors import MechanismError, NotAssemblable
from engine.mechanism import Mechanism, set_values
from engine.mechanism.contacts import PAIRS, Contact
from engine.mechanism.keys.key_paths import Place, numbers
from engine.mechanism.materials import DENSITIES, EXPANSIONS
from tests.engine.kernels.shapes import drawn
from tests.engine.small import made, small

STEEL, POM = EXPANSIONS["steel"], EXPANSIONS["POM"]
Z = [0.0, 0.0, 1.0]


def lever(**body: Any) -> dict[str, Any]:
    """Describe a POM lever on a steel base, pressed by a spring against a stop 5 mm above its pivot, 30 mm away."""
    data = small(
        units="mm-g-ms",
        temperature=20.0,
        simulation={"step": 0.01, "horizon": 100.0, "penetration": 1e-11, "rest": {"window": 1.0, "drift": 1e-10}},
        phases=[{"name": "press", "damping": 1.0}],
        bodies={
            "base": {"fixed": True, "material": "steel"},
            "lever": {"mass": 2.0, "inertia": [10, 100, 100], "center_of_mass": [15, 0, 0], "material": "POM", **body},
        },
        joints={
            "pivot": {
                "type": "revolute",
                "bearing": {"body": "lever", "point": [0, 0, 0], "axis": Z},
                "journal": {"body": "base", "point": [0, 0, 0], "axis": Z},
            }
        },
        contacts={
            "stop": {
                "a": {"body": "lever", "sphere": {"centre": [30, 0, 0], "radius": 2.0}},
                "b": {"body": "base", "plane": {"point": [0, 5, 0], "normal": [0, -1, 0]}},
                "friction": 0.0,
            }
        },
        springs={
            "press": {"type": "torsion", "a": "base", "b": "lever", "axis": Z, "stiffness": 50.0, "free_angle": 0.5}
        },
        responses={"angle": {"type": "angle", "body": "lever", "axis": Z}},
    )
    return data


@pytest.mark.parametrize("degrees", [-40.0, 20.0, 80.0])
def test_a_lever_of_two_materials(degrees):
    """Its angle at the stop is asin((h (1 + a_s dT) - r (1 + a_p dT)) / (l (1 + a_p dT)))."""
    run = simulate(made(lever()), {"temperature": degrees})
    base, arm = 1 + STEEL * (degrees - 20), 1 + POM * (degrees - 20)
    assert run.status == "ok", run.message
    assert run.responses["angle"] == pytest.approx(asin((5 * base - 2 * arm) / (30 * arm)), abs=2e-9)


def test_nothing_changes_at_20_degrees():
    """The same bits as without a temperature; and the digest of a mechanism without one has no trace of the keys."""
    cold = lever()
    del cold["temperature"]
    assert simulate(made(lever())).responses == simulate(made(cold)).responses
    dump = made(cold).model_dump(mode="json", by_alias=True)
    assert "temperature" not in dump
    assert not {"expansion", "growth"} & dump["bodies"]["lever"].keys()


def test_growth_is_a_factor_of_all_lengths():
    """A lever moulded 1 % too large stands as one drawn 1 % larger."""
    grown = simulate(made(lever(growth=0.01)))
    assert grown.responses["angle"] == pytest.approx(asin((5 - 2.02) / 30.3), abs=2e-9)


def jointed(joint: dict[str, Any], **tables: Any) -> Mechanism:
    """Make a part of POM in a joint with a steel ground; overlap at the start is let pass."""
    return made(
        small(
            units="mm-g-ms",
            temperature=70.0,
            bodies={
                "ground": {"fixed": True, "material": "steel"},
                "part": {"mass": 1.0, "inertia": [1, 1, 1], "material": "POM"},
            },
            joints={"J": {"friction": 0.1, **joint}},
            simulation={"penetration": 1e3},
            **tables,
        )
    )


def gaps(mechanism: Mechanism) -> dict[str, float]:
    """Return the gaps at the start by the contacts' names."""
    assembly = assemble(mechanism)
    return dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))


def test_the_play_of_a_steel_pin_in_a_pom_bore():
    """The bore (r + c) grows with POM, the pin r with steel; flanges of the pin reach around the bearing."""
    line = {"point": [0, 0, 0], "axis": Z}
    hole = {"body": "part", **line}
    pin = {"body": "ground", **line, "radius": [1.5, 2.5]}
    play = {"radial_clearance": 0.05, "rings": [-4, 4], "flanges": {"radius": 3.0}, "axial_clearance": 0.2}
    found = gaps(jointed({"type": "clearance_revolute", "bearing": hole, "journal": pin, **play}))
    steel, pom = 1 + 50 * STEEL, 1 + 50 * POM
    for ring, radius in (("J.ring1", 1.5), ("J.ring2", 2.5)):
        assert found[ring] == pytest.approx((radius + 0.05) * pom - radius * steel, abs=1e-14)
    assert found["J.flange_end1"] == pytest.approx((4 + 0.2) * steel - 4 * pom, abs=1e-14)
    steel_bore = {"body": "ground", **line}, {"body": "part", **line, "radius": 10.0}
    narrow = {"type": "clearance_revolute", "bearing": steel_bore[0], "journal": steel_bore[1], "rings": [-4, 4]}
    tight = jointed({**narrow, "radial_clearance": 0.04})  # 10.04 (1 + 50 a_s) - 10 (1 + 50 a_p) < 0
    tight = set_values(tight, {"simulation.penetration": 1e-9})
    with pytest.raises(NotAssemblable, match=r"with the expansion and growth of ground and part at 70 degC"):
        assemble(tight)


def test_the_play_of_a_block_and_of_a_ball():
    """Slot and socket grow with the body that has them, block and ball with theirs."""
    steel, pom = 1 + 50 * STEEL, 1 + 50 * POM
    side = {"point": [0, 0, 0], "axis": Z, "normal": [1.0, 0, 0]}
    block = {"half_length": 5.0, "half_height": 3.0, "half_width": 2.0}
    sides = {"guide": {"body": "ground", **side}, "slider": {"body": "part", **side}}
    found = gaps(jointed({"type": "clearance_prismatic", **sides, "block": block, "clearance": 0.1}))
    assert list(found.values()) == pytest.approx([3.1 * steel - 3 * pom] * 8, abs=1e-14)
    ball = {"body": "part", "point": [0, 0, 0], "radius": 4.0}
    round_ = {"type": "clearance_spherical", "socket": {"body": "ground", "point": [0, 0, 0]}, "ball": ball}
    found = gaps(jointed({**round_, "radial_clearance": 0.1}))
    assert found["J.ball"] == pytest.approx(4.1 * steel - 4 * pom, abs=1e-14)


def larger(contact: Contact, factors: dict[str, float]) -> Contact:
    """Write a contact with all lengths of each side's body times its factor, number by number."""
    data = contact.model_dump(by_alias=True, exclude_none=True)
    for side in "ab":
        for key, place in numbers(Place(getattr(contact, side))):
            quantity, node = place.quantity(), data[side]
            if quantity is not None and quantity.name == "length":
                *tables, last = ["xyz".index(t) if t in "xyz" else int(t) if t.isdigit() else t for t in key.split(".")]
                for token in tables:
                    node[token] = list(node[token]) if isinstance(node[token], tuple) else node[token]
                    node = node[token]
                node[last] = place.value * factors[side]
    data["offset"] *= factors["a"]
    return Contact.model_validate(data)


@pytest.mark.parametrize("pair", [pair for pair in PAIRS if not pair.endswith("surface")])
def test_every_shape_has_the_rows_of_a_larger_one(pair):
    """The arrays of bodies that have grown are those of a file with each of their lengths multiplied."""
    contact, factors = drawn(pair, np.random.default_rng(40)), {"a": 1.01, "b": 0.98}
    plain = BodyFrame(0, np.array([0.1, 0.2, 0.3]), np.eye(3), np.array([1.0, 0, 0, 0]))
    grown = {side: BodyFrame(0, plain.origin, plain.rotation, plain.quaternion, f) for side, f in factors.items()}
    by_side = {id(contact.a): grown["a"], id(contact.b): grown["b"]}
    first, second = (by_side[id(side)] for side in contact.sides)
    other = larger(contact, factors)
    for one, two in zip(rows(contact, first, second), rows(other, plain, plain), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-13, atol=1e-14)
    pieces = profile_pieces(contact.sides[1], second.scale), profile_pieces(other.sides[1])
    np.testing.assert_allclose(*pieces, rtol=1e-11, atol=1e-12)


def test_a_surface_that_has_grown():
    """Its tree is that of patches with each number multiplied."""
    surface = drawn("point-surface", np.random.default_rng(4)).sides[1].surface
    assert surface is not None
    data = surface.model_dump(by_alias=True, exclude_none=True)
    scaled = {**data, "patches": (1.5 * np.array(data["patches"])).tolist(), "depth": 1.5 * data["depth"]}
    frame = BodyFrame(0, np.zeros(3), np.eye(3), np.array([1.0, 0, 0, 0]))
    grown = BodyFrame(0, np.zeros(3), np.eye(3), np.array([1.0, 0, 0, 0]), 1.5)
    one, two = surface_tree(surface, grown), surface_tree(type(surface).model_validate(scaled), frame)
    np.testing.assert_allclose(one.coefficient, two.coefficient, rtol=1e-12, atol=1e-12)


def test_what_is_wrong_with_a_temperature():
    """A body of which nothing says how it expands; a temperature that there is not; one that the file does not have."""
    with pytest.raises(MechanismError, match=r"(?s)bodies.lever.expansion.*unobtainium is not in the table") as error:
        made(lever(material="unobtainium"))
    assert [fault.key for fault in error.value.faults] == ["bodies.lever.expansion"]
    assert made(lever(material="unobtainium", expansion=1e-5)).stretch("lever") == 1.0
    with pytest.raises(MechanismError, match=r"temperature.*> -273.15"):
        set_values(made(lever()), {"temperature": -300.0})
    plain = lever()
    del plain["temperature"]
    with pytest.raises(MechanismError, match="has no number in this mechanism"):
        set_values(made(plain), {"temperature": 60.0})


def test_materials_that_expand_are_materials():
    """Each name has a density, too; metals and plastics are in their order."""
    assert EXPANSIONS.keys() <= DENSITIES.keys()
    assert STEEL < EXPANSIONS["aluminium"] < EXPANSIONS["PA66-GF30"] < POM
