"""Linear algebra whose outcome does not depend on the machine: neither on the number of its cores nor on rounding."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from engine.arrays import Array

# Steps a column after which a search counts as endless. SciPy's own limit is 3. The longest search of 10,000 friction
# problems takes between 2.4 and 3.5, depending on how its rows are rounded.
STEPS = 30


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which linear algebra gives the same bits whatever the number of cores, and so of threads."""
    limited: AbstractContextManager[Any] = _threads().limit(limits=1, user_api="blas")
    return limited


@cache
def _threads() -> ThreadpoolController:
    """Return the controller of the threads of NumPy's linear algebra; it is created once per process."""
    return ThreadpoolController()


def nonnegative_least_squares(matrix: Array, target: Array) -> Array:
    """Return the x >= 0 that minimises |matrix x - target|; raise RuntimeError if the search does not end."""
    from scipy.optimize import nnls  # takes 0.4 s to import

    solution, _ = nnls(matrix, target, maxiter=STEPS * matrix.shape[1])
    return np.asarray(solution)
