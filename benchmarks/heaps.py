"""The friction problem of one step of a heap of boxes or balls: its cost as the heap grows.

A pyramid of square layers stands on the ground; every body rests on up to four bodies below it. Boxes have four
contacts per pair, balls one, and balls of a layer touch. The problem is that of a step under weight, solved with a cold
start and from the impulses of a step whose free velocities differ by a hundredth.
"""

import subprocess
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from benchmarks import against_siconos
from engine.friction import FrictionProblem
from engine.friction.arrays import FrictionArrays, friction_arrays
from engine.friction.blocks import BODY, ROW
from engine.friction.elimination import eliminate_nodes
from engine.friction.solver import solve_friction
from tests.engine.friction.problems import natural_map_residual

BODIES = (10, 30, 100, 300, 1000)
SHAPES = ("boxes", "balls")
FRICTION = 0.5
TOLERANCE = 1e-8
CHANGE = 0.01  # relative change of the free velocities from one step to the next
MOST_SECONDS = 20.0  # a heap that takes longer is the last of its kind
MOST_DENSE = 1000  # contacts for which Siconos gets the Delassus matrix as a dense one


class Heap(NamedTuple):
    """Contacts between bodies; body -1 is the ground."""

    centre: np.ndarray  # (bodies, 3)
    mass: np.ndarray  # (bodies,)
    inertia: np.ndarray  # (bodies,) moment of inertia about any axis
    pair: np.ndarray  # (nc, 2) upper and lower body
    frame: np.ndarray  # (nc, 3, 3) rows N (towards the upper body), T1, T2
    arm: np.ndarray  # (nc, 2, 3) contact point from each body's centre


def measure() -> list[dict[str, Any]]:
    """Return a row for each shape and number of bodies, up to the first that takes too long."""
    rows = []
    for shape in SHAPES:
        for bodies in BODIES:
            rows.append(_row(shape, bodies))
            if rows[-1]["cold ms"] > 1e3 * MOST_SECONDS:
                break
    return rows


def build_heap(shape: str, bodies: int, seed: int = 0) -> Heap:
    """Build a heap of bodies of edge or diameter 1, layer by layer."""
    rng = np.random.default_rng(seed)
    boxes = shape == "boxes"
    spacing, rise = (1.1, 1.0) if boxes else (1.0, np.sqrt(0.5))
    side = 1
    # Layers have 1, 4, 9, ... places: the sum of the squares up to `side`.
    while side * (side + 1) * (2 * side + 1) // 6 < bodies:
        side += 1
    places = [(layer, i, j) for layer in range(side) for i in range(side - layer) for j in range(side - layer)][:bodies]
    number = {place: body for body, place in enumerate(places)}
    centre = np.array([[spacing * (i + 0.5 * k), spacing * (j + 0.5 * k), 0.5 + rise * k] for k, i, j in places])
    pair, point, normal = [], [], []
    for body, (layer, i, j) in enumerate(places):
        below = [number.get((layer - 1, i + a, j + b), -1) for a in (0, 1) for b in (0, 1)] if layer else [-1]
        for other in below:
            if boxes:
                # the corners of the square that both faces share
                low = centre[body] - 0.5 if other < 0 else np.maximum(centre[body], centre[other]) - 0.5
                high = centre[body] + 0.5 if other < 0 else np.minimum(centre[body], centre[other]) + 0.5
                corners = [(x, y, centre[body, 2] - 0.5) for x in (low[0], high[0]) for y in (low[1], high[1])]
            else:
                direction = np.array([0.0, 0, 1]) if other < 0 else centre[body] - centre[other]
                corners = [tuple(centre[body] - 0.5 * direction)]
            pair += [(body, other)] * len(corners)
            point += corners
            normal += [(0.0, 0.0, 1.0) if boxes else tuple(direction)] * len(corners)
        for other in () if boxes else (number.get((layer, i - 1, j)), number.get((layer, i, j - 1))):
            if other is not None:
                pair.append((body, other))
                point.append(tuple(0.5 * (centre[body] + centre[other])))
                normal.append(tuple(centre[body] - centre[other]))
    mass = rng.uniform(0.5, 2.0, bodies)
    pairs, points = np.array(pair), np.array(point)
    arm = points[:, None] - np.where(pairs[:, :, None] < 0, points[:, None], centre[pairs])
    # Inertia of a cube of edge 1 and of a ball of diameter 1.
    return Heap(centre, mass, mass / (6 if boxes else 10), pairs, np.array([_frame(np.array(n)) for n in normal]), arm)


def _frame(normal: np.ndarray) -> np.ndarray:
    """Return a right-handed frame whose first row is the normal."""
    tangent = np.cross(normal, (1.0, 0, 0) if abs(normal[0]) < 0.7 else (0.0, 1, 0))
    tangent /= np.linalg.norm(tangent)
    return np.array([normal, tangent, np.cross(normal, tangent)])


def heap_arrays(heap: Heap) -> tuple[FrictionArrays, np.ndarray]:
    """Return the solver's arrays without a load, and the position of each body in the order of elimination."""
    bodies, nc = heap.mass.size, len(heap.pair)
    neighbours = np.zeros((bodies, bodies), bool)
    a, b = heap.pair[heap.pair[:, 1] >= 0].T
    neighbours[a, b] = neighbours[b, a] = True
    system, number, piece = eliminate_nodes(neighbours)
    arrays = friction_arrays(system, nc)
    for i in range(nc):
        for s, (body, sign) in enumerate(zip(heap.pair[i], (1.0, -1.0), strict=True)):
            if body >= 0:
                arrays.rows.node[i, s] = number[body]
                arrays.rows.G[i, :, ROW * s : ROW * s + BODY] = sign * _rows(heap, i, s, body)
        first, second = arrays.rows.node[i]
        if second >= 0:
            arrays.rows.pair[i] = piece[first, second]
    arrays.mu[:] = FRICTION
    return arrays, number


def _rows(heap: Heap, i: int, s: int, body: int) -> np.ndarray:
    """Return the rows of contact i for one of its bodies, in the metric of the mass matrix."""
    turning = np.cross(heap.arm[i, s], heap.frame[i])
    return np.hstack([heap.frame[i] / np.sqrt(heap.mass[body]), turning / np.sqrt(heap.inertia[body])])


def free_velocities(heap: Heap, arrays: FrictionArrays, number: np.ndarray, seed: int) -> np.ndarray:
    """Return the relative velocities after a step of free fall, with a disturbance of a hundredth for seeds > 0."""
    disturbance = CHANGE * np.random.default_rng(seed).standard_normal((heap.mass.size, BODY)) * (seed > 0)
    disturbance[:, 2] -= 1.0
    w = np.zeros((arrays.w.size // ROW, ROW))
    w[number, :BODY] = disturbance * np.sqrt(np.vstack([*[heap.mass] * 3, *[heap.inertia] * 3])).T
    q = np.zeros((len(heap.pair), 3))
    for s in range(2):
        there = arrays.rows.node[:, s] >= 0
        G = arrays.rows.G[there][:, :, ROW * s : ROW * (s + 1)]
        q[there] += np.einsum("ijk,ik->ij", G, w[arrays.rows.node[there, s]])
    return q


def _row(shape: str, bodies: int) -> dict[str, Any]:
    heap = build_heap(shape, bodies)
    start = perf_counter()
    arrays, number = heap_arrays(heap)
    built = perf_counter() - start
    nc = len(heap.pair)
    arrays.q[:] = free_velocities(heap, arrays, number, 0)
    cold, steps, residual = time_heap(nc, arrays, np.zeros((nc, 3)))
    impulses = arrays.r.copy()
    arrays.q[:] = free_velocities(heap, arrays, number, 1)
    warm, warm_steps, warm_residual = time_heap(nc, arrays, impulses)
    row = {
        "heap": shape,
        "bodies": bodies,
        "contacts": nc,
        "blocks": bodies + arrays.system.pair.size,
        "build ms": 1e3 * built,
        "cold ms": 1e3 * cold,
        "steps": steps,
        "us a step, contact": 1e6 * cold / max(steps, 1) / nc,
        "residual": residual,
        "warm ms": 1e3 * warm,
        "warm steps": warm_steps,
        "warm residual": warm_residual,
    }
    return row | {f"{name} ms": ms for name, ms in _siconos(heap, nc).items()}


def time_heap(
    nc: int, arrays: FrictionArrays, start: np.ndarray, clock: Callable[[], float] = perf_counter
) -> tuple[float, int, float]:
    """Return the time of a solution [s], its steps and its residual; the fastest of three if it is short."""
    best, steps, residual = np.inf, 0, np.inf
    for _ in range(3):
        arrays.r[:] = start
        begin = clock()
        _, steps, residual = solve_friction(nc, arrays, TOLERANCE)
        best = min(best, clock() - begin)
        if best > 1.0:
            break
    return best, steps, residual


def _siconos(heap: Heap, nc: int) -> dict[str, Any]:
    """Return the time of each of Siconos' solvers [ms], or why there is none."""
    if subprocess.run([against_siconos.PYTHON, "-c", "import siconos.numerics"], capture_output=True).returncode:
        return {}
    if nc > MOST_DENSE:
        return dict.fromkeys(against_siconos.SOLVERS, "too large")
    problem = dense_problem(heap)
    found = against_siconos.solve_with_siconos([problem])
    times: dict[str, Any] = {}
    for name in against_siconos.SOLVERS:
        solved = natural_map_residual(problem, found[f"{name}_r0"]) <= against_siconos.SOLVED
        times[name] = 1e-3 * float(found[f"{name}_us0"]) if solved else "unsolved"
    return times


def dense_problem(heap: Heap) -> FrictionProblem:
    """Return the problem of a step of free fall as dense matrices."""
    bodies, nc = heap.mass.size, len(heap.pair)
    M = np.diag(np.column_stack([*[heap.mass] * 3, *[heap.inertia] * 3]).ravel())
    H, fall = np.zeros((3 * nc, BODY * bodies)), np.zeros(BODY * bodies)
    fall[2::BODY] = -1.0
    for i in range(nc):
        for s, (body, sign) in enumerate(zip(heap.pair[i], (1.0, -1.0), strict=True)):
            if body >= 0:
                rows = np.hstack([heap.frame[i], np.cross(heap.arm[i, s], heap.frame[i])])
                H[3 * i : 3 * i + 3, BODY * body : BODY * (body + 1)] = sign * rows
    return FrictionProblem(M, H, H @ fall, np.full(nc, FRICTION))
