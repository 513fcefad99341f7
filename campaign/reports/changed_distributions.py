"""Changed distributions of a campaign, and what they make of its samples: a ratio of densities at each."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite, log
from typing import Any

import numpy as np
from pydantic import ValidationError

from campaign.errors import SpecError
from campaign.inputs.distributions import Distribution
from campaign.inputs.sampling import SAMPLERS, sampler_named
from campaign.inputs.sampling.correlation import matrix
from campaign.plan import dump_spec
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import structure_faults
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean
from engine.toml_file import UnfitToml, parse_toml
from reporting.tolerance.reweighting import Change

_NEAREST = 1e-16  # distance from 0 and 1 of a probability that becomes a normal score


def changed_variables(spec: CampaignSpec, settings: Sequence[str]) -> dict[str, Distribution]:
    """Return the variables whose distribution settings change, with their new ones.

    Parameters
    ----------
    spec : CampaignSpec
        The campaign.
    settings : sequence of str
        Each ``VARIABLE.KEY=VALUE``: a key of the variable's table and a TOML value. An empty value removes the key.

    Returns
    -------
    dict of str to Distribution
        New distributions by variable.

    Raises
    ------
    SpecError
        If a setting names no variable or no key of it, or a distribution is not possible.
    """
    tables = dump_spec(spec)
    for setting in settings:
        _apply(tables["variables"], setting)
    try:
        new = CampaignSpec.model_validate(tables)
    except ValidationError as error:
        raise SpecError("\n  ".join(["--set:", *structure_faults(error, CampaignSpec)])) from error
    return {name: v for name, v in new.variables.items() if v != spec.variables[name]}


def _apply(variables: dict[str, dict[str, Any]], setting: str) -> None:
    """Apply one setting to the tables of the variables."""
    name = next((n for n in sorted(variables, key=len, reverse=True) if setting.startswith(f"{n}.")), None)
    key, sign, text = setting[len(name or "") + 1 :].partition("=")
    if name is None or not sign or not key:
        first = setting.partition(".")[0].partition("=")[0]
        raise SpecError(
            f"--set {setting}: allowed is VARIABLE.KEY=VALUE with VARIABLE one of {', '.join(variables)}"
            f"{did_you_mean(first, list(variables))}; write for example --set {next(iter(variables))}.std=0.01"
        )
    if not text:
        variables[name].pop(key, None)
        return
    try:
        value = parse_toml(f"x = {text}".encode("utf-8", "surrogateescape"))["x"]
    except UnfitToml:
        value = text  # a name without quotes, as a shell leaves it
    table = variables[name]
    *tables, last = key.split(".")
    for part in tables:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SpecError(
                f"--set {setting}: {part} is no table; allowed: VARIABLE.KEY=VALUE with a key of the variable"
            )
    table[last] = value


def check_drawn(spec: CampaignSpec) -> None:
    """Raise SpecError if the samples are not drawn from distributions."""
    if not sampler_named(spec.sampler).weighted:
        *names, last = (name for name, sampler in SAMPLERS.items() if sampler.weighted)
        raise SpecError(
            f"sampler {spec.sampler}: its samples do not follow distributions, so they cannot be weighted for others;"
            f" run a campaign with sampler {', '.join(names)} or {last}"
        )


def change_distributions(
    spec: CampaignSpec, new: "Mapping[str, Distribution | _Stretched]", columns: Mapping[str, Array]
) -> Change:
    """Return what new distributions of some variables make of samples; rank correlations stay.

    Parameters
    ----------
    spec : CampaignSpec
        The campaign.
    new : mapping of str to distribution
        By variable; those that are not named stay.
    columns : mapping of str to ndarray, each of shape (n,)
        The variables at the samples.

    Returns
    -------
    Change
        Logarithm of the ratio of densities at each sample, and the probability outside the old distributions.

    Raises
    ------
    SpecError
        If the samples are not drawn from distributions.
    """
    check_drawn(spec)
    n = next(iter(columns.values())).size
    ratio, inside = np.zeros(n), 1.0
    for name, distribution in new.items():
        old = spec.variables[name]
        ratio += distribution.logpdf(columns[name]) - old.logpdf(columns[name])
        inside *= 1.0 - _outside(distribution, *old.support())
    if any(name in pair for name in new for pair in spec.correlations or ()):
        ratio += _copula({**spec.variables, **new}, spec, columns) - _copula(spec.variables, spec, columns)
    return Change(np.where(np.isnan(ratio), -np.inf, ratio), max(1.0 - inside, 0.0))


def scale_spread(spec: CampaignSpec, factors: Mapping[str, float], columns: Mapping[str, Array]) -> Change:
    """Return what the standard deviations of some variables, each times a factor, make of samples.

    A distribution with the key ``std`` gets another ``std`` and keeps its bounds. Any other is stretched around its
    mean.

    Parameters
    ----------
    spec : CampaignSpec
        The campaign.
    factors : mapping of str to float
        By variable.
    columns : mapping of str to ndarray, each of shape (n,)
        The variables at the samples.

    Returns
    -------
    Change
        As of `change_distributions`; for one variable with the factor that its bounds leave of the one asked for.
    """
    new = {name: _scaled(spec.variables[name], factor) for name, factor in factors.items()}
    change = change_distributions(spec, new, columns)
    if len(new) > 1:
        return change
    (name, scaled), *_ = new.items()
    spread = scaled.moments()[1] / spec.variables[name].moments()[1]
    return Change(change.log_ratio, change.outside, spread)


@dataclass(frozen=True)
class _Stretched:
    """A distribution stretched around its mean."""

    old: Distribution
    factor: float

    def moments(self) -> tuple[float, float]:
        mean, std = self.old.moments()
        return mean, self.factor * std

    def logpdf(self, x: Array) -> Array:
        return self.old.logpdf(self._shrunk(x)) - log(self.factor)

    def cdf(self, x: Array) -> Array:
        return self.old.cdf(self._shrunk(x))

    def _shrunk(self, x: Array) -> Array:
        mean = self.old.moments()[0]
        return np.asarray(mean + (x - mean) / self.factor, dtype=np.float64)


def _scaled(old: Distribution, factor: float) -> "Distribution | _Stretched":
    """Return a distribution whose standard deviation is about ``factor`` times that of ``old``."""
    table = old.model_dump(exclude_none=True)
    if "std" in table:
        table["std"] *= factor
        if table.get("batch"):
            table["batch"] = {**table["batch"], "std": table["batch"]["std"] * factor}
        with suppress(ValidationError):  # the bounds may not allow it
            return type(old).model_validate(table)
    return _Stretched(old, factor)


def _outside(new: "Distribution | _Stretched", low: float, high: float) -> float:
    """Return the probability of values below ``low`` or above ``high``."""
    below = float(new.cdf(np.array([np.nextafter(low, -np.inf)]))[0]) if isfinite(low) else 0.0
    above = 1.0 - float(new.cdf(np.array([high]))[0]) if isfinite(high) else 0.0
    return min(max(below + above, 0.0), 1.0)


def _copula(
    variables: "Mapping[str, Distribution | _Stretched]", spec: CampaignSpec, columns: Mapping[str, Array]
) -> Array:
    """Return the logarithm of the density of the Gaussian copula at samples, without its constant."""
    from scipy.special import ndtri

    correlations = spec.correlations or ()
    names = tuple(name for name in variables if any(name in pair for pair in correlations))
    scores = np.array([ndtri(np.clip(variables[n].cdf(columns[n]), _NEAREST, 1 - _NEAREST)) for n in names])
    excess = np.linalg.inv(matrix(names, correlations)) - np.eye(len(names))
    return np.asarray(-0.5 * np.einsum("in,ij,jn->n", scores, excess, scores), dtype=np.float64)
