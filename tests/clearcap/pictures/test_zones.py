"""Zones, tilts and lobes in the sketch of a mechanism: where they are, how wide, what is said."""

import dataclasses
import re
import tomllib
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from campaign.spec.campaign_file import CampaignSpec
from clearcap.pictures import sketch as sketches
from clearcap.pictures.sketch import sketch_mechanism
from clearcap.pictures.style import INK
from clearcap.pictures.zones import LONG, WIDE
from clearcap.questions.report import widest
from engine.mechanism import mechanism_from
from tests.clearcap.pictures.test_sketch import boxes
from tests.engine.small import made
from tests.engine.test_gears import pair

LATCH = Path(__file__).parents[3] / "docs/examples/drawn_latch.toml"


def latch(deviation=None, **parameters):
    """Return the latch of docs/fits.md with another deviation of the pin that its rocker turns on, and lobes."""
    data = tomllib.loads(LATCH.read_text("utf-8"))
    data["joints"]["heel"]["journal"]["deviation"] = deviation or {"off": 0.0, "way": 0.0}
    data["joints"]["foot"]["journal"]["deviation"] = deviation or {"off": 0.0, "way": 0.0}
    data["joints"]["knee"]["bearing"]["lobes"] = {"number": 3, "height": 0.002}
    if parameters:
        data["parameters"] = parameters
    return mechanism_from(data, "latch")


def dashed(sketch):
    return [np.array(each.points) for each in sketch.strokes if each.style == "dashed" and each.colour == INK]


def test_a_zone_is_a_circle_about_its_true_position():
    """Seen along the axis; so much larger than it is as the legend says, at the same scale as the bodies."""
    plain, drawn = latch(), latch({"off": 0.05, "tilt": 0.004})
    sketch = sketch_mechanism(plain, drawn)
    lines = dashed(sketch)
    middles = [(line.min(axis=0) + line.max(axis=0)) / 2 for line in lines]
    assert np.ptp(lines[0], axis=0) == pytest.approx([2 * WIDE] * 2, abs=0.3)
    assert middles[1] == pytest.approx(middles[0], abs=0.2)  # the cone of the tilt, in the same place
    legend = {each.name: (each.title, each.value) for each in sketch.legend}
    assert next(iter(legend)) == "hook"
    title, value = legend["heel journal"]
    assert title == "position zone 0.1 mm; tilt up to 0.004 rad"
    factor, of_tilt = (float(number) for number in re.findall(r"[\d.]+", value))
    apart = float(np.linalg.norm(middles[3] - middles[0]))  # of the two pins of the base, 50 mm
    assert factor == pytest.approx(2 * WIDE / 0.1 * 50.0 / apart, rel=0.05)
    assert of_tilt == pytest.approx(0.3 / 0.004)
    assert legend["knee bearing"][0] == "3 lobes, 0.002 mm high"
    assert any("position zone 0.1 mm" in word.lines for word in sketch.words)
    for (a, b, c, d), (e, f, g, h) in combinations(boxes(sketch), 2):
        assert c <= e or g <= a or d <= f or h <= b


def test_from_the_side(monkeypatch):
    """A zone is the two sides of a cylinder along the axis, and a tilt a wedge."""
    view = sketches.choose_view(latch())
    turned = dataclasses.replace(view, up=view.normal, normal=-view.up)
    monkeypatch.setattr(sketches, "choose_view", lambda _: turned)
    zone, *wedge = dashed(sketch_mechanism(latch({"off": 0.05, "tilt": 0.004})))[:3]
    assert np.ptp(zone, axis=0) == pytest.approx([2 * WIDE, 2 * LONG], abs=0.3)
    (first, second) = (np.diff(line, axis=0)[0] for line in wedge)
    cosine = first @ second / np.linalg.norm(first) / np.linalg.norm(second)
    assert np.arccos(cosine) == pytest.approx(2 * 0.3, abs=0.01)


def test_a_gear_that_runs_out():
    """It has a zone where its axis is drawn."""
    data = pair()
    data["couplings"]["mesh"]["gears"][1]["deviation"] = {"off": 2e-4, "way": 0.3}
    sketch = sketch_mechanism(made(pair()), made(data))
    legend = {each.name: each.title for each in sketch.legend}
    assert legend["mesh gear 2"] == "position zone 0.0004 m"
    assert "mesh gear 1" not in legend
    data["couplings"]["mesh"]["gears"][0]["deviation"] = {"off": 1e-4}
    pinion, wheel = (line.mean(axis=0) for line in dashed(sketch_mechanism(made(data))))
    assert np.linalg.norm(wheel - pinion) > 4 * WIDE  # each where it is


def test_without_zones_nothing_is_added():
    """A mechanism as drawn has no entries of this kind, nor one whose campaign varies none."""
    data = tomllib.loads(LATCH.read_text("utf-8"))
    assert [each.name for each in sketch_mechanism(mechanism_from(data, "latch")).legend] == ["hook"]


def test_what_a_campaign_draws_at_most():
    """A zone by its diameter, a share of a zone with (M), a tilt up to its bound; what has no bound is not shown."""
    off = "joints.heel.journal.deviation.off"
    zone = {"target": off, "distribution": "position", "zone": 0.1}
    tilt = {"distribution": "uniform", "lower": 0.0, "upper": 0.003, "target": off.replace("off", "tilt")}
    share = {"target": "parameters.share", "distribution": "position", "zone": 2.0}
    free = {"target": off, "distribution": "normal", "mean": 0.0, "std": 0.01}
    bonus = latch({"off": "share * (0.1 + 0.02) / 2", "way": 0.0}, share=0.0)
    for mechanism, variables, found in (
        (latch(), {"a": zone, "b": tilt}, (0.05, 0.003)),
        (bonus, {"a": share}, (0.06, 0.0)),
        (latch(), {"a": free}, (0.0, 0.0)),
    ):
        table = {"format": 1, "name": "z", "mechanism": "latch.toml", "samples": 10, "variables": variables}
        deviation = widest(mechanism, CampaignSpec.model_validate(table)).joints["heel"].journal.deviation
        assert (deviation.off, deviation.tilt) == pytest.approx(found, abs=1e-12)
