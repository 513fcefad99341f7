"""Cautions about what is drawn and set: time that is too short, springs pressed far, rounds in hollow corners."""

from cmath import rect
from typing import Any

import pytest

from tests.engine.preflight.examples import GROUND, guided, lever, warned
from tests.engine.small import coordinates, small

PEN = {"point": [0, 0, 0], "axis": [0, 0, 1], "along": [1, 0, 0]}
NOTCH = [(-3, -2), (3, -2), (3, 1), (1, 1), (0, 0), (-1, 1), (-3, 1)]  # right-angled, its faces sqrt(2) long


def test_a_horizon_before_the_end_of_the_phases():
    """0.6 s in two phases cannot end within 0.5 s; a phase with an event may end sooner, and does not count."""
    data = guided(simulation={"horizon": 0.5}, phases=[{"name": "a", "duration": 0.4}, {"name": "b", "duration": 0.2}])
    (text,) = warned(data)
    assert text == (
        "simulation.horizon = 0.5 s: the phases of a given duration last 0.6 s together, so that no run comes to its"
        " end; customary: more than 0.6 s; raise it"
    )
    data["phases"][1]["until"] = {"response": "x", "above": 1.0}
    assert warned(data) == []


def test_a_longest_step_below_the_shortest():
    """Somebody has raised the step alone."""
    data = lever()
    data["simulation"] |= {"step": 0.1, "adaptive": {"longest": 0.02, "travel": 0.01}}
    assert any(
        text.startswith("simulation.adaptive.longest = 0.02 ms: shorter than simulation.step = 0.1")
        for text in warned(data)
    )


def test_a_pad_beyond_its_plane():
    """The normal of an elastic stop that points into the material: 0.9 m of rubber are pressed as drawn."""
    plane = {"body": "ground", "plane": {"point": [0.9, 0, 0], "normal": [1, 0, 0]}}
    pad = {"a": {"body": "ball", "point": [0, 0, 0]}, "b": plane, "stiffness": 100.0, "friction": 0.0}
    data = guided(contacts={"pad": pad}, phases=[{"name": "run", "duration": 0.5}])
    (text,) = warned(data)
    assert text.startswith("contacts.pad: its parts overlap by 0.9 m as drawn, where it presses with 90 N; move a part")
    plane["plane"]["normal"] = [-1, 0, 0]
    assert warned(data) == []
    plane["plane"] = {"point": [-0.9, 0, 0], "normal": [-1, 0, 0]}
    pad["offset"] = 0.9
    assert len(warned(data)) == 1, "an offset adds to the overlap"


def roller(radius: float, height: float = 0.0, **side: Any) -> dict[str, Any]:
    """Describe a roller in a notch in a bar, or a height over it."""
    (first, *rest) = NOTCH
    bar = {"body": "ground", "extruded": {**PEN, "start": first, "profile": [{"to": point} for point in rest]}}
    a = {"body": "roller", **(side or {"sphere": {"centre": [0, 0, 0], "radius": radius}})}
    return small(
        bodies={
            "ground": GROUND,
            "roller": {"mass": 1.0, "inertia": [1, 1, 1], "origin": [0, height or 1.5 * radius, 0]},
        },
        contacts={"notch": {"friction": 0.1, "a": a, "b": bar}},
        responses={"y": coordinates("roller")["y"]},
        phases=[{"name": "run", "duration": 0.5}],
    )


@pytest.mark.parametrize(("radius", "lies"), [(1.4, True), (1.42, False)])
def test_a_roller_in_a_notch(radius, lies):
    """A right-angled notch holds a roller on both faces if its radius is below their length, sqrt(2)."""
    found = warned(roller(radius))
    assert len(found) == lies
    for text in found:
        said = f"contacts.notch.b.extruded: a round of radius {radius:g} lies at the start in the hollow corner of the"
        assert text.startswith(f"{said} profile at [0, 0], where it touches two faces, but ")
        assert text.endswith("divide the profile at this corner into two that share it, and write a contact for each")


def test_a_roller_that_is_elsewhere_at_the_start():
    """One that could fall into a notch may be held by its other faces, as the striker in the claw of a lock."""
    assert warned(roller(1.0, height=4.0)) == []


def test_a_round_profile_in_a_notch():
    """A full circle, or a nose that is round over more than the right angle between the normals of the faces."""
    circle = {**PEN, "start": [1, 0], "profile": [{"to": [1, 0], "centre": [0, 0], "turn": "left"}]}
    assert len(warned(roller(1.0, extruded=circle))) == 1
    for half, lies in ((0.8, True), (0.7, False)):  # rad; sharp below the corners of the arc
        ends = [rect(1.0, -1.5707963267948966 + way * half) for way in (-1, 1)]
        nose = [{"to": [ends[1].real, ends[1].imag], "centre": [0, 0], "turn": "left"}, {"to": [0, 5]}]
        shape = {**PEN, "start": [ends[0].real, ends[0].imag], "profile": nose}
        assert len(warned(roller(1.0, extruded=shape))) == lies
