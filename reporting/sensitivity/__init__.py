"""Which variable drives a response: regression, first-order and total-order indices, rejects, influence."""

from reporting.sensitivity.sensitivity import sensitivity

__all__ = ["sensitivity"]
