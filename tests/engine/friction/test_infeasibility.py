"""Problems whose truth is known: made from a solution, or from impulses that prove that there is none."""

import numpy as np
import pytest

from engine.friction import FrictionProblem, solve
from engine.friction.infeasibility import squeezing_impulses
from tests.each import each

pytestmark = pytest.mark.bits

SEEDS = range(100)
MORE_SEEDS = range(100, 1000)
KINDS = ("plain", "duplicates", "static", "plane", "wedge")


def random_rows(rng: np.random.Generator, nc: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return M and H of ``nc`` contacts between bodies whose masses differ by up to a million.

    duplicates: a third of the contacts are one and the same; static: some lie between fixed bodies, H = 0; plane: no
    contact knows the third direction; wedge: two contacts face each other but for a small angle.
    """
    bodies = int(rng.integers(1, 9))
    mass = 10 ** rng.uniform(0, rng.uniform(0, 6), bodies)
    H = np.zeros((nc, 3, 6 * bodies))
    for i in range(nc):
        for body in rng.choice(bodies, min(bodies, 2), replace=False):
            H[i, :, 6 * body : 6 * body + 6] = rng.standard_normal((3, 6))
    if kind == "duplicates":
        H[rng.choice(nc, nc // 3, replace=False)] = H[rng.integers(nc)]
    if kind == "static":
        H[rng.random(nc) < 0.3] = 0.0
    if kind == "plane":
        H[:, 2] = 0.0
    if kind == "wedge" and nc > 1:
        H[1] = -H[0]
        H[1, 0] += 10 ** rng.uniform(-7, -1) * rng.standard_normal(6 * bodies) * (H[0, 0] != 0)
    return np.diag(np.repeat(mass, 6)), H


def solvable(seed: int) -> FrictionProblem:
    """Make a problem from a solution: contacts that are open, slide or stick, with the velocities of their impulses."""
    rng = np.random.default_rng(seed)
    nc = int(rng.integers(1, 61))
    M, H = random_rows(rng, nc, KINDS[seed % len(KINDS)])
    mu = rng.uniform(0, 1.3, nc) * (rng.random(nc) < 0.8)
    r, u = np.zeros((nc, 3)), np.zeros((nc, 3))
    for i, state in enumerate(rng.integers(0, 3, nc)):
        way = rng.standard_normal(2)
        way /= np.linalg.norm(way)
        if state == 0:
            u[i] = rng.random(), *rng.standard_normal(2)
        else:
            r[i, 0] = rng.random()
            r[i, 1:] = -(1.0 if state == 1 else rng.random()) * mu[i] * r[i, 0] * way
            u[i, 1:] = rng.random() * way if state == 1 else 0.0
    H = H.reshape(3 * nc, -1)
    return FrictionProblem(M, H, u.ravel() - H @ np.linalg.solve(M, H.T @ r.ravel()), mu)


def infeasible(seed: int) -> FrictionProblem:
    """Make a problem from a certificate: some normals cancel with positive weights; their mean approach is given."""
    rng = np.random.default_rng(seed)
    nc = int(rng.integers(1, 61))
    M, H = random_rows(rng, nc, KINDS[seed % len(KINDS)])
    q = rng.standard_normal((nc, 3))
    chosen = rng.choice(nc, int(rng.integers(1, min(nc, len(M)) + 1)), replace=False)
    p = rng.uniform(0.05, 1.0, chosen.size)
    H[chosen[-1], 0] = -(p[:-1] @ H[chosen[:-1], 0]) / p[-1]
    approach = 10 ** rng.uniform(-4, 0) * np.abs(q).max()
    q[chosen, 0] -= approach + p @ q[chosen, 0] / p.sum()
    return FrictionProblem(M, H.reshape(3 * nc, -1), q.ravel(), rng.uniform(0, 1.3, nc))


def judge_certificate(problem: FrictionProblem, p: np.ndarray) -> None:
    """Check in plain NumPy that the impulses balance, and that the contacts close on average."""
    N, q = problem.H[::3], problem.q[::3]
    root = np.sqrt(np.diag(problem.M))  # these masses are diagonal
    largest = np.max(p * np.linalg.norm(N / root, axis=1), initial=0)
    assert (p >= 0).all()
    assert p.sum() == pytest.approx(1)
    assert np.linalg.norm(p @ N / root) <= 1e-12 * max(largest, 1e-300)
    assert -p @ q > 1e-9 * np.abs(problem.q).max()


def judge_solvable(seed: int) -> bool:
    """Judge a problem with a solution; return whether it was found."""
    problem = solvable(seed)
    root = np.sqrt(np.diag(problem.M))
    assert squeezing_impulses(problem.H[::3] / root, problem.q[::3], float(np.abs(problem.q).max())) is None
    solution = solve(problem)
    assert solution.status in ("converged", "not_converged")
    assert solution.certificate is None
    if solution.converged:
        speed = max(np.linalg.norm(problem.q), np.linalg.norm(solution.u))
        assert solution.u[::3].min() >= -2e-6 * speed
    return solution.converged


def judge_infeasible(seed: int) -> None:
    """Judge a problem without solution."""
    problem = infeasible(seed)
    solution = solve(problem)
    assert solution.status == "infeasible", (seed, solution.residual)
    judge_certificate(problem, solution.certificate)


def test_what_has_a_solution_is_not_called_infeasible():
    """Thin wedges, masses a million times apart, redundant and static contacts; nearly all are solved."""
    assert sum(judge_solvable(seed) for seed in SEEDS) >= 0.9 * len(SEEDS)


def test_what_has_no_solution_is_infeasible_with_a_certificate_that_holds():
    """The same rows, with a certificate built in: none is called solved."""
    for seed in SEEDS:
        judge_infeasible(seed)


def test_an_approach_that_huge_velocities_hide_is_still_infeasible():
    """Impulses of 1e8 make the bodies 400 times as quick as q: relative to that, an approach of 1e-4 of q is small."""
    judge_infeasible(199)


def test_rounding_of_the_rows_does_not_decide():
    """The same 55 contacts, rounded in a hundred ways: SciPy's limit of steps ended the search in one of fourteen."""
    problem, rng = infeasible(883), np.random.default_rng(883)
    rows, q = problem.H[::3] / np.sqrt(np.diag(problem.M)), problem.q[::3]
    for _ in range(100):
        rounded = rows * (1 + 2.0**-53 * rng.integers(-1, 2, rows.shape))
        assert squeezing_impulses(rounded, q, float(np.abs(q).max())) is not None


@pytest.mark.slow
def test_a_thousand_of_each_kind():
    """As above, many more."""
    assert sum(judge_solvable(seed) for seed in MORE_SEEDS) >= 0.9 * len(MORE_SEEDS)
    for seed in MORE_SEEDS:
        judge_infeasible(seed)


@pytest.mark.parametrize("q", [(-0.0546, -0.31, 1.44), (-0.187, 0.0, 0.9), (-1.0, 0.0, 0.0)])
def test_a_contact_between_fixed_bodies_that_closes(q):
    """H = 0: nothing can be moved. An impulse of 5.6e6 made the residual 9.7e-9, and the approach of 0.05 passed."""
    solution = solve(FrictionProblem(np.eye(3), np.zeros((3, 3)), q, [0.08]))
    assert (solution.status, solution.converged) == ("infeasible", False)
    assert solution.certificate.tolist() == [1.0]


@each("seed", range(20))
def test_walls_that_close_on_a_body_that_also_slides(seed):
    """Rank-deficient: two walls face each other, whatever slides; the certificate names both, and no other."""
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    other = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    H = np.vstack([frame, [-frame[0], frame[1], -frame[2]], other])
    q = np.concatenate([[-0.2, *rng.normal(size=2)], [0.05, *rng.normal(size=2)], [1.0, 0, 0]])
    solution = solve(FrictionProblem(np.eye(3), H, q, rng.uniform(0, 0.3, 3)))
    assert solution.status == "infeasible"
    np.testing.assert_allclose(solution.certificate, [0.5, 0.5, 0], atol=1e-12)


@each("angle", [1e-8, 1e-6, 1e-4, 1e-2])
@each("mass", [1.0, 1e6])
def test_a_thin_wedge_may_still_escape(angle, mass):
    """Two walls that close on a particle, open by a small angle: a quick enough escape satisfies both."""
    N = np.array([[1.0, 0, 0], [-np.cos(angle), np.sin(angle), 0]]) / np.sqrt(mass)
    assert squeezing_impulses(N, np.array([-1.0, -1.0]), 1.0) is None
    assert squeezing_impulses(N, np.array([-1.0, -1.0]), 1.0, held=np.array([[0, 1.0, 0]])) is not None


def test_bilateral_rows_may_be_redundant_and_their_impulses_do_not_count():
    """A body on a slide, held by three rows, two of them the same: one stop may be evaded along it, two may not."""
    held = np.array([[0, 1.0, 0], [0, -3.0, 0], [0, 0, 2.0]])
    stop = np.array([[1.0, 0.5, 0.2], [-1.0, 0.3, 0.1]])
    assert squeezing_impulses(stop[:1], np.array([-1.0]), 1.0, held) is None
    impulses = squeezing_impulses(stop, np.array([-1.0, 0.4]), 1.0, held)
    np.testing.assert_allclose(impulses, [0.5, 0.5], atol=1e-12)
    assert squeezing_impulses(stop, np.array([-1.0, 1.4]), 1.0, held) is None
