"""`python -m benchmarks peers` without the other programs: a made-up Python stands in for theirs."""

import numpy as np
import pytest

from benchmarks import heaps, peers
from tests.engine.friction.problems import natural_map_residual


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Return a function that writes the Python of the other programs, as a shell script."""

    def write(script):
        python = tmp_path / peers.PYTHON
        python.parent.mkdir()
        python.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        python.chmod(0o755)

    monkeypatch.setattr(peers, "FOLDER", tmp_path)
    peers.missing.cache_clear()
    yield write
    peers.missing.cache_clear()


def test_without_an_index_rows_say_so_and_the_rest_is_measured(stand_in, monkeypatch):
    stand_in("echo 'ERROR: No matching distribution found' >&2; exit 1")
    monkeypatch.setattr(peers, "BALLS", (10,))
    monkeypatch.setitem(peers.MOTIONS, "double_pendulum", (0.1, 2, (2e-2, 1e-2), ("upper", "lower")))
    own, *others = peers.heap_rows()
    assert own["ms"] > 0
    assert own["residual"] < heaps.TOLERANCE
    points = peers.motion_rows("double_pendulum")
    coarse, fine, *more = points
    assert coarse["error"] > fine["error"] > 0
    assert {row["program"] for row in peers.at_equal_error(points[:2] * 2)} == {"clearcap"}
    for why in [row["ms"] for row in others] + [row["step ms"] for row in more]:
        assert why.startswith("not measured: pip cannot install")
        assert "==" in why
        assert "No matching distribution found" in why
    assert len(others) == 2
    assert len(more) == 4


def test_a_program_that_fails_has_a_row_too(stand_in):
    stand_in("case \"$*\" in *pip*) exit 0;; esac; echo 'ImportError: libGL.so.1' >&2; exit 1")
    with pytest.raises(peers.NotMeasured, match=r"peer_rows\.py failed: ImportError: libGL"):
        peers.ask("dask", "peer_rows.py", "dask", "10")


def test_the_answer_is_the_last_line(stand_in):
    stand_in("echo; echo '*** hello'; echo '{\"s\": 1.5}'")
    assert peers.ask("dask", "peer_rows.py", "dask", "10") == {"s": 1.5}


def test_forces_of_another_program_become_impulses_of_the_heap():
    """Forces on either body of a contact, in any order; clearcap's own are a solution again."""
    heap = heaps.build_heap("balls", 10)
    arrays, number = heaps.heap_arrays(heap)
    arrays.q[:] = heaps.free_velocities(heap, arrays, number, 0)
    heaps.time_heap(len(heap.pair), arrays, np.zeros_like(arrays.r))
    forces = []
    for i, (upper, lower) in enumerate(heap.pair.tolist()):
        force = 9.81 * heap.frame[i].T @ arrays.r[i]  # on the upper body
        forces.append([lower, upper, *force] if i % 2 else [upper, lower, *-force])
    impulses = peers.impulses_of(heap, forces[::-1])
    np.testing.assert_allclose(impulses, arrays.r.ravel(), rtol=0, atol=1e-12)
    assert natural_map_residual(heaps.dense_problem(heap), impulses) < 1e-7


def test_time_at_equal_error_is_read_from_a_line_or_a_limit():
    def points(program, factor, order):
        steps = (8, 4, 2, 1)
        return [{"motion": "m", "program": program, "error": factor * h**order, "ms": 8 / h} for h in steps]

    table = peers.at_equal_error(points("clearcap", 1.0, 2) + points("quick", 0.25, 2) + points("rough", 100.0, 1))
    assert [row["to clearcap"] for row in table] == ["1", "0.5", "> 1"]


def test_a_worker_computes_rows_that_take_no_time():
    assert peers.own_row_us(40, 20) > 0
