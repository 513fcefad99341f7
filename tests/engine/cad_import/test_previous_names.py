"""Names of parts, joints and stops stay with the geometry that they were given to."""

from dataclasses import replace

import numpy as np
import pytest

from engine.cad_import.found_geometry import FoundStop, find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.cad_import.updated_proposal import named_as_before, named_as_written, renamed_parts

pytestmark = pytest.mark.processes


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


def called(latch, old, new, **changes):
    """Return the latch with another name for a part and its product, and other changes of its solid."""
    parts = tuple(
        replace(part, name=new, product=new, solids=tuple(replace(solid, **changes) for solid in part.solids))
        if part.name == old
        else part
        for part in latch.assembly.parts
    )
    faces = tuple(replace(face, part=new) if face.part == old else face for face in latch.assembly.faces)
    meshes = tuple(replace(mesh, part=new) if mesh.part == old else mesh for mesh in latch.assembly.meshes)
    return find_geometry(replace(latch.assembly, parts=parts, faces=faces, meshes=meshes))


def test_a_renamed_part_keeps_its_body(latch):
    """It is known by its solid: body and joints keep their names, and the new name of the part is in its line alone."""
    found = named_as_before(called(latch, "crank", "lever"), latch)
    assert found.bodies["lever"] == "crank"
    assert [joint.name for joint in found.joints] == [joint.name for joint in latch.joints]
    assert renamed_parts(found, latch) == [("crank", "crank", "lever")]
    before, after = (proposed_mechanism(each, "latch.step", "latch").splitlines() for each in (latch, found))
    [line] = [new for old, new in zip(before, after, strict=True) if old != new]
    assert line.startswith('part = "lever"')


def test_another_part_is_not_a_renamed_one(latch):
    """One with another volume, or in another place, has a body of its own."""
    crank = latch.assembly.part("crank").solids[0]
    for change in (
        {"volume": 1.001 * crank.volume},
        {"centre": crank.centre + 0.1},
        {"inertia": 1.001 * crank.inertia},
    ):
        found = named_as_before(called(latch, "crank", "lever", **change), latch)
        assert found.bodies["lever"] == "lever"
        assert renamed_parts(found, latch) == []
