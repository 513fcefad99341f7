"""Friction problems in FCLIB's HDF5 files, the exchange format of the field.

Layout, as written by fclib.h: a group ``fclib_global`` (M v = H r + G l + f, G' v + b = 0, u = H' v + w) or
``fclib_local`` (u = W r + V l + q, V' r + R l + s = 0) with ``spacedim``, its matrices as groups, ``vectors`` and
``info``, and next to it ``solution`` (v, u, r, l). A matrix is ``m, n, nzmax, nz, p, i, x``; ``nz`` is -1 for
compressed columns, -2 for compressed rows, otherwise the number of triplets (p rows, i columns). Components are (N, T1,
T2).
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from engine.arrays import Array
from engine.friction.problem import FrictionError, FrictionProblem, FrictionSolution, refuse_asymmetry

MOST_ENTRIES = 10**8  # largest number of entries of a dense matrix (0.8 GB), because sizes in a file are not trusted
ROUNDING = 1e-9  # largest asymmetry of a matrix, relative to its largest entry


def read_fclib(path: str | Path) -> FrictionProblem:
    """Read a local or global problem and eliminate its equality constraints.

    The free motion M^-1 f of a global problem becomes part of q; a local problem becomes W = H H' with M the identity.
    Raises FrictionError, which names file and dataset: not HDF5, a dataset missing or of the wrong size,
    two-dimensional contacts, matrices that are not symmetric positive (semi)definite, or constraints that do not
    determine their multipliers.
    """
    with _open(path) as file:
        for name, read in (("fclib_global", _read_global), ("fclib_local", _read_local)):
            if name in file:
                group = _Group(file[name], f"{path}: {name}")
                if (dimension := group.integer("spacedim")) != 3:
                    raise FrictionError(f"{group.where}/spacedim = {dimension}; only 3 is supported")
                return read(group)
    raise FrictionError(f"{path}: holds neither fclib_global nor fclib_local")


def read_fclib_impulses(path: str | Path) -> Array | None:
    """Return the impulses r of the file's ``solution``, shape (3 nc,); None if it has none."""
    with _open(path) as file:
        return _Group(file["solution"], f"{path}: solution").vector("r") if "solution/r" in file else None


def write_fclib(
    path: str | Path,
    problem: FrictionProblem,
    solution: FrictionSolution | None = None,
    form: Literal["global", "local"] = "global",
    title: str = "",
) -> None:
    """Write a problem and, if given, its solution to a new file; form "local" stores W = H M^-1 H' for M and H."""
    import h5py

    n = problem.M.shape[0]
    with h5py.File(path, "x") as file:
        group = file.create_group(f"fclib_{form}")
        group["spacedim"] = np.array([3], np.int32)
        if form == "global":
            _write_matrix(group, "M", problem.M)
            _write_matrix(group, "H", problem.H.T)
            vectors = {"f": np.zeros(n), "w": problem.q, "mu": problem.mu}
        else:
            _write_matrix(group, "W", problem.H @ np.linalg.solve(problem.M, problem.H.T))
            vectors = {"q": problem.q, "mu": problem.mu}
        for name, values in vectors.items():
            group[f"vectors/{name}"] = values
        if title:
            group["info/title"] = np.bytes_(title.encode())
        if solution is not None:
            given = {"u": solution.u, "r": solution.r} | ({"v": solution.v} if form == "global" else {})
            for name, values in given.items():
                file[f"solution/{name}"] = values


def _open(path: str | Path) -> Any:
    import h5py

    try:
        return h5py.File(path, "r")
    except FileNotFoundError:
        raise FrictionError(f"{path}: no such file") from None
    except OSError as error:
        raise FrictionError(f"{path}: not an HDF5 file ({error})") from None


class _Group:
    """A group of the file; its datasets are checked before they are read."""

    def __init__(self, group: Any, where: str) -> None:
        self.group, self.where = group, where

    def __contains__(self, name: str) -> bool:
        return name in self.group

    def vector(self, name: str, size: int | None = None, kinds: str = "fiu") -> Any:
        """Return a one-dimensional dataset after checking its shape and type before anything is read."""
        data = self.group.get(name)
        if data is None or not hasattr(data, "shape"):
            raise FrictionError(f"{self.where}/{name}: missing")
        if data.dtype.kind not in kinds or len(data.shape) != 1 or (size is not None and data.shape[0] != size):
            expected = f"a vector of {size if size is not None else 'some'} numbers"
            raise FrictionError(f"{self.where}/{name}: shape {data.shape} of {data.dtype}, expected {expected}")
        return np.asarray(data[()], float if "f" in kinds else np.int64)

    def integer(self, name: str) -> int:
        """Return an integer, stored as a vector with one entry in these files."""
        return int(self.vector(name, 1, "iu")[0])

    def matrix(self, name: str) -> Array:
        """Return a sparse matrix as a dense one."""
        from scipy.sparse import coo_array, csc_array, csr_array

        if name not in self:
            raise FrictionError(f"{self.where}/{name}: missing")
        part = _Group(self.group[name], f"{self.where}/{name}")
        m, n, nz = part.integer("m"), part.integer("n"), part.integer("nz")
        if nz < -2:
            raise FrictionError(f"{part.where}/nz = {nz}; allowed: >= 0 (triplets), -1 (columns), -2 (rows)")
        if m < 0 or n < 0 or m * n > MOST_ENTRIES:
            raise FrictionError(f"{part.where}: m = {m}, n = {n}; allowed: at most {MOST_ENTRIES:g} entries")
        entries = nz if nz >= 0 else part.integer("nzmax")
        p = part.vector("p", {-1: n + 1, -2: m + 1}.get(nz, entries), "iu")
        i, x = part.vector("i", entries, "iu"), part.vector("x", entries)
        bound = {-1: m, -2: n}.get(nz, n)
        if i.size and (i.min() < 0 or i.max() >= bound):
            raise FrictionError(f"{part.where}/i holds {i.min()} ... {i.max()}; allowed: 0 ... {bound - 1}")
        if nz >= 0:
            if p.size and (p.min() < 0 or p.max() >= m):
                raise FrictionError(f"{part.where}/p holds {p.min()} ... {p.max()}; allowed: 0 ... {m - 1}")
            return np.asarray(coo_array((x, (p, i)), shape=(m, n)).toarray())
        if p[0] != 0 or p[-1] > entries or (np.diff(p) < 0).any():
            raise FrictionError(f"{part.where}/p must rise from 0 to at most nzmax = {entries}")
        kind = csc_array if nz == -1 else csr_array
        return np.asarray(kind((x[: p[-1]], i[: p[-1]], p), shape=(m, n)).toarray())


def _read_global(group: _Group) -> FrictionProblem:
    M, H = group.matrix("M"), group.matrix("H")
    n, rows = H.shape
    _judge_symmetric(M, n, f"{group.where}/M")
    vectors = _Group(group.group.get("vectors", {}), f"{group.where}/vectors")
    f, w, mu = vectors.vector("f", n), vectors.vector("w", rows), vectors.vector("mu", rows // 3)
    given = np.zeros(n)
    if "G" in group:  # v = given + Z y satisfies the constraints for any y
        G = group.matrix("G")
        b = vectors.vector("b", G.shape[1])
        if G.shape[0] != n:
            raise FrictionError(f"{group.where}/G has {G.shape[0]} rows; M has {n}")
        given = -np.linalg.lstsq(G.T, b, rcond=None)[0]
        if not np.allclose(G.T @ given, -b, atol=ROUNDING * np.abs(b).max(initial=0)):
            raise FrictionError(f"{group.where}/G and b: no velocity satisfies G' v + b = 0")
        left, size, _ = np.linalg.svd(G)
        Z = left[:, np.sum(size > ROUNDING * size.max(initial=0)) :]
        M, H, f, w, given = Z.T @ M @ Z, Z.T @ H, Z.T @ (f - M @ given), w + H.T @ given, np.zeros(Z.shape[1])
    try:
        free = given + np.linalg.solve(M, f)
    except np.linalg.LinAlgError:
        raise FrictionError(f"{group.where}/M is singular") from None
    return FrictionProblem(M, H.T, w + H.T @ free, mu)


def _read_local(group: _Group) -> FrictionProblem:
    W = group.matrix("W")
    vectors = _Group(group.group.get("vectors", {}), f"{group.where}/vectors")
    q, mu = vectors.vector("q", W.shape[0]), vectors.vector("mu", W.shape[0] // 3)
    if "V" in group or "R" in group:
        V, R = group.matrix("V"), group.matrix("R")
        s = vectors.vector("s", R.shape[0])
        if R.shape != (V.shape[1], V.shape[1]) or V.shape[0] != W.shape[0]:
            raise FrictionError(f"{group.where}: V has shape {V.shape} and R {R.shape} beside W {W.shape}")
        if np.linalg.matrix_rank(R) < len(R):
            raise FrictionError(f"{group.where}/R is singular: the constraints determine no multiplier")
        W, q = W - V @ np.linalg.solve(R, V.T), q - V @ np.linalg.solve(R, s)
    _judge_symmetric(W, W.shape[0], f"{group.where}/W")
    size, axes = np.linalg.eigh((W + W.T) / 2)
    largest = float(size.max(initial=0))
    if (size < -ROUNDING * largest).any() or (W.size and largest <= 0):
        raise FrictionError(
            f"{group.where}/W is not positive semidefinite: eigenvalues {size.min():.3g} ... {largest:.3g}"
        )
    kept = size > len(size) * np.finfo(float).eps * largest
    return FrictionProblem(np.eye(int(kept.sum())), axes[:, kept] * np.sqrt(size[kept]), q, mu)


def _judge_symmetric(A: Array, n: int, where: str) -> None:
    if A.shape != (n, n):
        raise FrictionError(f"{where} has shape {A.shape}, expected ({n}, {n})")
    refuse_asymmetry(A, where)


def _write_matrix(group: Any, name: str, dense: Array) -> None:
    from scipy.sparse import csc_array

    matrix = csc_array(dense)
    part = group.create_group(name)
    for key, value in {"nzmax": matrix.nnz, "m": dense.shape[0], "n": dense.shape[1], "nz": -1}.items():
        part[key] = np.array([value], np.int32)
    part["p"], part["i"], part["x"] = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data
