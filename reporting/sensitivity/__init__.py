"""Sensitivity of responses to variables: regression, first-order and total-order indices, rejects, influence."""

from reporting.sensitivity.summary import sensitivity

__all__ = ["sensitivity"]
