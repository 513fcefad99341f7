"""Join the patches of several faces into one surface: common edges get the same control points, sharp gaps are found.

At an edge between two faces the closest point of a surface lies on both, and the two normals together tell on which
side of the surface a point is. If there is a gap between the faces, however small, the closest point lies on only one
of them, and its normal tells the side correctly only where the two normals are less than 90 degrees apart.
"""

from collections.abc import Sequence

import numpy as np

from engine.arrays import Array, Integers
from engine.mechanism.surfaces.bezier import basis, normals
from engine.mechanism.surfaces.edges import JOINED, MeetingEdges, extent

BORDER = np.array([[i in (0, 3) or j in (0, 3) for j in range(4)] for i in range(4)])
SAMPLES = np.linspace(0.0, 1.0, 33)  # parameters along an edge
ACROSS = 6  # number of closest samples, at least one of which lies on another edge
RIGHT_ANGLE = 1e-9  # two normals with a smaller cosine are more than 90 degrees apart


def joined_faces(faces: Sequence[Array]) -> tuple[Array, list[float]]:
    """Return the patches of faces, (n, 4, 4, 3) each, in one array, with common control points where borders meet.

    The second result is the largest displacement of a control point of each face [length].
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree  # 0.1 s to load

    patches = np.concatenate(faces)
    border = patches[:, BORDER].reshape(-1, 3)
    pairs = cKDTree(border).query_pairs(JOINED * extent(patches), output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(border),) * 2)
    count, group = connected_components(links, directed=False)
    members = np.bincount(group, minlength=count)
    means = np.stack([np.bincount(group, border[:, k], count) for k in range(3)], axis=1) / members[:, None]
    met = np.where(members[group, None] > 1, means[group], border)
    far = np.linalg.norm(met - border, axis=1).reshape(len(patches), -1).max(axis=1)
    patches[:, BORDER] = met.reshape(len(patches), -1, 3)
    ends = np.cumsum([len(face) for face in faces])[:-1]
    return patches, [float(each.max()) for each in np.split(far, ends)]


def sharp_gap(patches: Array, meeting: MeetingEdges) -> tuple[int, int] | None:
    """Return two patches that meet without a common edge, with normals more than 90 degrees apart; None if none do."""
    from scipy.spatial import cKDTree  # 0.1 s to load

    loose = np.argwhere(meeting.is_loose)
    if not len(loose):
        return None
    points = np.einsum("ai,nij->naj", basis(SAMPLES)[0], meeting.edges[meeting.is_loose]).reshape(-1, 3)
    own = _along_edges(patches, loose).reshape(-1, 3)
    edge = np.repeat(np.arange(len(loose)), len(SAMPLES))
    _, near = cKDTree(points).query(points, k=min(ACROSS, len(points)))
    other = edge[near] != edge[:, None]
    nearest = near[np.arange(len(points)), other.argmax(axis=1)]
    sharp = other.any(axis=1) & (np.sum(own * own[nearest], axis=1) < -RIGHT_ANGLE)
    if not sharp.any():
        return None
    first = int(sharp.argmax())
    return int(loose[edge[first], 0]), int(loose[edge[nearest[first]], 0])


def _along_edges(patches: Array, which: Integers) -> Array:
    """Return the normals along edges of patches, given as rows (patch, edge), at the samples: (n, samples, 3)."""
    found = normals(patches[which[:, 0]], SAMPLES)
    each = np.stack([found[:, :, 0], found[:, -1, :], found[:, ::-1, -1], found[:, 0, ::-1]], axis=1)
    return np.asarray(each[np.arange(len(which)), which[:, 1]])
