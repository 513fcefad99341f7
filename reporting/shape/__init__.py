"""The shape of a response: normality, fitted distributions, tails, order statistics."""
