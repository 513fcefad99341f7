"""Numbers a thousand times off what is customary in their unit, in both systems of units."""

import pytest

from tests.engine.preflight.examples import lever, pin, warned
from tests.engine.small import GRAVITY


def test_clearances_in_metres_in_a_file_in_mm():
    """0.02 to 0.09 mm, written in m: less than anything that is made."""
    for clearance in (2e-5, 9e-5):
        data = lever()
        data["joints"]["J1"]["radial_clearance"] = clearance
        (text,) = warned(data)
        assert text.startswith(
            f"joints.J1.radial_clearance = {clearance:g} mm: unusually small; customary: 0.002 to 2 mm"
        )
        assert 'with units = "mm-g-ms" it is in mm' in text


def test_clearances_in_millimetres_in_a_file_in_metres():
    """A play of 50 mm in a pin of 5 m."""
    data = pin(measured="y")
    data["joints"]["J"] |= {"radial_clearance": 0.05, "journal": {**data["joints"]["J"]["journal"], "radius": 5.0}}
    (text,) = warned(data)
    assert text.startswith("joints.J.radial_clearance = 0.05 m: unusually large; customary: 2e-06 to 0.002 m")


@pytest.mark.parametrize(("gravity", "times"), [(9.81, "1000"), (9810.0, "1e+06"), (9.81e-6, "0.001")])
def test_gravity_in_another_unit(gravity, times):
    """In mm-g-ms the earth's is 9.81e-3 mm/ms2."""
    data = lever() | {"gravity": [0.0, -gravity, 0.0]}
    (text,) = warned(data)
    assert text.startswith(f"gravity = {gravity:g} mm/ms2: {times} times the earth's; customary: 0.00980665 mm/ms2")


@pytest.mark.parametrize("gravity", [0.0, 9.81e-3, 1.62e-3, 0.3])
def test_gravity_of_the_earth_the_moon_and_a_centrifuge_is_fine(gravity):
    """None, 1 g, a sixth of it, 30 g."""
    assert warned(lever() | {"gravity": [0.0, 0.0, -gravity]}) == []


@pytest.mark.parametrize(
    ("mass", "said"),
    [
        (1e90, "unusually large"),
        (1e-12, "unusually small"),
        (2000.0, "as compact as a ball of"),
        (2e-3, "as compact as"),
    ],
)
def test_masses_in_another_unit(mass, said):
    """Alone, or a thousand times too large or small for the moments of inertia."""
    data = lever()
    data["bodies"]["lever"]["mass"] = mass
    (text,) = warned(data)
    assert text.startswith(f"bodies.lever.mass = {mass:g} g: ")
    assert said in text


@pytest.mark.parametrize("stiffness", [1e-9, 1e12])
def test_stiffnesses_in_another_unit(stiffness):
    """Of a torsion spring; the lever's is 50 N mm/rad."""
    data = lever()
    data["springs"]["return"]["stiffness"] = stiffness
    texts = warned(data)
    assert any(text.startswith(f"springs.return.stiffness = {stiffness:g} N mm/rad: unusually") for text in texts)


def test_angles_in_degrees():
    """Of a torsion spring; the same angle as a formula of degrees is an ordinary one, and a motion may turn often."""
    data = lever()
    data["springs"]["return"]["free_angle"] = 34.4
    texts = [text for text in warned(data) if text.startswith("springs.return.free_angle")]
    assert texts == [
        "springs.return.free_angle = 34.4 rad: 5.47 turns; customary: up to one turn; if that is in degrees, write"
        ' "radians(34.4)"'
    ]
    data["springs"]["return"]["free_angle"] = "radians(34.4)"
    assert warned(data) == []


def test_it_is_data_too():
    """Key, value, unit, and the three parts of the sentence."""
    from engine.preflight import cautions
    from tests.engine.small import made

    (caution,) = cautions(made(lever() | {"gravity": [0.0, -GRAVITY, 0.0]}))
    document = caution.to_json()
    assert (document["key"], document["value"], document["unit"]) == ("gravity", GRAVITY, "mm/ms2")
    assert document["message"] == str(caution)
