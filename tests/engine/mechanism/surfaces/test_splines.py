"""B-splines as bicubic patches: exactly where they can be, within the proved error elsewhere."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from engine.mechanism.surfaces.patches import normals, points
from engine.mechanism.surfaces.surface import BSplineSurface, bicubic_patches
from tests.engine.kernels.surface_shapes import knots

Array = np.ndarray
T = np.linspace(0, 1, 9)


def drawn(degree: tuple[int, int], counts: tuple[int, int], rng: np.random.Generator, rational: bool) -> BSplineSurface:
    """Draw a sheet over a square, with knots at uneven distances."""
    u, v = np.meshgrid(*(np.linspace(0, 4, n) for n in counts), indexing="ij")
    control = np.stack([u, v, np.zeros_like(u)], axis=-1) + rng.normal(scale=0.2, size=(*counts, 3))
    uneven = [np.array(knots(n, p)) ** 1.5 for n, p in zip(counts, degree, strict=True)]
    weights = rng.uniform(0.5, 2.0, counts) if rational else np.ones(counts)
    return BSplineSurface(degree, (uneven[0], uneven[1]), control, weights)


def evaluated(surface: BSplineSurface, u: Array, v: Array) -> Array:
    """Return points of a rational B-spline on a grid, by SciPy."""
    w = surface.weights[..., None]
    homogeneous = np.concatenate([surface.control * w, w], axis=-1)
    along_u = BSpline(surface.knots[0], homogeneous, surface.degree[0])(u)
    both = np.moveaxis(BSpline(surface.knots[1], np.moveaxis(along_u, 1, 0), surface.degree[1])(v), 0, 1)
    return both[..., :3] / both[..., 3:]


def distance_from(surface: BSplineSurface, cuts: tuple[Array, Array], patches: Array) -> float:
    """Return the largest distance of patches from a B-spline at the same parameters, at 9 x 9 of each patch."""
    found, n = points(patches, T, T), 0
    worst = 0.0
    for low_u, high_u in zip(cuts[0], cuts[0][1:], strict=False):
        for low_v, high_v in zip(cuts[1], cuts[1][1:], strict=False):
            wanted = evaluated(surface, low_u + (high_u - low_u) * T, low_v + (high_v - low_v) * T)
            worst = max(worst, float(np.linalg.norm(found[n] - wanted, axis=-1).max()))
            n += 1
    return worst


@settings(max_examples=20, deadline=None, derandomize=True)
@given(p=st.integers(1, 3), q=st.integers(1, 3), more=st.integers(1, 4), seed=st.integers(0, 1000))
def test_polynomials_of_no_more_than_the_third_degree_are_exact(p, q, more, seed):
    surface = drawn((p, q), (p + more, q + 2), np.random.default_rng(seed), rational=False)
    found = bicubic_patches(surface, 1e-9)
    cuts = tuple(np.unique(k) for k in surface.knots)
    assert len(found.patches) == (len(cuts[0]) - 1) * (len(cuts[1]) - 1)
    assert found.error < 1e-13
    assert distance_from(surface, cuts, found.patches) < 1e-13


def test_knots_that_differ_by_rounding_alone():
    """Between them the surface goes straight to the last row of control points; before, it is that of the others."""
    control = drawn((3, 3), (5, 4), np.random.default_rng(2), rational=False).control
    almost = np.array([0.0, 0.0, 0.0, 0.0, 1.0 - 2.0**-53, 1.0, 1.0, 1.0, 1.0])
    found = bicubic_patches(BSplineSurface((3, 3), (almost, np.array(knots(4, 3))), control, np.ones((5, 4))), 1e-9)
    np.testing.assert_allclose(found.patches[0], control[:4], atol=1e-14)
    np.testing.assert_allclose(found.patches[1, [0, 3]], control[3:], atol=1e-14)


@pytest.mark.parametrize(("degree", "rational"), [((5, 4), False), ((2, 3), True), ((7, 1), True)])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_others_are_within_the_error_that_is_stated(degree, rational, tolerance):
    """SciPy's points are nowhere farther than the bound, and the bound is no more than was asked for."""
    surface = drawn(degree, (degree[0] + 2, degree[1] + 1), np.random.default_rng(3), rational)
    found = bicubic_patches(surface, tolerance)
    assert found.complete
    assert found.error <= tolerance
    where = [np.linalg.norm(points(found.patches, [0], [0])[:, 0, 0] - evaluated(surface, [0.0], [0.0])[0, 0], axis=1)]
    assert where[0].min() < 1e-12
    cuts = tuple(corner_parameters(surface, found.patches, axis) for axis in (0, 1))
    assert (len(cuts[0]) - 1) * (len(cuts[1]) - 1) == len(found.patches)
    assert distance_from(surface, cuts, found.patches) <= found.error


def corner_parameters(surface: BSplineSurface, patches: Array, axis: int) -> Array:
    """Return the parameters at which a surface was cut: its knots, halved until the patches' corners are all there."""
    cuts = np.unique(surface.knots[axis])
    corners = points(patches, [0, 1], [0, 1]).reshape(-1, 3)
    other = np.array([surface.knots[1 - axis][0]])
    halved = True
    while halved:
        middles = 0.5 * (cuts[:-1] + cuts[1:])
        at = evaluated(surface, *((middles, other) if axis == 0 else (other, middles))).reshape(-1, 3)
        there = np.linalg.norm(at[:, None] - corners[None], axis=-1).min(axis=1) < 1e-11
        cuts, halved = np.sort(np.concatenate([cuts, middles[there]])), bool(there.any())
    return cuts


def test_normals_are_continuous_across_patches():
    """A rational sheet of the second degree in several patches: at common corners and edges one normal."""
    surface = drawn((2, 2), (3, 3), np.random.default_rng(4), rational=True)
    found = bicubic_patches(surface, 1e-4)
    n = normals(found.patches, T)
    at = points(found.patches, T, T)
    side = round(len(found.patches) ** 0.5)
    assert side > 1
    for k in range(len(found.patches) - 1):
        if (k + 1) % side:  # the next patch along v
            np.testing.assert_allclose(at[k, :, -1], at[k + 1, :, 0], atol=1e-12)
            np.testing.assert_allclose(n[k, :, -1], n[k + 1, :, 0], atol=1e-10)


def test_an_error_that_takes_too_many_patches_is_not_reached():
    surface = drawn((2, 2), (3, 3), np.random.default_rng(5), rational=True)
    found: Any = bicubic_patches(surface, 1e-13)
    assert not found.complete
    assert found.error > 1e-13
