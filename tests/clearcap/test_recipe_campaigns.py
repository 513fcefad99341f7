"""Campaigns of recipes of docs/modelling.md: every run is ok, and each row has its closed form."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

import clearcap
from tests.house import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.processes]
SAMPLES = 500


def between(key: str, lower: float, upper: float) -> dict[str, Any]:
    """Describe a variable."""
    return {"target": key, "distribution": "uniform", "lower": lower, "upper": upper}


def height(rows: pd.DataFrame) -> pd.Series:
    """Return how high a roller of 5 mm lies between two fixed rods at -6 and 6 mm."""
    left, right = 5 + rows["left"], 5 + rows["right"]
    x = (left**2 - right**2) / 24
    return (left**2 - (x + 6) ** 2) ** 0.5


CASES = {
    "roller": (
        {
            "left": between("contacts.left.b.cylinder.radius", 4.9, 5.0),
            "right": between("contacts.right.b.capsule.radius", 4.9, 5.0),
        },
        "height",
        height,
    ),
    "box": (
        {
            "friction": between("contacts.lies.friction", 0.2, 0.4),
            "width": between("contacts.lies.a.box.half_lengths.1", 3.5, 4.5),
        },
        "travel",
        lambda rows: (0.004905 - 0.0084957 * rows["friction"]) * 100.0**2 / 2,
    ),
    "rolling": (
        {"arm": between("materials.hard.rolling_friction", 0.04, 0.06)},
        "way",
        lambda rows: 0.1**2 / (2 * 5 / 7 * 0.00981 * rows["arm"] / 5),
    ),
    "grain": (
        {
            "along": between("contacts.rub.friction", 0.2, 0.3),
            "across": between("contacts.rub.friction_across", 0.3, 0.4),
        },
        "drag",
        lambda rows: 4.00981 * np.hypot(0.8 * rows["along"], 0.6 * rows["across"]),
    ),
    "stribeck": (
        {"friction": between("materials.oiled.friction", 0.9, 1.1)},
        "speed",
        lambda rows: 0.1 + 0.9 * (0.8 / rows["friction"] - 0.5) / 0.5,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_every_run_of_500_is_ok(name, tmp_path):
    """Boxes, capsules and cylinders; friction over the speed and along a grain, and that of a ball that rolls out."""
    variables, response, expected = CASES[name]
    campaign = {
        "format": 1,
        "name": name,
        "mechanism": str(ROOT / "docs" / "examples" / "recipes" / f"{name}.toml"),
        "variables": variables,
    }
    rows = clearcap.run_campaign(campaign, samples=SAMPLES, store=tmp_path / "runs", progress=False, decide=False).rows
    assert rows["status"].tolist() == ["ok"] * SAMPLES
    np.testing.assert_allclose(rows[response], expected(rows), rtol=5e-3)
