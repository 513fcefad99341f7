"""The page of the mechanism file is complete: its example loads, and it names every key."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from engine.mechanism import get_value, load_mechanism, mechanism_from, mechanism_schema, set_values
from engine.mechanism.contacts import Contact
from engine.mechanism.surfaces.patches import mean_direction, points
from tests.each import each

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "mechanism.md").read_text(encoding="utf-8")
EXAMPLE = PAGE.split("```toml\n")[1].split("```")[0]


def test_the_example_loads():
    mechanism = mechanism_from(tomllib.loads(EXAMPLE), "example")
    assert mechanism.response_units() == {"force": "N", "lift": "mm"}
    keys = {"J1": 0.1, "springs.return.free_angle": 0.4, "materials.steel_plastic.friction": 0.2}
    assert all(get_value(set_values(mechanism, keys), key) == value for key, value in keys.items())


def test_the_profiles_are_contacts():
    """The two solids of the page: the area of half the shaft's section, and that of the cam between its tangents."""
    text = PAGE.split("**Profiles.**")[1].split("```toml\n")[1].split("```")[0]
    shaft, cam = (
        Contact.model_validate({**contact, "friction": 0.1}).sides[1].primitive.curve
        for contact in tomllib.loads(text)["contacts"].values()
    )
    assert sum(piece.area for piece in shaft) == pytest.approx(3 * 8 + 4 * 2 + 5 * 4)
    angle = math.acos(3 / 5)
    sectors = 6**2 * (math.pi - angle) + 3**2 * angle
    assert sum(piece.area for piece in cam) == pytest.approx(sectors + (6 + 3) * 4)


def test_the_surface_is_a_contact():
    """The dish of the page is z = (x^2 + y^2) / 25 exactly, with its normal up."""
    text = PAGE.split("**Surfaces.**")[1].split("```toml\n")[1].split("```")[0]
    dish = Contact.model_validate({**tomllib.loads(text)["contacts"]["dish"], "friction": 0.1}).b.surface
    x, y, z = points(dish.top, np.linspace(0, 1, 5), np.linspace(0, 1, 5)).reshape(-1, 3).T
    np.testing.assert_allclose(z, 0.04 * (x**2 + y**2), atol=1e-14)
    assert mean_direction(dish.top)[1] == pytest.approx([0, 0, 1])
    assert dish.conversion_error < 1e-14


def test_every_key_of_the_format_is_described():
    schema = mechanism_schema()
    keys = {key for table in [schema, *schema["$defs"].values()] for key in table.get("properties", {})}
    code = " ".join(re.findall(r"`([^`\n]+)`", PAGE))
    assert keys - set(re.findall(r"\w+", code)) == set()


@each("number", ["0.9599", "0.006", "-0.49872", "0.39", "-15", "1.16", "244.46", "3.82"])
def test_the_page_of_the_c60_has_the_numbers_of_its_file(number):
    page = (DOCS / "c60-reference.md").read_text(encoding="utf-8")
    mechanism = load_mechanism("c60")
    assert number in page
    assert f"{float(number)}" in mechanism.model_dump_json()
