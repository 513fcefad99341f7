"""Samplers that enumerate: all corners of the variables' ranges, all combinations of levels, the rows of a table.

Corners: paper, eqs. 24 and 25.
"""

from collections.abc import Mapping
from math import prod

import numpy as np

from campaign.inputs.distributions import Array, Constant, Distribution

Levels = Mapping[str, int | tuple[float, ...]]


def corners(variables: Mapping[str, Distribution], first: int, count: int) -> dict[str, Array]:
    """Return corners ``first .. first + count - 1`` of the box that the variables' ranges span, each of shape (count,).

    Bit j of the number says at which end variable j is; the one after the last corner is the middle of the box.
    """
    number, drawn = np.arange(first, first + count), {}
    for j, (name, variable) in enumerate(variables.items()):
        low, high = variable.support()
        ends = np.where(number >> j & 1, high, low)
        drawn[name] = np.where(number == 2 ** len(variables), 0.5 * (low + high), ends)
    return drawn


def grid(variables: Mapping[str, Distribution], levels: Levels, first: int, count: int) -> dict[str, Array]:
    """Return points ``first .. first + count - 1`` of a grid, each (count,); the first variable turns fastest."""
    number, drawn = np.arange(first, first + count), {}
    for name, variable in variables.items():
        values = np.array(levels_of(variable, levels.get(name, 1)))
        number, at = np.divmod(number, values.size)
        drawn[name] = values[at]
    return drawn


def levels_of(variable: Distribution, levels: int | tuple[float, ...]) -> tuple[float, ...]:
    """Return the levels of a variable: as given, or so many evenly from its lower to its upper end."""
    if isinstance(levels, tuple):
        return levels
    if isinstance(variable, Constant):
        return (variable.value,)
    return tuple(np.linspace(*variable.support(), levels).tolist())


def grid_size(variables: Mapping[str, Distribution], levels: Levels) -> int:
    """Return the number of points of a grid."""
    return prod(len(levels_of(variable, levels.get(name, 1))) for name, variable in variables.items())


def listed(rows: Mapping[str, tuple[float, ...]], names: list[str], first: int, count: int) -> dict[str, Array]:
    """Return rows ``first .. first + count - 1`` of a table, each column of shape (count,)."""
    return {name: np.array(rows[name][first : first + count]) for name in names}
