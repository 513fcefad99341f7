"""Samplers that enumerate values and draw nothing at random, and the checks that they share."""

from collections.abc import Mapping
from math import isfinite

from campaign.inputs.sampling.sampler import SampledInputs, Sampler, dependence
from engine.mechanism.faults import did_you_mean


class EnumeratingSampler(Sampler):
    """A sampler whose samples are enumerated, so that they do not represent a production."""

    production = False
    weighted = False

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
