"""The range of a normal force, against closed forms."""

import numpy as np
import pytest
from scipy.optimize import linprog

from engine.friction import FrictionError
from engine.friction.indeterminacy import normal_force_range
from tests.each import each

pytestmark = pytest.mark.bits

LOAD = 3.0
CLOSE = 1e-7  # of the largest force
FACETS = 200


def corners(points, normals):
    """Return the rows H of contacts at ``points`` of one body, their frames from the normals."""
    rows = []
    for p, n in zip(np.asarray(points, float), np.asarray(normals, float), strict=True):
        t = np.cross(n, [0.3, 0.5, 0.8])
        frame = [n, t / np.linalg.norm(t), np.cross(n, t / np.linalg.norm(t))]
        rows += [np.concatenate([d, np.cross(p, d)]) for d in frame]
    return np.array(rows)


@pytest.mark.parametrize("mu", [0.0, 0.4])
def test_block_on_four_corners(mu):
    """By the lever rule one corner carries from nothing to half the weight, whatever the friction."""
    H = corners([(1, 2, 0), (-1, 2, 0), (-1, -2, 0), (1, -2, 0)], [(0, 0, 1)] * 4)
    r = np.tile([LOAD / 4, 0, 0], 4)
    for i in range(4):
        assert normal_force_range(H, np.full(4, mu), r, i) == pytest.approx((0, LOAD / 2), abs=CLOSE * LOAD)


def test_three_legs_are_determinate():
    """No width: the normal forces of a tripod follow from the balance; friction could wedge it only sideways."""
    H = corners([(1, 0, 0), (-1, 1, 0), (-1, -1, 0)], [(0, 0, 1)] * 3)
    r = np.array([LOAD / 2, 0, 0, LOAD / 4, 0, 0, LOAD / 4, 0, 0])
    for i in range(3):
        assert normal_force_range(H, np.full(3, 0.5), r, i) == pytest.approx((r[3 * i], r[3 * i]), abs=1e-9)


def test_a_particle_in_a_groove():
    """Two walls at 45 degrees: with friction each pushes more or less than cos 45 of the load, by closed form.

    With T = t N along each wall, balance of the symmetric pair is 2 N (cos 45 + t sin 45) = load, |t| <= mu; for one
    wall alone the extremes are those of the two forces in the plane whose sum is the load.
    """
    mu, c = 0.2, np.sqrt(0.5)
    H = np.array([[c, c], [-c, c], [0, 0], [-c, c], [-c, -c], [0, 0]])
    r = np.array([LOAD * c, 0, 0, LOAD * c, 0, 0])
    lines = [np.array([n + s * mu * t for n, t in ((H[0], H[1]), (H[3], H[4]))]) for s in (1, -1)]
    ends = [np.linalg.solve(np.array([lines[a][0], lines[b][1]]).T, [0, LOAD])[0] for a in (0, 1) for b in (0, 1)]
    low, high = normal_force_range(H, [mu, mu], r, 0)
    assert high == pytest.approx(max(ends), rel=CLOSE)
    assert low == pytest.approx(min(ends), rel=CLOSE)


def test_a_wedge_that_locks_has_no_upper_end():
    """A particle between two parallel walls may be squeezed at will; below, friction needs N >= load / (2 mu)."""
    H = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, 0, 1]])
    low, high = normal_force_range(H, [0.3, 0.3], [10.0, 1, 0, 10.0, 1, 0], 0)
    assert low == pytest.approx(1 / 0.3, abs=10.0 * CLOSE)
    assert high == np.inf


def with_planes(H, mu, r, contact, outside):
    """Return the range with each cone replaced by planes inside or outside it, by scipy's linear programmes."""
    reach = mu / np.cos(np.pi / FACETS) if outside else mu
    angles = 2 * np.pi * np.arange(FACETS) / FACETS
    edges = np.zeros((r.size, mu.size * FACETS))
    for i, m in enumerate(reach):
        columns = slice(i * FACETS, (i + 1) * FACETS)
        edges[3 * i : 3 * i + 3, columns] = np.ones(FACETS), m * np.cos(angles), m * np.sin(angles)
    for sign in (1, -1):
        found = linprog(sign * edges[3 * contact], A_eq=H.T @ edges, b_eq=H.T @ r, bounds=(0, None))
        assert found.status == 0, found.message
        yield sign * found.fun


@pytest.mark.slow
@each("seed", range(40))
def test_between_the_linear_programmes_with_planes_inside_and_outside_the_cones(seed):
    """Up to three bodies, random contacts, some frictionless: the cones themselves lie between the two."""
    rng = np.random.default_rng(seed)
    nc, n = int(rng.integers(3, 10)), 6 * int(rng.integers(1, 3))
    H, mu = rng.normal(size=(3 * nc, n)), rng.uniform(0.05, 0.6, nc) * (rng.random(nc) < 0.8)
    H[0::3, 0] = np.abs(H[0::3, 0]) + 1.0  # all push the same way: no wedge
    r = np.zeros((nc, 3))
    r[:, 0] = rng.uniform(1, 20, nc)
    r[:, 1] = 0.5 * mu * r[:, 0]
    low, high = normal_force_range(H, mu, r.ravel(), 0)
    inside, outside = (list(with_planes(H, mu, r.ravel(), 0, out)) for out in (False, True))
    room = 1e-6 * r.max()
    assert outside[0] - room <= low <= inside[0] + room
    assert inside[1] - room <= high <= outside[1] + room


def test_malformed_questions_are_named():
    """Shapes, the contact's number, forces outside their cones."""
    H = corners([(1, 0, 0)], [(0, 0, 1)])
    with pytest.raises(FrictionError, match=r"contact 1\b"):
        normal_force_range(H, [0.1], [1.0, 0, 0], 1)
    with pytest.raises(FrictionError, match="outside Coulomb's cone"):
        normal_force_range(H, [0.1], [1.0, 0.5, 0], 0)
    with pytest.raises(FrictionError, match="with 2 contacts"):
        normal_force_range(H, [0.1, 0.1], [1.0, 0, 0], 0)
    assert normal_force_range(H, [0.1], [0.0, 0, 0], 0) == (0.0, 0.0)
