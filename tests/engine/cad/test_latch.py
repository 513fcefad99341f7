"""The latch of the docs: what is read from it is what was drawn."""

from math import pi

import numpy as np
import pytest

from engine.cad.occt.step_assembly import read_assembly
from tests.engine.cad import latch
from tests.engine.cad.test_step_reader import LATCH


@pytest.fixture
def drawn(read):
    return read(latch.drawing())


def test_the_shipped_file_is_the_drawing(drawn):
    """What the script draws is what is shipped; the order of faces is OCCT's affair."""
    shipped = read_assembly(LATCH, "0" * 64, 1e-4)
    assert [part.name for part in shipped.parts] == [part.name for part in drawn.parts]
    for ours, other in zip(drawn.parts, shipped.parts, strict=True):
        assert ours.solids[0].volume == pytest.approx(other.solids[0].volume, rel=1e-12)
        np.testing.assert_allclose(ours.solids[0].centre, other.solids[0].centre, atol=1e-12)
    assert sorted(map(described, shipped.faces)) == sorted(map(described, drawn.faces))


def described(face):
    """Return what a face is, whatever its number."""
    return face.part, face.kind, face.hollow, *(round(float(x), 6) + 0.0 for x in (face.radius, face.area, *face.axis))


def test_parts(drawn):
    """Names, materials and places."""
    assert [part.name for part in drawn.parts] == ["base", "crank", "rocker", "coupler"]
    assert [part.material.name for part in drawn.parts] == ["steel", "steel", "steel", "aluminium"]
    assert [part.material.density for part in drawn.parts] == pytest.approx([7.85e-3] * 3 + [2.7e-3], rel=1e-12)
    assert (drawn.unit, drawn.schema, drawn.cautions) == ("mm", "AP242", ())
    coupler = drawn.part("coupler").placement
    np.testing.assert_allclose(coupler.translation, [0.0, 24.0, 5.1], atol=1e-12)
    np.testing.assert_allclose(coupler.rotation[:2, 0], np.array([44.0, 6.0]) / np.hypot(44.0, 6.0), atol=1e-12)


def test_mass_of_the_coupler(drawn):
    """A bar with round ends and two bores: volume, centre and inertia in closed form."""
    length, width, height = np.hypot(44.0, 6.0), latch.WIDTH, latch.THICKNESS
    bores = [latch.RADII["crank-coupler"][1], latch.RADII["rocker-coupler"][1]]
    areas = np.array([length * width, pi * width**2 / 4, -pi * bores[0] ** 2, -pi * bores[1] ** 2])
    half_disc = 4 * (width / 2) / (3 * pi)  # from its centre to its centroid
    centres = np.array([length / 2, length / 2, 0.0, length])
    area, centre = areas.sum(), (areas @ centres) / areas.sum()
    # polar moments of area about each piece's own centre; the two half discs are apart by the length
    disc = pi * (width / 2) ** 4 / 2 - areas[1] * half_disc**2 + areas[1] * (length / 2 + half_disc) ** 2
    own = [areas[0] * (length**2 + width**2) / 12, disc, -pi * bores[0] ** 4 / 2, -pi * bores[1] ** 4 / 2]
    polar = sum(own) + areas @ (centres - centre) ** 2
    [solid] = drawn.part("coupler").solids
    assert solid.volume == pytest.approx(area * height, rel=1e-8)
    placement = drawn.part("coupler").placement
    local = (solid.centre - placement.translation) @ placement.matrix
    np.testing.assert_allclose(local, [centre, 0.0, height / 2], atol=1e-8)
    assert solid.inertia[2, 2] == pytest.approx(polar * height, rel=1e-8)


def test_radii_and_stations(drawn):
    """Each pin and each bore, where it was drawn."""
    faces = [face for face in drawn.faces if face.kind == "cylinder" and face.span > 6 and face.radius < 4]
    found = {(face.part, round(face.radius, 9)): face for face in faces}
    pins = {("base", 3.0), ("crank", 2.5), ("rocker", 2.5)}
    bores = {("crank", 3.05), ("coupler", 2.54), ("coupler", 2.55), ("rocker", 3.06)}
    assert found.keys() == pins | bores
    assert {key for key, face in found.items() if face.hollow} == bores
    bore = found["crank", 3.05]
    np.testing.assert_allclose(bore.point, [0.0, 0.0, 0.05 + 2.3], atol=1e-9)  # the countersink takes 0.4 of 5
    np.testing.assert_allclose(bore.extent, [-2.3, 2.3], atol=1e-9)


def test_limits(drawn):
    """Those on the crank's bore and the base's pin, on the faces they were attached to."""
    bore, pin = drawn.limits
    assert (bore.kind, bore.nominal, bore.lower, bore.upper) == ("diameter", 6.1, 6.09, 6.12)
    assert (pin.kind, pin.nominal, pin.lower, pin.upper) == ("diameter", 6.0, 5.992, 6.0)
    assert [drawn.faces[limit.faces[0]].part for limit in (bore, pin)] == ["crank", "base"]
    assert [drawn.faces[limit.faces[0]].radius for limit in (bore, pin)] == pytest.approx([3.05, 3.0], abs=1e-9)
