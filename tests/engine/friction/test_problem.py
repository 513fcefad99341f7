"""The friction solver against closed forms, against another method, and on problems made to be hard."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.heaps import build_heap, dense_problem
from engine.friction import FrictionError, FrictionProblem, solve
from engine.friction.problem import solver_arrays
from engine.friction.solver import solve_friction
from engine.jit.lanes import LANES
from tests.counts import many
from tests.each import each
from tests.engine.friction.problems import hard_problem, natural_map_residual, projected_gauss_seidel, random_problem

pytestmark = pytest.mark.bits


def particle(q, mu, mass=2.0):
    """One contact under a particle."""
    return FrictionProblem(mass * np.eye(3), np.eye(3), q, [mu])


def test_particle_that_parts_feels_nothing():
    """Take-off: r = 0 when the free velocity opens the contact."""
    solution = solve(particle([0.3, 1.0, -2.0], 0.5))
    np.testing.assert_allclose(solution.r, 0, atol=1e-12)


def test_particle_that_sticks_is_stopped():
    """Sticking: the impulse M (-q) lies inside the cone."""
    solution = solve(particle([-1.0, 0.2, 0.1], 0.5))
    np.testing.assert_allclose(solution.u, 0, atol=1e-7)
    np.testing.assert_allclose(solution.r, [2.0, -0.4, -0.2], rtol=1e-6)


def test_particle_that_slides_obeys_coulomb():
    """Sliding: |r_T| = mu r_N, against the slip."""
    solution = solve(particle([-1.0, 3.0, 4.0], 0.5))
    np.testing.assert_allclose(solution.r, [2.0, -0.6, -0.8], rtol=1e-6)
    np.testing.assert_allclose(solution.u, [0.0, 2.7, 3.6], atol=1e-6)


@each("kind", ["static", "moving", "impact"])
@each("contacts", [1, 5, 12, 24, 40, 70])
def test_random_problems_reach_the_tolerance(kind, contacts):
    """Redundant problems (up to 5 rows per degree of freedom) reach 1e-8, and the residual told is the true one."""
    for seed in range(8):
        problem = random_problem(seed, contacts, kind=kind)
        solution = solve(problem)
        assert solution.converged, (seed, solution.residual)
        assert natural_map_residual(problem, solution.r) <= 1e-8 * (1 + 1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_velocities_agree_with_gauss_seidel(seed):
    """Another method on the same problem ends at the same motion (impulses need not be unique)."""
    problem = random_problem(seed, 6, bodies=3)
    r, u = projected_gauss_seidel(problem)
    assert natural_map_residual(problem, r) < 1e-8
    np.testing.assert_allclose(solve(problem, 1e-10).u, u, atol=1e-6 * np.abs(problem.q).max())


@pytest.mark.parametrize("mu", [0.0, 1e-6, 0.01, 1.0, 2.5, 20.0])
def test_any_coefficient_of_friction(mu):
    """Frictionless, nearly so, and far above one."""
    for seed in range(4):
        problem = random_problem(seed, 10, kind="moving")
        problem = FrictionProblem(problem.M, problem.H, problem.q, np.full(10, mu))
        solution = solve(problem)
        assert solution.converged, (seed, solution.residual)
        assert natural_map_residual(problem, solution.r) <= 1.001e-8


def test_duplicated_contacts_share_the_load():
    """Each contact three times: still solved, and the sum of the copies moves the bodies alike."""
    once = random_problem(3, 8)
    H = np.repeat(once.H.reshape(8, 3, -1), 3, axis=0).reshape(72, -1)
    q = np.repeat(once.q.reshape(8, 3), 3, axis=0).ravel()
    thrice = FrictionProblem(once.M, H, q, np.repeat(once.mu, 3))
    a, b = solve(once, 1e-10), solve(thrice, 1e-10)
    assert b.converged
    np.testing.assert_allclose(b.v, a.v, atol=1e-5 * np.abs(a.v).max())


def test_mass_ratio_of_ten_thousand():
    """Light parts between heavy ones."""
    for seed in range(6):
        assert solve(random_problem(seed, 20, mass_ratio=1e4)).converged


def test_hard_problems_are_solved_and_their_residual_is_the_true_one():
    """Masses up to 10,000 times apart, copies, friction to 1.3: what is called solved is; most are."""
    solved = 0
    for seed in range(60):
        problem = hard_problem(seed)
        solution = solve(problem)
        solved += solution.converged
        assert (
            natural_map_residual(problem, solution.r) <= 1.001 * solution.residual + 1e-9
        )  # rounding of large impulses
        assert solution.status != "infeasible"  # all of them have a solution
    assert solved >= 59


@pytest.mark.parametrize("seed", [10704, 11137, 11292, 11505, 11604])
def test_the_convex_problem_leads_where_smoothing_ends_at_a_fold(seed):
    """With the whole of mu |u_T| from the first step on, no weight and no beginning solved these."""
    assert solve(hard_problem(seed)).converged


@pytest.mark.parametrize("seed", [1257, 1323])
def test_places_behind_the_last_contact_do_not_end_the_interior_point_method(seed):
    """54 and 25 contacts leave places in the lanes empty: numbers of theirs in the residual cost 362 and 553 steps."""
    problem = hard_problem(seed)
    assert problem.mu.size % LANES
    solution = solve(problem)
    assert solution.converged
    assert solution.iterations < 250


def test_what_overflows_is_not_called_solved():
    """Rows near the largest double at rest: u = H v is NaN; a residual of 0 would hide it."""
    problem = random_problem(0, 4, bodies=2)
    for large in (1.7e308, -1.7e308):
        problem = FrictionProblem(problem.M, np.full(problem.H.shape, large), np.zeros(12), problem.mu)
        solution = solve(problem)
        assert not solution.converged
        assert not solution.residual <= 1e-8


def test_contacts_are_given_back_in_their_own_units():
    """A contact between light bodies among heavy ones: u = H v + q, M v = H' r, and rows as they were."""
    problem = random_problem(2, 20, mass_ratio=1e4)
    solution = solve(problem)
    np.testing.assert_allclose(problem.H @ solution.v + problem.q, solution.u, atol=1e-12 * np.abs(problem.q).max())
    arrays, _ = solver_arrays(problem)
    rows = arrays.rows.G.copy()
    arrays.q[:], arrays.mu[:] = problem.q.reshape(20, 3), problem.mu
    solve_friction(20, arrays, 1e-8)
    np.testing.assert_array_equal(arrays.rows.G, rows)
    np.testing.assert_allclose(arrays.r.ravel(), solution.r, rtol=1e-12)


@settings(max_examples=many(30), deadline=None)
@given(length=st.floats(1e-3, 1e3), mass=st.floats(1e-3, 1e3), time=st.floats(1e-3, 1e3), seed=st.integers(0, 50))
def test_residual_does_not_depend_on_units(length, mass, time, seed):
    """In other units it is the same problem: same residual, impulses scaled by the unit of impulse."""
    problem = random_problem(seed, 8, bodies=3)
    scale = np.tile([1.0, 1.0, 1.0, length, length, length], 3)  # a rotation's column is a length
    other = FrictionProblem(
        mass * problem.M * np.outer(scale, scale), problem.H * scale, problem.q * length / time, problem.mu
    )
    r = projected_gauss_seidel(problem, sweeps=5)[0]
    assert natural_map_residual(other, r * mass * length / time) == pytest.approx(natural_map_residual(problem, r))
    assert solve(other).converged


@pytest.mark.parametrize("load", [1e-12, 1e12])
def test_any_size_of_load(load):
    """The solution is as large as the load, to the last digits."""
    problem = random_problem(4, 24)
    scaled = FrictionProblem(problem.M, problem.H, load * problem.q, problem.mu)
    a, b = solve(problem), solve(scaled)
    assert b.converged
    np.testing.assert_allclose(b.u, load * a.u, atol=1e-6 * load * np.abs(a.u).max())


def test_mixed_coefficients_of_friction():
    """None, little and much friction side by side."""
    for seed in range(6):
        problem = random_problem(seed, 24)
        rng = np.random.default_rng(seed)
        mu = 10 ** rng.uniform(-3, 1, 24) * (rng.random(24) < 0.8)
        problem = FrictionProblem(problem.M, problem.H, problem.q, mu)
        solution = solve(problem)
        assert solution.converged, (seed, solution.residual)
        assert natural_map_residual(problem, solution.r) <= 1.001e-8


def test_what_has_no_solution_is_not_called_solved():
    """Two walls that close on a particle: ever larger impulses do not stop them, and do not pass for a solution."""
    H = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, 0, 1]])
    solution = solve(FrictionProblem(np.eye(3), H, [-1.0, 0, 0, -1.0, 0, 0], [0.3, 0.3]))
    assert not solution.converged
    assert solution.residual > 1e-8


def test_zero_load_and_no_contacts():
    """Nothing to do is done at once."""
    problem = random_problem(0, 4)
    still = solve(FrictionProblem(problem.M, problem.H, np.zeros(12), problem.mu))
    assert still.converged
    assert still.iterations == 0
    assert not still.r.any()
    assert solve(FrictionProblem(np.eye(6), np.zeros((0, 6)), [], [])).converged


def test_a_warm_start_saves_iterations():
    """From the solution of a neighbouring problem."""
    problem = random_problem(5, 24, kind="static")
    cold = solve(problem)
    near = FrictionProblem(problem.M, problem.H, problem.q * (1 + 1e-6), problem.mu)
    assert solve(near, start=cold.r).iterations < cold.iterations


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"H": np.zeros((5, 6))}, "H has shape"),
        ({"q": [0, np.nan, 0]}, "q holds a number that is not finite"),
        ({"mu": [-0.1]}, r"mu\[0\] = -0.1; allowed: >= 0"),
        ({"M": -np.eye(6)}, "not symmetric positive definite"),
        ({"M": np.eye(6) + np.eye(6, k=2) / 8}, r"M is not symmetric: \[0, 2\] is 0.125, \[2, 0\] is 0;"),
    ],
)
def test_malformed_problems_are_named(change, text):
    """One message that names the array at fault."""
    arrays = {"M": np.eye(6), "H": np.eye(6)[:3], "q": [-1.0, 0, 0], "mu": [0.1], **change}
    with pytest.raises(FrictionError, match=text):
        solve(FrictionProblem(**arrays))


def test_a_heap_of_rolling_balls_is_solved_or_nearly_so():
    """Newton's methods alone left 6e-3 and 1.1e-2 of the load; what is given is never made worse."""
    for bodies, least in ((30, 1e-8), (91, 1e-3)):
        problem = dense_problem(build_heap("balls", bodies))
        found = solve(problem)
        assert found.residual <= least
        assert natural_map_residual(problem, found.r) == pytest.approx(found.residual, rel=1e-3, abs=1e-12)
        again = solve(problem, start=found.r)
        assert again.residual <= found.residual
