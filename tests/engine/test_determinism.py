"""The same bits again: in one process, in fresh ones; and the same numbers without a compiler."""

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from engine import load_mechanism, simulate
from tests.engine.linkages import linkage
from tests.engine.small import made

pytestmark = pytest.mark.bits

ROOT = Path(__file__).parents[2]
SAMPLES = [
    {},
    {"J1": 0.05, "J2": 0.09, "J3": 0.06, "J4": 0.1, "J5": 0.04, "J6": 0.08, "J7": 0.03},
    {"J1": 0.1, "J2": 0.02, "J3": 0.12, "J4": 0.05, "J5": 0.07, "J6": 0.03, "J7": 0.11},
    {"J1": 0.06734710929419425, "J2": 0.09742820575062158, "J3": 0.05399634681305045, "J4": 0.05773837098310848}
    | {"J5": 0.08981230675302541, "J6": 0.07077378646465134, "J7": 0.04323462845038087},  # BLAS threads would show
]


def digest() -> str:
    """Hash responses and certificates, bit for bit: of the C-60, and of chains with ideal joints and play."""
    runs = [simulate(load_mechanism("c60"), sample) for sample in SAMPLES]
    runs += [simulate(made(linkage(seed)), full_horizon=True) for seed in (5, 14)]
    words = []
    for run in runs:
        words += [run.status, str(run.certificate.steps), run.certificate.max_residual.hex()]
        words += [value.hex() for value in run.responses.values()]
    return hashlib.sha256(" ".join(words).encode()).hexdigest()


def fresh(code: str, **environment: str) -> str:
    """Run Python in a process of its own and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.processes
def test_same_bits_again_and_in_other_processes():
    """The C-60 and linkages, twice here and in two fresh processes, whatever threads their linear algebra may use."""
    here = digest()
    assert digest() == here
    code = "from tests.engine.test_determinism import digest; print(digest())"
    one, two = fresh(code, OPENBLAS_NUM_THREADS="1"), fresh(code, OPENBLAS_NUM_THREADS="2", PYTHONHASHSEED="7")
    assert [one, two] == [here, here]


@pytest.mark.processes
@pytest.mark.parametrize(("name", "horizon"), [("incline", 0.02), ("clearance_pendulum", 0.01)])
def test_without_the_compiler_the_numbers_are_the_same(name, horizon):
    """NUMBA_DISABLE_JIT=1: plain Python takes as many steps and ends at the same numbers to 1e-12."""
    code = (
        "import json; from engine import load_mechanism, simulate;"
        f"run = simulate(load_mechanism({name!r}), horizon={horizon}, full_horizon=True);"
        "print(json.dumps([run.status, run.certificate.steps, run.responses]))"
    )
    status, steps, plain = json.loads(fresh(code, NUMBA_DISABLE_JIT="1"))
    run = simulate(load_mechanism(name), horizon=horizon, full_horizon=True)
    assert (status, steps) == (run.status, run.certificate.steps)
    np.testing.assert_allclose(list(plain.values()), list(run.responses.values()), rtol=0, atol=1e-12)


@pytest.mark.processes
def test_importing_the_engine_is_light():
    """No compiler, no tables, no plots, no cluster for a process that only reads descriptions."""
    code = (
        "import sys, engine; engine.load_mechanism('c60').digest();"
        "print(*sorted({'numba', 'dask', 'distributed', 'pandas', 'matplotlib', 'pyarrow'} & set(sys.modules)))"
    )
    assert fresh(code) == ""


def test_one_decorator_compiles_everything():
    """Options of the compiler stand in one place, and fast-math, which depends on the machine, nowhere."""
    for path in sorted((ROOT / "engine").rglob("*.py")):
        text = path.read_text("utf-8")
        assert "fastmath" not in text, path
        assert "parallel=True" not in text, path
        if path.name != "decorators.py":
            assert not re.search(r"\bnjit\b|@\w*\.?jit\b|\bvectorize\b", text), path
