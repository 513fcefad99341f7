"""Coulomb friction with unilateral contact as a second-order cone complementarity problem (paper, section 2.1)."""

from engine.friction.fclib import read_fclib, read_fclib_impulses, write_fclib
from engine.friction.problem import FrictionError, FrictionProblem, FrictionSolution, solve

__all__ = [
    "FrictionError",
    "FrictionProblem",
    "FrictionSolution",
    "read_fclib",
    "read_fclib_impulses",
    "solve",
    "write_fclib",
]
