"""Coulomb friction with unilateral contact as a second-order cone complementarity problem (paper, section 2.1)."""

from engine.friction.problem import FrictionError, FrictionProblem, FrictionSolution, solve

__all__ = ["FrictionError", "FrictionProblem", "FrictionSolution", "solve"]
