"""Pins in holes made of two faces: where they are, how long, how loose."""

import numpy as np
import pytest

from engine.cad import CadFace
from engine.mechanism.geometry.cad_table import AS_DRAWN
from engine.mechanism.geometry.drawn_features import DrawnPin, NotAsDrawn, joint_of_pin

pytestmark = pytest.mark.processes


class OwnFrame:
    """The search of a part whose frame is the assembly's."""

    millimetre = 1.0
    to_body = turned_to_body = staticmethod(np.ndarray.tolist)


def face(radius, point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0), half=2.0, gap=0.0):
    at = np.array(point)
    axis = np.array(axis) / np.linalg.norm(axis)
    extent = np.array([-half, half])
    return CadFace(
        number=0,
        part="p",
        solid=0,
        kind="cylinder",
        point=at,
        axis=axis,
        radius=radius,
        extent=extent,
        area=1.0,
        on=at,
        recognition_gap=gap,
    )


def joint(hole, pin, **table):
    return joint_of_pin(
        DrawnPin(hole, pin), {"bearing": {"body": "a"}, "journal": {"body": "b"}, **table}, (OwnFrame(), OwnFrame())
    )


def refusal(hole, pin, **table):
    with pytest.raises(NotAsDrawn) as error:
        joint(hole, pin, **table)
    return error.value.key, str(error.value)


def test_the_piece_in_common():
    """Rings stand at both ends of it, whichever way the axes point."""
    for axis in ((0, 0, 1), (0, 0, -1)):
        made = joint(face(3.05), face(3.0, (0.0, 0.0, 1.0), axis, half=2.5))
        assert made["rings"] == [-1.75, 1.75]
        assert made["bearing"]["point"] == [0.0, 0.0, 0.25]
        assert made["journal"]["point"] == [0.0, 0.0, 0.25]
        assert made["journal"]["axis"] == [0.0, 0.0, 1.0]
        assert made["journal"]["radius"] == 3.0


def test_offset_and_tilt():
    """They are those of the axes at the middle."""
    tilt = 1e-3
    certificate = DrawnPin(face(3.05), face(3.0, (0.02, 0.0, 0.0), (np.sin(tilt), 0.0, np.cos(tilt)))).certificate()
    assert certificate.axis_offset == pytest.approx(0.02, abs=1e-12)
    assert certificate.tilt == pytest.approx(tilt, abs=1e-12)


@pytest.mark.parametrize(
    ("hole", "pin", "key", "words"),
    [
        (face(3.0), face(3.0), "radial_clearance", "no play: the hole has radius 3, the pin 3"),
        (face(3.0001, gap=1e-4), face(3.0, gap=1e-5), "radial_clearance", "no play"),
        (face(3.0), face(3.1), "radial_clearance", "a pin that is larger than its hole"),
        (face(3.05), face(3.0, (0, 0, 9.0)), "journal.pin", "lie 5 apart along the axis"),
        (face(3.05), face(3.0, axis=(1, 0, 0.1)), "journal.pin", "cross"),
        (face(3.05), face(3.0, (9.0, 0, 0)), "journal.pin", "its axis is 9 from that of the hole"),
    ],
)
def test_not_as_drawn(hole, pin, key, words):
    """Equal radii are never a silent clearance; faces that are no pin in a hole are none."""
    found, text = refusal(hole, pin, radial_clearance=AS_DRAWN)
    assert found == key
    assert words in text
    assert "allowed: " in text


def test_equal_radii_with_a_clearance():
    """A clearance that a person has written stays."""
    assert joint(face(3.0), face(3.0), radial_clearance=0.02)["radial_clearance"] == 0.02
