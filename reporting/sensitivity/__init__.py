"""Which variable drives a response: regression, first-order and total-order indices, rejects, influence."""
