"""Geometry in another unit: each number by its own power of the unit."""

import numpy as np
import pytest

from engine.cad.cad_model import in_unit
from tests.engine.cad.assemblies import full_assembly


def test_a_mass_does_not_depend_on_the_unit():
    """A density falls as a volume grows; a moment of inertia in g mm2 is one in g m2 times a million."""
    assembly = full_assembly(np.random.default_rng(1))
    metres = in_unit(assembly, 1000.0)
    solid, big = assembly.parts[0].solids[0], metres.parts[0].solids[0]
    assert big.volume * big.material.density == pytest.approx(solid.volume * solid.material.density, rel=1e-14)
    np.testing.assert_allclose(
        big.inertia * big.material.density * 1e6, solid.inertia * solid.material.density, rtol=1e-14
    )


def test_lengths_areas_and_angles():
    """Angles, directions and knots have no unit."""
    assembly = full_assembly(np.random.default_rng(1))
    inches = in_unit(assembly, 25.4)
    bore, other = assembly.faces[0], inches.faces[0]
    assert (other.radius * 25.4, other.area * 25.4**2) == pytest.approx((bore.radius, bore.area), rel=1e-14)
    [spline], [small] = assembly.faces[1].splines, inches.faces[1].splines
    np.testing.assert_allclose(small.points * 25.4, spline.points, rtol=1e-14)
    assert all(np.array_equal(a, b) for a, b in zip(small.knots, spline.knots, strict=True))
    assert inches.edges[0].span == assembly.edges[0].span
    assert inches.limits[0].upper == pytest.approx(6.12 / 25.4, rel=1e-14)
    placement = assembly.parts[0].placement
    np.testing.assert_array_equal(inches.parts[0].placement.rotation, placement.rotation)
    assert inches.recognition == pytest.approx(1e-4 / 25.4)


def test_a_placement_and_its_inverse():
    """A point of a mirrored part comes back from the assembly."""
    placement = full_assembly(np.random.default_rng(1)).parts[0].placement
    points = np.random.default_rng(2).normal(size=(5, 3))
    assert np.linalg.det(placement.matrix) == pytest.approx(-1.0)
    back = (placement.to_assembly(points) - placement.translation) @ placement.matrix
    np.testing.assert_allclose(back, points, atol=1e-14)
