"""Names of parts, joints and stops stay with the geometry that they were given to."""

from dataclasses import replace

import numpy as np
import pytest

from engine.cad_import.found_geometry import FoundStop, find_geometry
from engine.cad_import.names_in_file import named_as_written
from engine.cad_import.names_of_before import named_as_before
from engine.cad_import.proposed_mechanism import proposed_mechanism


def names(found):
    """Return the names of all stops."""
    return [stop.name for stop in found.stops]


def moved(stop, name, way):
    """Return a stop at another place."""
    return FoundStop(name, replace(stop.pair, middle=stop.pair.middle + way))


@pytest.fixture
def stops(latch):
    """Return the stop of the latch, and another 20 mm away."""
    [stop] = latch.stops
    return stop, moved(stop, "stop-2", [0.0, 0.0, 20.0])


def test_a_new_stop_does_not_take_the_number_of_another(latch, stops):
    """It gets the next one, also where it is nearer and so comes first."""
    first, second = stops
    now = (FoundStop("stop-1", second.pair), moved(first, "stop-2", [0.1, 0.0, 0.0]))
    found = named_as_before(replace(latch, stops=now), latch)
    assert names(found) == ["stop-2", "stop-1"]
    both = replace(latch, stops=(first, second))
    gone = named_as_before(replace(latch, stops=(FoundStop("stop-1", second.pair),)), both)
    assert names(gone) == ["stop-2"]
    turned = replace(second.pair, normal=-second.pair.normal)
    assert names(named_as_before(replace(latch, stops=(FoundStop("stop-1", turned),)), both)) == ["stop-3"]


def test_joints_of_two_parts_are_those_nearest(latch):
    """Two joints of the same parts in another order; one that is new has a name of its own."""
    first = latch.joints[0]
    other = replace(
        first, name=f"{first.name}-2", pin=replace(first.pin, point=first.pin.point + np.array([9.0, 0.0, 0.0]))
    )
    before = replace(latch, joints=(first, other))
    now = replace(latch, joints=(replace(other, name=first.name), replace(first, name=other.name)))
    assert [joint.name for joint in named_as_before(now, before).joints] == [other.name, first.name]
    alone = replace(latch, joints=(other,))
    assert [joint.name for joint in named_as_before(before, alone).joints] == ["base-crank", "base-crank-2"]


def test_parts_of_one_product_are_those_nearest(latch):
    """A second part of a product is there: the first keeps its name, and so do its joints."""
    crank = latch.assembly.part("crank")
    beside = replace(crank, name="crank-1", bounds=crank.bounds + np.array([50.0, 0.0, 0.0]))
    parts = (beside, replace(crank, name="crank-2"))
    assembly = replace(latch.assembly, parts=parts)
    twice = replace(latch, assembly=assembly, bodies={"crank-1": "crank-1", "crank-2": "crank-2"}, joints=(), stops=())
    assert named_as_before(twice, latch).bodies == {"crank-1": "crank-1", "crank-2": "crank"}


def test_the_names_of_a_file(latch, stops):
    """A person has given other names to a body, a joint and a stop; a stop that still has its mark has its number."""
    second = stops[1]
    found = replace(latch, stops=(*latch.stops, second))
    text = proposed_mechanism(found, "latch.step", "latch")
    for old, new in (
        ("[bodies.crank]", "[bodies.Kurbel]"),
        ('body = "crank"', 'body = "Kurbel"'),
        ("[joints.base-crank]", "[joints.J1]"),
        ("# [contacts.stop-1]", "[contacts.block]"),
        ("stop-2]", "stop-7]"),
    ):
        assert old in text
        text = text.replace(old, new)
    named = named_as_written(replace(latch, stops=(second, *latch.stops)), text)
    assert named.bodies["crank"] == "Kurbel"
    assert [joint.name for joint in named.joints] == ["J1", "base-rocker", "crank-coupler", "rocker-coupler"]
    assert names(named) == ["stop-7", "block"]
    again = named_as_before(find_geometry(latch.assembly), named)
    assert (again.bodies["crank"], again.joints[0].name, names(again)) == ("Kurbel", "J1", ["block"])
    assert np.all(again.stops[0].pair.middle == latch.stops[0].pair.middle)
