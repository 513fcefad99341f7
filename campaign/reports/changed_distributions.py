"""Changed distributions of a campaign, and what they make of its samples: a ratio of densities at each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, inf, isfinite, log
from typing import Any

import numpy as np
from pydantic import ValidationError

from campaign.errors import SpecError
from campaign.inputs.distributions import Continuous, Distribution
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
_SAME_SPREAD = 1e-6  # relative difference of two standard deviations that are the same
_MOST_STEPS = 24  # of the search for a standard deviation; the bounds allow none that is not found by then


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

    A factor is of the standard deviation that the variable has, cut at its bounds. A distribution with the key ``std``
    gets another ``std`` and keeps its bounds; where they do not allow such a spread, it gets the largest that they do.
    Any other is stretched around its mean.

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
        As of `change_distributions`; for one variable with the factor that it reaches, and its values at the same
        ranks.
    """
    new = {name: with_spread(spec.variables[name], factor) for name, factor in factors.items()}
    change = change_distributions(spec, new, columns)
    if len(new) > 1:
        return change
    (name, scaled), *_ = new.items()
    old, x = spec.variables[name], columns[name]
    reached = scaled.moments()[1] / old.moments()[1]
    same = abs(reached / factors[name] - 1) < _SAME_SPREAD
    moved = _moved(old, scaled, x) if isinstance(old, Continuous) else None
    return Change(change.log_ratio, change.outside, factors[name] if same else reached, moved)


def _moved(old: Continuous, new: "Distribution | _Stretched", x: Array) -> Array:
    """Return the values of a new distribution at the ranks that values of the old one have."""
    if isinstance(new, _Stretched):
        mean = old.moments()[0]
        return mean + (x - mean) * new.factor
    return new.ppf(np.clip(old.cdf(x), _NEAREST, 1 - _NEAREST))


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


def with_spread(old: Distribution, factor: float) -> "Distribution | _Stretched":
    """Return a distribution with a factor times the standard deviation of another, or the largest its bounds allow."""
    if getattr(old, "std", None) is None:
        return _Stretched(old, factor)
    from scipy.optimize import brentq  # takes 0.4 s to import

    wanted = factor * old.moments()[1]

    def excess(scale: float) -> float | None:
        scaled = _with_std(old, exp(scale))
        return None if scaled is None else scaled.moments()[1] / wanted - 1.0

    near, far, wall = 0.0, log(factor), inf
    for _ in range(_MOST_STEPS):
        found = excess(far)
        if found is not None and (abs(found) < _SAME_SPREAD or (found > 0) == (factor > 1)):
            break
        near, wall = (near, far) if found is None else (far, wall)
        far = 0.5 * (near + wall) if isfinite(wall) else near + (1.0 if factor > 1 else -1.0)
    else:
        return _with_std(old, exp(near)) or old
    if abs(found) >= _SAME_SPREAD:
        far = float(brentq(lambda scale: excess(scale) or 0.0, near, far, xtol=0.1 * _SAME_SPREAD))
    return _with_std(old, exp(far)) or old


def _with_std(old: Distribution, scale: float) -> Distribution | None:
    """Return a distribution with its key ``std``, and that of its production batches, scaled; None if none exists."""
    table = old.model_dump(exclude_none=True)
    table["std"] *= scale
    if table.get("batch"):
        table["batch"] = {**table["batch"], "std": table["batch"]["std"] * scale}
    try:
        return type(old).model_validate(table)
    except ValidationError:
        return None


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
