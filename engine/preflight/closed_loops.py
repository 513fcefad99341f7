"""Closed loops of ideal joints that hold a motion twice, and which joints could let it go.

A planar linkage of pins, for instance, is kept in its plane by each of its joints. It moves as it should, but how its
joints share forces across the plane is open, and its axes have to fit.
"""

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from engine.arrays import Array
from engine.assembly import Assembly
from engine.friction.arrays import dense_rows
from engine.kernels.bilateral import REDUNDANT, row_violations, whitened_bilateral_rows
from engine.mechanism import Mechanism
from engine.platform.linear_algebra import one_thread
from engine.preflight.plausibility import Caution

SHARED = 1e-6  # share of a joint in what is held twice; anything smaller is a rounding error of zero
MOST_ROWS, MOST_JOINTS = 1000, 12  # that are examined; joints of one loop that are tried as others
# type of joint, the type that it could be, and the last parts of the names of its rows that this lets go
RELAXED: dict[str, dict[str, tuple[str, ...]]] = {
    "revolute": {"cylindrical": ("slide1",), "spherical": ("turn1", "turn2")},
    "prismatic": {"cylindrical": ("turn3",)},
}


def closed_loop_cautions(mechanism: Mechanism, assembly: Assembly) -> Iterator[Caution]:
    """Yield a caution for each group of ideal joints that hold motions more than once at the start pose."""
    names = [name for name, law in zip(assembly.row_names, assembly.model.bilateral.law, strict=True) if law < 0]
    if not assembly.model.bilateral.closed[0] or len(names) > MOST_ROWS:
        return
    with one_thread():
        J = _rows(assembly)[assembly.model.bilateral.law < 0]
        for joints in _groups(J, [name.rpartition(".")[0] for name in names]):
            inside = [i for i, name in enumerate(names) if name.rpartition(".")[0] in joints]
            rows, of = J[inside], [names[i] for i in inside]
            twice = len(rows) - _rank(rows)
            motions = "a motion" if twice == 1 else f"{twice} motions"
            yield Caution(
                f"joints.{joints[0]}",
                None,
                "1",
                f"the loop {'-'.join(joints)} holds {motions} twice: it moves freely only because its joints fit"
                " each other, and how they share forces is open",
                "",
                _remedy(mechanism, joints, rows, of, twice),
            )


def _rows(assembly: Assembly) -> Array:
    """Return the rows of joints and motions at the start, of length one in the metric of bodies of mass 1."""
    model, state, at_pose, system = assembly.model, assembly.state, assembly.work.bilateral, assembly.problem.bilateral
    row_violations(
        model.bilateral, state.x, state.R, at_pose.target[1], at_pose.violation, at_pose.point, at_pose.direction
    )
    whitened_bilateral_rows(model.metric, model.bilateral, state.x, state.R, at_pose.point, at_pose.direction, system.J)
    rows = dense_rows(system.node, system.J[:, None], assembly.problem.w.size)[:, 0]
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0.0))


def _rank(rows: Array) -> int:
    """Return how many rows are independent."""
    return int(np.count_nonzero(np.linalg.svd(rows, compute_uv=False) > REDUNDANT)) if len(rows) else 0


def _groups(J: Array, joints: list[str]) -> list[list[str]]:
    """Return groups of joints whose rows depend on each other, in the file's order; ``joints`` has that of each row."""
    ways, sizes, _ = np.linalg.svd(J)
    open_ways = ways[:, np.count_nonzero(sizes > REDUNDANT) :]
    shared = np.abs(open_ways @ open_ways.T)
    order = list(dict.fromkeys(joints))
    member = np.array([[joint == name for joint in joints] for name in order])
    linked = member @ (shared > SHARED) @ member.T
    groups: list[list[str]] = []
    left = [i for i in range(len(order)) if linked[i, i]]
    while left:
        group = {left[0]}
        while grown := {j for i in group for j in np.flatnonzero(linked[i]).tolist()} - group:
            group |= grown
        groups.append([order[i] for i in sorted(group)])
        left = [i for i in left if i not in group]
    return groups


def _remedy(mechanism: Mechanism, joints: list[str], rows: Array, names: list[str], twice: int) -> str:
    """Return which one or two joints of a loop could be of another type, so that it holds nothing twice."""
    options = [
        [(joint, kind, tuple(f"{joint}.{row}" for row in parts)) for kind, parts in RELAXED.get(now, {}).items()]
        for joint, now in ((joint, str(mechanism.joints[joint].type)) for joint in joints[:MOST_JOINTS])
    ]
    for count in (1, 2):
        for chosen in combinations(options, count):
            for changes in product(*chosen):
                gone = {row for *_, parts in changes for row in parts}
                kept = [i for i, name in enumerate(names) if name not in gone]
                # exactly what is held twice goes, and nothing else begins to move
                if len(gone) == twice and _rank(rows[kept]) == len(kept):
                    return "to change that, make " + " and ".join(f"{joint} {kind}" for joint, kind, _ in changes)
    return "to change that, give one of its joints play, or fewer constraints"
