"""Mechanisms that a program builds: from tables with NumPy's numbers, changed, and back to a file's text."""

import math

import numpy as np
import pytest

from engine import MechanismError, library_names, load_mechanism, load_mechanism_text
from tests.each import each


def slope(friction=0.7):
    """Return the tables of the shipped incline, made by a loop over its corners."""
    plane = {"body": "slope", "plane": {"point": np.zeros(3), "normal": np.array([0, 0, 1])}}
    turned = {"axis": [0.0, 1.0, 0.0], "angle": np.float64(0.5235987755982988)}
    sides = np.array([0.2, 0.2, 0.1])
    inertia = (np.sum(sides**2) - sides**2) / 12
    corners = {
        f"corner_{i + 1}": {"material": "block_slope", "a": {"body": "block", "point": (x, y, 0)}, "b": plane}
        for i, (x, y) in enumerate(0.1 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]))
    }
    return {
        "format": 1,
        "name": "incline",
        "title": "Block on a slope",
        "description": "A block of 0.2 x 0.2 x 0.1 m on four corners, on a slope of 30 degrees.",
        "units": "SI",
        "gravity": np.array([0, 0, -9.81]),
        "simulation": {
            **{"step": 1e-3, "horizon": 1, "tolerance": 1e-8, "penetration": 1e-11},
            "rest": {"window": 0.05, "drift": 1e-7},
        },
        "materials": {"block_slope": {"friction": friction, "restitution": 0}},
        "bodies": {
            "slope": {"fixed": True, **turned},
            "block": {"mass": np.int64(1), "inertia": inertia, "center_of_mass": (0, 0, 0.05), **turned},
        },
        "contacts": corners,
        "responses": {
            "slide": {
                **{"title": "way down the slope", "type": "position"},
                "from": {"body": "slope", "point": [0, 0, 0]},
                "to": {"body": "block", "point": [0, 0, 0]},
                "direction": {"body": "slope", "vector": [1, 0, 0]},
            }
        },
    }


def test_tables_made_in_code_are_the_file():
    """A loop over corners and arrays of NumPy make the shipped mechanism; its inertia agrees to the last digits."""
    built, shipped = load_mechanism(slope()), load_mechanism("incline")
    assert built.to_dict().keys() == shipped.to_dict().keys()
    inertias = [mechanism.bodies["block"].inertia for mechanism in (built, shipped)]
    np.testing.assert_allclose(*inertias, rtol=1e-15)
    body = shipped.to_dict()["bodies"]["block"]
    assert built.extended(bodies={"block": body}).digest() == shipped.digest()


def test_a_key_one_table_too_deep_is_said_to_belong_above():
    """The phase with which a motion's law begins is a key of the motion, and the step one of the simulation."""
    data = slope() | {"phases": [{"name": "slide"}]}
    along = {"body": "block", "along": {"direction": [1, 0, 0]}, "law": {"speed": 0.1, "since": "slide"}}
    with pytest.raises(MechanismError, match=r"motions\.push\.law\.since: .*; 'since' is a key of motions\.push"):
        load_mechanism(data | {"motions": {"push": along}})
    data["simulation"] = data["simulation"] | {"rest": {"window": 0.05, "drift": 1e-7, "horizon": 1.0}}
    with pytest.raises(MechanismError, match=r"rest\.horizon: .*; 'horizon' is a key of simulation: write it there"):
        load_mechanism(data)


@each("name", library_names())
def test_there_and_back(name):
    """Tables and text of every shipped mechanism, with expressions, benches and presets, are that mechanism."""
    shipped = load_mechanism(name)
    again = load_mechanism_text(shipped.to_toml())
    assert again == load_mechanism(shipped.to_dict()) == shipped
    assert load_mechanism(shipped.to_dict()).digest() == shipped.digest()
    assert again.formulas == shipped.formulas
    assert len(repr(shipped)) < 200 > len(str(shipped))
    assert shipped.name in repr(shipped)
    assert "[\n    0" not in shipped.to_toml()  # an array of numbers is a line


def test_extended_adds_replaces_and_takes_away():
    """What is not named stays; the mechanism itself does not change."""
    before = load_mechanism(slope())
    digest = before.digest()
    after = before.extended(
        without=["contacts.corner_4"],
        materials={"block_slope": {"friction": math.tan(0.5)}},
        simulation={"horizon": 2.0},
        gravity=[0, 0, -1.62],
        title="On the moon",
    )
    assert list(after.contacts) == ["corner_1", "corner_2", "corner_3"]
    assert after.materials["block_slope"].friction == math.tan(0.5)
    assert (after.simulation.step, after.simulation.horizon) == (1e-3, 2.0)
    assert (after.gravity, after.title, after.units) == ((0, 0, -1.62), "On the moon", "SI")
    assert before.digest() == digest


@each(
    ("change", "message"),
    [
        (lambda m: m.extended(without=["contacts.corner_5"]), "did you mean 'contacts.corner_1'"),
        (lambda m: m.extended(without=["simulation.step"]), "no such table"),
        (lambda m: m.extended(bodies={"block": {"mass": -1.0}}), r"bodies\.block\.mass = -1"),
        (lambda m: m.extended(contacts={"corner_4": {"a": {"body": "blok"}}}), "contacts.corner_4"),
        (lambda m: load_mechanism({**m.to_dict(), "cad": {"file": "x.step"}}), "names a CAD file"),
        (lambda m: load_mechanism({**m.to_dict(), "geometry": {}}), "written by clearcap"),
        (lambda m: load_mechanism({"name": 3}), "fault"),
        (lambda m: load_mechanism({}), "fault"),
    ],
)
def test_faults_are_named(change, message):
    """As those of a file."""
    with pytest.raises(MechanismError, match=message):
        change(load_mechanism("incline"))


def test_shown_in_a_notebook():
    """Names in each table, as text and never as markup."""
    shown = load_mechanism({**slope(), "title": "<b>tilted</b>"})._repr_html_()
    assert "corner_3" in shown
    assert "&lt;b&gt;" in shown
    assert "<b>" not in shown
