"""All combinations of levels of the variables."""

from math import prod

import numpy as np

from campaign.inputs.distributions import Constant, Distribution
from campaign.inputs.sampling.enumerating import EnumeratingSampler, check_bounds, check_names
from campaign.inputs.sampling.sampler import SampledInputs, varied
from engine.arrays import Array


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
