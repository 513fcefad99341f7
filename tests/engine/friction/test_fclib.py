"""FCLIB files: round trips, files made by hand in the documented layout, and files that are wrong."""

import h5py
import numpy as np
import pytest

from engine.friction import FrictionError, FrictionProblem, read_fclib, read_fclib_impulses, solve, write_fclib
from tests.each import each
from tests.engine.friction.problems import random_problem

pytestmark = pytest.mark.bits


def delassus(problem):
    """Return W = H M^-1 H'."""
    return problem.H @ np.linalg.solve(problem.M, problem.H.T)


@pytest.mark.parametrize("form", ["global", "local"])
def test_round_trip(tmp_path, form):
    """W, q, mu and the impulses come back to the last digits."""
    problem = random_problem(1, 12)
    solution = solve(problem)
    write_fclib(tmp_path / "p.hdf5", problem, solution, form)
    again = read_fclib(tmp_path / "p.hdf5")
    np.testing.assert_allclose(delassus(again), delassus(problem), atol=1e-12)
    np.testing.assert_allclose(again.q, problem.q, atol=1e-14)
    np.testing.assert_array_equal(again.mu, problem.mu)
    np.testing.assert_array_equal(read_fclib_impulses(tmp_path / "p.hdf5"), solution.r)
    assert solve(again).converged
    with pytest.raises(FileExistsError):
        write_fclib(tmp_path / "p.hdf5", problem)


def put_matrix(group, name, dense, nz):
    """Write a matrix by its definition: triplets (nz >= 0), compressed columns (-1) or rows (-2)."""
    part = group.create_group(name)
    m, n = dense.shape
    outer = dense.T if nz == -1 else dense
    found = [(a, b, outer[a, b]) for a in range(outer.shape[0]) for b in range(outer.shape[1]) if outer[a, b] != 0]
    part["p"] = np.array([a for a, _, _ in found], "i4")
    if nz < 0:
        del part["p"]
        part["p"] = np.array([sum(a < k for a, _, _ in found) for k in range(outer.shape[0] + 1)], "i4")
    part["i"] = np.array([b for _, b, _ in found], "i4")
    part["x"] = np.array([x for _, _, x in found])
    for key, value in {"m": m, "n": n, "nzmax": len(found), "nz": len(found) if nz >= 0 else nz}.items():
        part[key] = np.array([value], "i4")


@pytest.mark.parametrize("nz", [0, -1, -2])
def test_a_global_file_made_by_hand(tmp_path, nz):
    """M v = H r + f, u = H' v + w, every kind of storage: a particle of mass 2 pressed by 6 slides."""
    with h5py.File(tmp_path / "p.hdf5", "w") as file:
        group = file.create_group("fclib_global")
        group["spacedim"] = np.array([3], "i4")
        put_matrix(group, "M", 2 * np.eye(3), nz)
        put_matrix(group, "H", np.eye(3), nz)
        group["vectors/f"], group["vectors/w"] = np.array([-6.0, 0, 0]), np.array([1.0, 3.0, 4.0])
        group["vectors/mu"] = np.array([0.5])
    solution = solve(read_fclib(tmp_path / "p.hdf5"))
    np.testing.assert_allclose(solution.r, [4.0, -1.2, -1.6], rtol=1e-6)
    np.testing.assert_allclose(solution.u, [0.0, 2.4, 3.2], atol=1e-6)


def test_equality_constraints_are_eliminated(tmp_path):
    """Two particles held together are one of their mass: by G, b in the global form, by V, R, s in the local."""
    both = np.vstack([np.eye(3), -np.eye(3)])
    H = np.vstack([np.eye(3), np.zeros((3, 3))])
    with h5py.File(tmp_path / "g.hdf5", "w") as file:
        group = file.create_group("fclib_global")
        group["spacedim"] = np.array([3], "i4")
        for name, matrix in {"M": 2 * np.eye(6), "H": H, "G": both}.items():
            put_matrix(group, name, matrix, -1)
        for name, vector in {"f": [-6.0, 0, 0, 0, 0, 0], "w": [0.0, 3, 4], "mu": [0.5], "b": [0.5, 0, 0]}.items():
            group[f"vectors/{name}"] = np.array(vector)
    one = read_fclib(tmp_path / "g.hdf5")
    np.testing.assert_allclose(delassus(one), np.eye(3) / 4, atol=1e-12)
    np.testing.assert_allclose(one.q, [-1.75, 3, 4], atol=1e-12)  # together -6/4; apart by b, a half to each side
    with h5py.File(tmp_path / "l.hdf5", "w") as file:
        group = file.create_group("fclib_local")
        group["spacedim"] = np.array([3], "i4")
        for name, matrix in {"W": np.eye(3) / 2, "V": np.eye(3) / 2, "R": np.eye(3)}.items():
            put_matrix(group, name, matrix, -1)
        for name, vector in {"q": [-3.0, 3, 4], "mu": [0.5], "s": [-2.5, 0, 0]}.items():
            group[f"vectors/{name}"] = np.array(vector)
    other = read_fclib(tmp_path / "l.hdf5")
    np.testing.assert_allclose(delassus(other), np.eye(3) / 4, atol=1e-12)
    np.testing.assert_allclose(other.q, [-1.75, 3, 4], atol=1e-12)


def spoil(file, name, value):
    """Replace a dataset, or delete it."""
    del file[name]
    if value is not None:
        file[name] = value


@each(
    ("form", "name", "value", "text"),
    [
        ("local", "fclib_local/vectors/q", None, "fclib_local/vectors/q: missing"),
        ("local", "fclib_local/vectors/mu", np.ones(3), "expected a vector of 4 numbers"),
        ("local", "fclib_local/spacedim", np.array([2]), "spacedim = 2; only 3"),
        ("local", "fclib_local/W/m", np.array([10**9]), "m = 1000000000, n = 12; allowed: at most 1e"),
        ("local", "fclib_local/W/nz", np.array([-3]), r"nz = -3; allowed"),
        ("local", "fclib_local/W/nzmax", np.array([7]), "fclib_local/W/i: shape"),
        ("local", "fclib_local/W/i", np.full(144, 12), r"W/i holds 12 ... 12; allowed: 0 ... 11"),
        ("local", "fclib_local/W/p", np.arange(13)[::-1], "p must rise from 0"),
        ("local", "fclib_local/W/x", -np.ones(144), "not positive semidefinite"),
        ("local", "fclib_local/W/x", np.arange(144.0), "W is not symmetric"),
        ("global", "fclib_global/H", None, "fclib_global/H: missing"),
        ("global", "fclib_global/vectors/w", np.array([b"a"] * 12), r"vectors/w: shape \(12,\) of"),
        ("global", "fclib_global", None, "neither fclib_global nor fclib_local"),
    ],
)
def test_wrong_files_are_named(tmp_path, form, name, value, text):
    """File, dataset, what is there, what is allowed."""
    problem = random_problem(2, 4, bodies=3)
    dense = FrictionProblem(np.eye(12), np.random.default_rng(0).standard_normal((12, 12)), problem.q, problem.mu)
    (tmp_path / "p.hdf5").unlink(missing_ok=True)  # of the item before: no file is replaced
    write_fclib(tmp_path / "p.hdf5", dense, form=form)
    with h5py.File(tmp_path / "p.hdf5", "r+") as file:
        spoil(file, name, value)
    with pytest.raises(FrictionError, match=text) as caught:
        read_fclib(tmp_path / "p.hdf5")
    assert str(tmp_path / "p.hdf5") in str(caught.value)


def test_no_file_and_no_hdf5(tmp_path):
    """Both are said."""
    with pytest.raises(FrictionError, match="no such file"):
        read_fclib(tmp_path / "none.hdf5")
    (tmp_path / "text.hdf5").write_text("no")
    with pytest.raises(FrictionError, match="not an HDF5 file"):
        read_fclib(tmp_path / "text.hdf5")
