"""Candidates of stops and latches with round faces: all that are drawn are found, and no others, and each can start."""

import re

import numpy as np
import pytest

from engine import check, load_mechanism
from engine.assembly import assemble
from engine.cad import read_step
from engine.cad_import.found_features import found_features
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.cad_import.updated_proposal import named_as_before, named_as_written
from tests.engine.cad import stops
from tests.engine.cad.step_files import box

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def drawn(proposal_cache, tmp_path_factory):
    """Return what is found in a drawing of all pairs, and its folder."""
    folder = tmp_path_factory.mktemp("stops")
    pairs = {name: shapes for name, (shapes, _, _) in stops.TRUE.items()} | stops.FALSE
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(proposal_cache))
        return find_geometry(read_step(stops.drawing(pairs).write(folder / "stops.step"))), folder


def owner(part):
    """Return the name of the pair that a part belongs to."""
    return part.rpartition("-")[0]


def chosen(found, folder):
    """Return the mechanism of somebody who removes the marks of all candidates."""
    text = proposed_mechanism(found, "stops.step", "stops").replace("# fixed = true", "fixed = true")
    head, asked, tail = text.partition("#? contacts")
    path = folder / "stops.toml"
    path.write_text(head + asked + re.sub(r"(?m)^# (?=\[contacts|a = |b = |material = )", "", tail), "utf-8")
    return load_mechanism(path)


@pytest.mark.slow
def test_all_that_are_drawn_and_no_others(drawn):
    """One candidate for each pair that is one, with its gap; the flat of a countersink is a second one for its ball."""
    found, _ = drawn
    gaps = {}
    for stop in found.stops:
        assert owner(stop.pair.parts[0]) == owner(stop.pair.parts[1])
        gaps.setdefault(owner(stop.pair.parts[0]), []).append(stop.pair.gap)
    assert gaps.pop("detent") == pytest.approx([0.2, 0.61127], abs=1e-5)
    wanted = {name: [gap] for name, (_, _, gap) in stops.TRUE.items() if name != "detent"}
    assert gaps.keys() == wanted.keys()
    for name, gap in gaps.items():
        assert gap == pytest.approx(wanted[name], abs=2e-3 if name == "ellipse" else 1e-9), name
    assert not found.joints
    assert [place.text for place in found_features(found) if place.kind == "no joint"] == [
        "no joint 1: pin of loose-mover in loose-frame, the radii differ by 0.5 mm; allowed: up to 0.3; if it is a"
        ' joint, write one with bearing = { body = "loose-frame", hole = { radius = 3.5, near = [0.0, 0.0, 2.5] } },'
        ' journal = { body = "loose-mover", pin = { radius = 3.0, near = [0.2, 0.0, 2.5] } }'
    ]


def test_each_can_be_chosen(drawn):
    """Without their marks all of them load and start, as the contacts they should be, with the gaps as drawn."""
    found, folder = drawn
    mechanism = chosen(found, folder)
    check(mechanism)
    assert set(mechanism.contacts) == {stop.name for stop in found.stops}
    assembly = assemble(mechanism)
    start = dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))
    for stop in found.stops:
        _, kind, gap = stops.TRUE[owner(stop.pair.parts[0])]
        if stop.pair.gap > 0.6 and gap == 0.2:  # the flat of the countersink
            kind, gap = "sphere-plane", stop.pair.gap
        assert mechanism.contacts[stop.name].kind == kind, stop.name
        assert start[stop.name] == pytest.approx(gap, abs=2e-4 if "surface" in kind else 1e-8), (stop.name, kind)


def test_a_name_that_a_person_gave_stays(drawn):
    """A candidate is known again by what its side b names, whatever that is."""
    found, _ = drawn
    text = proposed_mechanism(found, "stops.step", "stops").replace("contacts.stop-", "contacts.mine-")
    named = named_as_written(found, text)
    numbers = [stop.name.partition("-")[2] for stop in found.stops]
    assert [stop.name for stop in named.stops] == [f"mine-{number}" for number in numbers]
    assert [stop.name for stop in named_as_before(found, named).stops] == [stop.name for stop in named.stops]


def test_a_rounded_edge_beside_a_flat_is_none(tmp_path, own_cache):
    """Where a rounding goes over into a flat before the same wall, the flat alone is a candidate."""
    drawing = stops.drawing({"block": stops.rounded_block()})
    [stop] = find_geometry(read_step(drawing.write(tmp_path / "block.step"))).stops
    assert stop.sizes == "0.5 mm apart, 32 mm2 face each other"
    np.testing.assert_allclose(stop.pair.middle, [0.0, -0.5, 2.0], atol=1e-9)


@pytest.mark.slow
def test_a_face_narrower_than_a_point_is_sought_for(tmp_path, own_cache):
    """The edge of a sheet 0.6 mm thick: its candidate says within which distance of the point no other face is."""
    sheet, block = box((0.0, 0.0, 0.0), (10.0, 10.0, 0.6)), box((10.5, 0.0, -5.0), (5.0, 10.0, 10.0))
    found = find_geometry(read_step(stops.drawing({"sheet": (sheet, block)}).write(tmp_path / "stops.step")))
    side = chosen(found, tmp_path).contacts["stop-1"].b
    assert side.body == "sheet-frame"
    np.testing.assert_allclose([side.plane.point[0], *side.plane.normal], [10.0, 1.0, 0.0, 0.0], atol=1e-9)
