"""Samplers that enumerate values and draw nothing at random: a grid, a user's table, the corners of the ranges."""

from collections.abc import Mapping
from math import isfinite, prod

import numpy as np

from campaign.inputs.distributions import Constant, Distribution
from campaign.inputs.sampling.sampler import SampledInputs, Sampler, dependence, varied
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean


class EnumeratingSampler(Sampler):
    """A sampler whose samples are enumerated, so that they do not represent a production."""

    production = False
    weighted = False
    not_poolable = "its samples are chosen, not drawn, and another seed gives the same ones"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError for a key that asks for something random, because it would have no effect."""
        if key := dependence(inputs):
            raise ValueError(f"{key}: sampler {self.name} draws nothing at random and would ignore it; remove it")

    def check_ends(self, inputs: SampledInputs, names: list[str], remedy: str = "") -> None:
        """Raise ValueError if a variable lacks its lower or upper end; ``remedy`` is an alternative to giving both."""
        endless = [name for name in names if not all(map(isfinite, inputs.variables[name].support()))]
        if endless:
            raise ValueError(
                f"sampler {self.name} needs two ends of every variable, and lacks one of {', '.join(endless)}; give"
                f" lower and upper{remedy}"
            )


def check_names(inputs: SampledInputs, key: str, given: list[str], needed: list[str], remedy: str) -> None:
    """Raise ValueError if an entry of a table ``key`` is not a variable, or a variable has no entry."""
    for name in given:
        if name not in inputs.variables:
            raise ValueError(
                f"{key}.{name}: no variable has this name; allowed: {', '.join(needed)}{did_you_mean(name, needed)}"
            )
    for name in needed:
        if name not in given:
            raise ValueError(f"{key}.{name}: missing; {remedy}")


def check_bounds(inputs: SampledInputs, key: str, given: Mapping[str, tuple[float, ...]]) -> None:
    """Raise ValueError for a value of a table ``key`` outside of the range of the variable's distribution."""
    for name, values in given.items():
        low, high = inputs.variables[name].support()
        for row, value in enumerate(values):
            if not low <= value <= high:
                raise ValueError(
                    f"{key}.{name}: value {value:g} (number {row}) lies outside of the variable's range, [{low:g},"
                    f" {high:g}]; correct the value, or widen the range"
                )


class Grid(EnumeratingSampler):
    """The samples are the points of a grid."""

    name = "grid"
    summary = "all combinations of levels of the variables"
    report = (
        "The samples are the points of a grid, not a production: sigma, indices and ppm describe the grid only, and no "
        "verdict follows from them; read minima, maxima and what moves the responses."
    )
    own_key = "grid"
    not_extendable = "a grid consists of all combinations of its levels"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless every variable that varies has levels and ``samples`` is the number of points."""
        super().check(inputs)
        given, names = inputs.grid or {}, varied(inputs)
        check_names(inputs, "grid", list(given), names, "give a number of levels, or the levels")
        numbered = [name for name in names if isinstance(given[name], int)]
        self.check_ends(inputs, numbered, remedy=", or its levels")
        check_bounds(inputs, "grid", {name: levels for name, levels in given.items() if isinstance(levels, tuple)})
        size = prod(levels if isinstance(levels := given[name], int) else len(levels) for name in names)
        if inputs.samples != size:
            raise ValueError(f"samples = {inputs.samples}: the grid has {size} points; write samples = {size}")

    def levels(self, inputs: SampledInputs) -> dict[str, tuple[float, ...]]:
        """Return the levels of each variable."""
        given = inputs.grid or {}
        return {name: _levels(variable, given.get(name, 1)) for name, variable in inputs.variables.items()}

    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return points by number; the first variable changes fastest."""
        number, drawn = np.arange(first, first + count), {}
        for name, levels in self.levels(inputs).items():
            number, at = np.divmod(number, len(levels))
            drawn[name] = np.array(levels)[at]
        return drawn


def _levels(variable: Distribution, given: int | tuple[float, ...]) -> tuple[float, ...]:
    """Return the given levels of a variable, or the given number of levels, evenly spaced from end to end."""
    if isinstance(given, tuple):
        return given
    if isinstance(variable, Constant):
        return (variable.value,)
    return tuple(np.linspace(*variable.support(), given).tolist())


class UserTable(EnumeratingSampler):
    """Sample i is row i of a table."""

    name = "list"
    summary = "the rows of a table"
    report = (
        "The samples are a given list, which need not represent a production: sigma, indices and ppm describe "
        "the list only, and no verdict follows from them."
    )
    own_key = "table"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless the table has a column for each variable and enough rows."""
        super().check(inputs)
        if inputs.table is None:
            raise ValueError('table: missing; sampler "list" draws its rows; add table = {file = "..."}')
        columns = inputs.table.columns
        if columns is None:  # the file has not been read yet
            return
        check_names(inputs, "table.columns", list(columns), list(inputs.variables), "add its column")
        check_bounds(inputs, "table.columns", columns)
        rows = len(next(iter(columns.values())))
        if inputs.samples > rows:
            raise ValueError(f"samples = {inputs.samples}: the table has {rows} rows; write samples = {rows} or fewer")

    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return rows of the table; ValueError if its file has not been read."""
        columns = inputs.table.columns if inputs.table else None
        if columns is None:
            raise ValueError("the rows of the table have not been read; load the campaign from its file")
        return {name: np.array(columns[name][first : first + count]) for name in inputs.variables}


# The corners and the middle of the box that the variables' ranges span are those of the paper's eqs. 24 and 25.


class Corners(EnumeratingSampler):
    """Each sample has every variable at an end of its range; the last sample is the middle of all ranges."""

    name = "worst_case"
    summary = "all corners of the variables' ranges, and their middle"
    report = (
        "The samples are the corners of the variables' ranges and their middle, not a production: read the worst case; "
        "sigma, indices and ppm describe the corners only, and no verdict follows from them."
    )
    corners = True
    not_extendable = "worst_case consists of all corners and the middle"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless all variables have two ends and ``samples`` counts all corners and the middle."""
        super().check(inputs)
        self.check_ends(inputs, list(inputs.variables))
        corners = 2 ** len(inputs.variables)
        if inputs.samples != corners + 1:
            raise ValueError(
                f"samples = {inputs.samples}: sampler worst_case: {len(inputs.variables)} variables have {corners}"
                f" corners and a middle; write samples = {corners + 1}"
            )

    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return corners by number: bit j of the number says at which end variable j is."""
        number, drawn = np.arange(first, first + count), {}
        for j, (name, variable) in enumerate(inputs.variables.items()):
            low, high = variable.support()
            ends = np.where(number >> j & 1, high, low)
            drawn[name] = np.where(number == 2 ** len(inputs.variables), 0.5 * (low + high), ends)
        return drawn
