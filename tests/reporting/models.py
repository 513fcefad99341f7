"""Responses whose sensitivity is known exactly."""

import numpy as np

# Ishigami, a = 7, b = 0.1, three uniform variables on [-pi, pi] (Ishigami, Homma 1990).
ISHIGAMI_FIRST = np.array([0.3139051911, 0.4424111448, 0.0])
ISHIGAMI_TOTAL = np.array([0.5575888552, 0.4424111448, 0.2436836641])
WEIGHTS = np.array([3.0, 2.0, 1.0, 1.0, 0.5, 0.2, 0.0])
LINEAR_FIRST = WEIGHTS**2 / np.sum(WEIGHTS**2)


def ishigami(n, rng):
    """Return variables (n, 3) and response (n,)."""
    x = rng.uniform(-np.pi, np.pi, (n, 3))
    return x, ishigami_of(x)


def ishigami_of(x):
    """Return the response at points (n, 3)."""
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def linear(n, rng):
    """Return seven normal variables (n, 7) and a weighted sum of them (n,)."""
    x = rng.normal(size=(n, 7))
    return x, x @ WEIGHTS


def named(x):
    """Return the columns by name, J1, J2, ..."""
    return {f"J{i + 1}": column for i, column in enumerate(x.T)}
