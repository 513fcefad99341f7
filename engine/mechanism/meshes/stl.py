"""Read an STL file, binary or ASCII, as closed surfaces: what is not one is refused, and nothing is trusted."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine.arrays import Array, Integers
from engine.mechanism.base import LARGEST_NUMBER
from engine.platform.regular_file import read_regular_file

MOST_TRIANGLES = 20_000
LARGEST = 100 * MOST_TRIANGLES * 4  # bytes; a triangle has 50 in a binary file, up to 400 as text
HEADER, RECORD = 84, 50  # bytes of a binary file: before the triangles, of each triangle
SAME = 3e-7  # share of the size: corners no farther apart are one; numbers of an STL file are that exact

_REPAIR = "export it again as a closed solid, or repair it in the program that made it"


class UnfitMesh(ValueError):
    """The file is no mesh that can be used; the message says why."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Closed surfaces of triangles with normals out of the solid."""

    corners: Array  # (nv, 3)
    triangles: Integers  # (nt, 3)
    shell: Integers  # (nt,) number of the closed surface of each triangle

    @property
    def points(self) -> Array:
        """The corners of each triangle, (nt, 3, 3)."""
        return np.asarray(self.corners[self.triangles])

    @property
    def size(self) -> float:
        """The longest side of the box around it."""
        return float(np.ptp(self.corners, axis=0).max())


def read_stl(path: Path) -> TriangleMesh:
    """Return the closed surfaces of an STL file in its own unit; raise UnfitMesh, or OSError if it cannot be read."""
    return closed_mesh(triangles_of(read_regular_file(path, LARGEST)))


def triangles_of(content: bytes) -> Array:
    """Return the triangles of an STL file, (n, 3, 3); raise UnfitMesh if it is not one."""
    count = int.from_bytes(content[80:HEADER], "little") if len(content) >= HEADER else -1
    if len(content) == HEADER + RECORD * count:
        _check_count(count)
        layout = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("attribute", "<u2")])
        points = np.frombuffer(content, layout, count, HEADER)["points"].astype(float)
    elif content[:512].lstrip().lower().startswith(b"solid"):
        points = _from_text(content)
    else:
        expected = f", and not {HEADER + RECORD * count} as its number of triangles says" if count >= 0 else ""
        text = f"is no STL file: it begins neither with solid nor with a header, or it has {len(content)} bytes"
        raise UnfitMesh(f"{text}{expected}; allowed: a whole STL file, binary or ASCII; export it again")
    if not np.all(np.abs(points) <= LARGEST_NUMBER):  # false for NaN as well
        raise UnfitMesh(
            f"has a coordinate that is no length; allowed: finite numbers up to {LARGEST_NUMBER:g}; mend it"
        )
    return points


def _from_text(content: bytes) -> Array:
    words = content.split()
    rows = [words[i + 1 : i + 4] for i, word in enumerate(words) if word.lower() == b"vertex"]
    _check_count(len(rows) // 3)
    try:
        numbers = np.array([[float(word) for word in row] for row in rows], float).reshape(-1, 3, 3)
    except ValueError:
        raise UnfitMesh(
            "has a vertex that is not three numbers; allowed: vertex X Y Z, thrice a facet; mend it"
        ) from None
    return numbers


def _check_count(count: int) -> None:
    if not 4 <= count <= MOST_TRIANGLES:
        text = f"has {count} triangles; allowed: 4 to {MOST_TRIANGLES}; "
        raise UnfitMesh(text + ("export it with a coarser tolerance" if count > 4 else "export a solid"))


def closed_mesh(points: Array) -> TriangleMesh:
    """Return the closed surfaces that triangles, (n, 3, 3), make up; raise UnfitMesh if they do not."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree  # 0.1 s to load

    flat = points.reshape(-1, 3)
    size = float(np.ptp(flat, axis=0).max())
    if not size > 0.0:
        raise UnfitMesh("is a single point; allowed: a solid; export it again")
    close = cKDTree(flat).query_pairs(SAME * max(size, float(np.abs(flat).max())), output_type="ndarray")
    links = coo_matrix((np.ones(len(close)), (close[:, 0], close[:, 1])), shape=(len(flat),) * 2)
    count, number = connected_components(links, directed=False)
    corners = np.zeros((count, 3))
    corners[number[::-1]] = flat[::-1]  # of those that are one, the first
    triangles = number.reshape(-1, 3)
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    ways, times = np.unique(edges[:, 0] * count + edges[:, 1], return_counts=True)
    back, times_back = np.unique(edges[:, 1] * count + edges[:, 0], return_counts=True)
    if len(ways) != len(back) or (ways != back).any() or (times != times_back).any():
        alone = len(np.setdiff1d(ways, back))
        text = f"is not closed: {alone} edges have a triangle on one side only, or neighbours with opposite normals"
        raise UnfitMesh(f"{text}; allowed: closed surfaces with normals outwards; {_REPAIR}")
    neighbours = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count,) * 2)
    _, of_corner = connected_components(neighbours, directed=False)
    _, shell = np.unique(of_corner[triangles[:, 0]], return_inverse=True)
    mesh = TriangleMesh(corners, triangles, shell.reshape(-1).astype(np.int64))
    for which in range(int(shell.max(initial=-1)) + 1):
        if signed_volumes(mesh.points[shell == which]).sum() <= 0.0:
            text = f"has a closed surface, number {which}, whose normals point inwards, as that of a cavity"
            raise UnfitMesh(f"{text}; allowed: normals outwards; turn them, or remove the cavity: nothing touches it")
    return mesh


def signed_volumes(points: Array) -> Array:
    """Return the volumes between triangles, (n, 3, 3), and the origin, positive if their normals point away from it."""
    return np.asarray(np.einsum("ij,ij->i", points[:, 0], np.cross(points[:, 1], points[:, 2])) / 6.0)
