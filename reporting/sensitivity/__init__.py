"""Which variable drives a response: regression, first-order and total-order indices, rejects, influence."""

from reporting.sensitivity.summary import sensitivity

__all__ = ["sensitivity"]
