"""Drawings of samples: places follow the numbers, the same in both; and which samples and columns are drawn."""

import numpy as np
import pytest

from campaign.errors import SpecError
from campaign.samples import SampleColumns
from clearcap.questions.samples import MOST_DRAWN, sample_cloud
from clearcap.web.pages.clouds import TALL, TOP, dots_figure, parallel_figure


def axis(name, values, **more):
    """Return a column of a cloud."""
    known = [x for x in values if x is not None]
    plain = {
        "name": name,
        "is_variable": name[0] == "J",
        "unit": "mm",
        "lsl": None,
        "usl": None,
        "least": min(known),
        "most": max(known),
    }
    return {**plain, "values": values, **more}


CLOUD = {
    "sample": [3, 5, 9],
    "bad": [False, True, False],
    "matching": 3,
    "total": 3,
    "axes": [
        axis("J1", [1.0, 2.0, 3.0]),
        axis("J2", [5.0, 4.0, 9.0]),
        axis("F", [10.0, None, 30.0], lsl=15.0, usl=99.0),
    ],
}


def test_lines_have_the_places_of_their_values():
    found = parallel_figure(CLOUD, {"J1": ("2", ""), "J2": (" ", "")})
    lines = {line.sample: line for line in found.lines}
    xs = [each.x for each in found.axes]
    assert lines[3].points == f"{xs[0]:g},{TOP + TALL} {xs[1]:g},{TOP + 0.8 * TALL:.1f} {xs[2]:g},{TOP + TALL}"
    assert lines[3].at == "0.0000,0.2000,0.0000"
    assert (lines[5].at, lines[5].points.count(",")) == ("0.5000,0.0000,", 2)  # it has no force
    assert found.lines[-1].sample == 5  # what is bad is over the others
    assert found.axes[2].limits == [TOP + 0.75 * TALL]  # the other limit is beyond the axis
    assert [each.brush for each in found.axes] == [(TOP, TALL / 2), (0.0, 0.0), (0.0, 0.0)]


def test_dots_have_the_places_of_their_values():
    """By default the first response with limits is over the variable that moves it most."""
    found = dots_figure(CLOUD, "", "")
    assert (found.columns[1], found.names[1]) == (2, "F [mm]")
    assert [dot[0] for dot in found.dots] == [3, 9]
    found = dots_figure(CLOUD, "J1", "J2")
    assert found.columns == (0, 1)
    (_, x3, y3, _), (_, x9, y9, _), (_, x5, y5, is_bad) = found.dots
    assert x5 == pytest.approx((x3 + x9) / 2)
    assert y3 == pytest.approx(0.8 * y5 + 0.2 * y9)
    assert is_bad
    places = {words: place for place, words in found.ticks[0]}
    assert [places[words] for words in ("1.0", "2.0", "3.0")] == pytest.approx([x3, x5, x9])
    assert dots_figure({**CLOUD, "axes": CLOUD["axes"][:1]}, "", "") is None


def test_few_samples_are_drawn_evenly(plan):
    """Of all within the ranges; one that has failed, or is out of limits, is bad; a constant column is left out."""
    n = 3 * MOST_DRAWN - 1
    values = {name: np.linspace(0.0, 1.0, n) for name in (*plan.spec.variables, *plan.mechanism.responses)}
    values["FC-1"] = np.linspace(5.0, 18.0, n)
    values["FC-1"][9] = np.nan
    values["FC-2"] = np.ones(n)
    columns = SampleColumns(np.arange(n), values)
    cloud = sample_cloud(plan, columns, [])
    assert cloud["sample"] == list(range(0, n, 3))
    force = values["FC-1"][::3]
    assert cloud["bad"] == (~((force >= 9.0) & (force <= 16.0))).tolist()
    assert cloud["bad"][3]
    names = [each["name"] for each in cloud["axes"]]
    assert "FC-2" not in names
    assert names[:2] == ["J1", "preload"]
    part = sample_cloud(plan, columns, ["J1:0.2:0.5", "J1:0.3:"])
    assert (part["total"], part["matching"]) == (n, np.count_nonzero((values["J1"] >= 0.3) & (values["J1"] <= 0.5)))
    assert [each["most"] for each in part["axes"]] == [each["most"] for each in cloud["axes"]]
    assert sample_cloud(plan, columns, ["J1:2:"])["sample"] == []
    with pytest.raises(SpecError, match="LEAST"):
        sample_cloud(plan, columns, ["J1:2"])
