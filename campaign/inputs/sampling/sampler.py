"""The interface of a sampler, which gives the variables of a campaign's samples their values."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from campaign.inputs.distributions import Constant, Continuous, Distribution, Empirical
from engine.arrays import Array

Correlations = tuple[tuple[str, str, float], ...]
Levels = Mapping[str, int | tuple[float, ...]]


class SampleRows(Protocol):
    """A user's table of samples."""

    @property
    def columns(self) -> Mapping[str, tuple[float, ...]] | None:
        """Values of each variable by its name, one per sample; None until their file is read."""


class SampledInputs(Protocol):
    """The properties of a campaign that samplers need, named like the keys of the campaign file."""

    @property
    def sampler(self) -> str:
        """Name of the sampler."""

    @property
    def variables(self) -> Mapping[str, Distribution]:
        """Distribution of each variable by its name, in the user's order."""

    @property
    def samples(self) -> int:
        """Number of samples of the whole campaign."""

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""

    @property
    def correlations(self) -> Correlations | None:
        """Pairs of variables with Spearman's rank correlation."""

    @property
    def grid(self) -> Levels | None:
        """Number of levels of each variable, or the levels themselves; only sampler ``grid`` reads it."""

    @property
    def table(self) -> SampleRows | None:
        """The user's samples; only sampler ``list`` reads it."""

    @property
    def importance(self) -> object | None:
        """The proposal, where rejects are expected; only sampler ``importance`` reads it."""

    @property
    def stop(self) -> object | None:
        """A stopping rule, which may end the campaign before its last sample."""


class Sampler(ABC):
    """One way to draw samples; `campaign.inputs.sampling.SAMPLERS` holds one object of each."""

    name: ClassVar[str]  # value of the key ``sampler`` of a campaign file
    summary: ClassVar[str]  # what the samples are, in a few words
    report: ClassVar[str]  # what the report says: what the samples are, and to what extent its intervals hold for them
    # whether the samples represent a production, so that sigma and capability are meaningful
    production: ClassVar[bool] = True
    corners: ClassVar[bool] = False  # whether the samples are the corners of the variables' ranges, for a worst case
    # whether they follow the variables' distributions, so that weights can represent others
    weighted: ClassVar[bool] = True
    ordered: ClassVar[bool] = True  # whether the order of the variables is part of the campaign's identity
    own_key: ClassVar[str] = ""  # key of a campaign file that this sampler alone reads; empty if there is none
    columns: ClassVar[tuple[str, ...]] = ()  # names of the columns that it adds to the results, see `own_columns`
    not_extendable: ClassVar[str] = ""  # why more samples do not begin with the same ones; empty if they do
    # why samples of several seeds are not one sample, and what to do instead; empty if they are
    not_poolable: ClassVar[str] = ""

    def check(self, inputs: SampledInputs) -> None:  # noqa: B027
        """Raise ValueError, with key, value and remedy, if the sampler cannot draw what the campaign file asks for."""

    @abstractmethod
    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return the values of all variables at samples ``first .. first + count - 1``; see `draw` of the package."""

    def independent(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which samples are independent draws that repeat no values, in the shape of ``sample``."""
        return np.ones(sample.shape, np.bool_)

    def own_columns(self, inputs: SampledInputs, sample: NDArray[np.int64]) -> dict[str, NDArray[np.generic]]:
        """Return the columns that this sampler adds to the results, by name, each in the shape of ``sample``."""
        return {}

    def designed(self, inputs: SampledInputs) -> tuple[str, ...] | None:
        """Return the variables of Saltelli's design, in its order; None for samples of any other kind."""
        return None


def varied(inputs: SampledInputs) -> list[str]:
    """Return the names of the variables that vary, in order: they are the dimensions of a sampler."""
    return [name for name, variable in inputs.variables.items() if not isinstance(variable, Constant)]


def dependence(inputs: SampledInputs) -> str:
    """Return the key that makes variables or samples depend on each other; empty if there is none."""
    if inputs.correlations:
        return "correlations"
    for names in joint_variables(inputs.variables).values():
        return f"variables.{names[0]}.joint"
    shifted = (name for name, v in inputs.variables.items() if isinstance(v, Continuous) and v.batch)
    name = next(shifted, "")
    return name and f"variables.{name}.batch"


def joint_variables(variables: Mapping[str, Distribution]) -> dict[str, list[str]]:
    """Return the variables that take their values from one row of a table, by the table's name."""
    tables: dict[str, list[str]] = {}
    for name, variable in variables.items():
        if isinstance(variable, Empirical) and variable.joint:
            tables.setdefault(variable.joint, []).append(name)
    return tables
