from typing import NamedTuple

import numpy as np

from engine.kernels.jit import kernel


class Ties(NamedTuple):
    at: np.ndarray
    start: np.ndarray
    width: np.ndarray
    J: np.ndarray


@kernel
def tie_down(n, ties):
    pass


@kernel
def hold_ties(n, ties, c, w):
    pass
