"""Ends of bearings and flanges of journals."""

import pytest

from engine.cad.findings.facing_planes import thrust_faces, triangles_by_face
from engine.cad.findings.joints import pins_in_holes
from tests.engine.cad import latch
from tests.engine.cad.hinges import PLAY, THICKNESS, cut_in_two, hinge, plate, stud


def found(assembly):
    """Return the thrust faces of all joints, by the joint's parts."""
    triangles = triangles_by_face(assembly)
    joints, _ = pins_in_holes(assembly)
    return {f"{j.journal}-{j.bearing}": thrust_faces(assembly, j, triangles) for j in joints}


def test_the_latch(read):
    """Each joint has a flange at both ends, with the play of the drawing."""
    by_joint = found(read(latch.drawing()))
    assert by_joint.keys() == latch.RADII.keys()
    for name, (pin, _) in latch.RADII.items():
        start, end = by_joint[name]
        assert (start.side, end.side) == ("start", "end")
        assert (start.play, end.play) == pytest.approx((latch.AXIAL_PLAY,) * 2, abs=1e-9)
        assert end.station - start.station == pytest.approx(latch.THICKNESS, abs=1e-9)
        assert end.radius == pytest.approx(pin + 2, abs=1e-9)  # of the cap


@pytest.mark.parametrize("drawn", [lambda shape: shape, cut_in_two], ids=["whole", "halves"])
def test_a_stud_without_a_cap(read, drawn):
    """It has a flange at its foot only; a plane that the export has cut is one face."""
    [[start]] = found(read(hinge(drawn(plate()), drawn(stud())))).values()
    assert (start.side, start.play) == ("start", pytest.approx(PLAY, abs=1e-9))
    assert start.station == pytest.approx(-THICKNESS / 2, abs=1e-9)
    assert 3.05 < start.radius <= 3 * 3.05


def test_a_face_far_away_is_no_flange(read):
    """A pin that is free to slide has none."""
    assert found(read(hinge(z=1.5))) == {"stud-plate": []}
