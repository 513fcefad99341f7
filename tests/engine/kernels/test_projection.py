"""Removing penetration: what the small system of few contacts does not solve, the general solver does."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
# without compilation, so that the small system can be made to fail; prints its calls, and the run with and without it
PROGRAM = """
import json
from engine import load_mechanism, simulate
from engine.friction.arrays import NOT_CONVERGED
from engine.kernels import projection

calls = []

def run():
    found = simulate(load_mechanism("clearance_pendulum"), horizon=0.02, full_horizon=True)
    return found.status, found.certificate.max_penetration, found.measured

solved = run()
projection.solve_frictionless = lambda *_: calls.append(1) or NOT_CONVERGED
print(json.dumps([len(calls), solved, run(), len(calls)]))
"""


def test_the_general_solver_takes_over():
    """A pin falls onto its bore and slides: the same motion, within the same limit of penetration."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    none, (status, deepest, measured), (other_status, other_deepest, other), calls = json.loads(done.stdout)
    assert none == 0
    assert calls > 10
    assert status == other_status == "ok"
    assert max(deepest, other_deepest) <= 1e-11
    assert other == pytest.approx(measured, rel=1e-6)
