"""Measurements of speed: `python -m benchmarks` takes about ten minutes on two cores.

Times depend on the machine, so each table also gives them as multiples of a reference measured in the same run: the
solution of a dense 42 x 42 system by LAPACK (the C-60 has 42 degrees of freedom).
"""

import os
from pathlib import Path

for _library in ("OMP", "OPENBLAS", "MKL"):  # before NumPy is imported: one thread each, as in the workers
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

ROOT = Path(__file__).parents[1]
