"""Samples at the corners and the middle of the box that the variables' ranges span (paper, eqs. 24 and 25)."""

import numpy as np

from campaign.inputs.sampling.enumerating import EnumeratingSampler
from campaign.inputs.sampling.sampler import SampledInputs
from engine.arrays import Array


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
