"""The variables of a campaign with other standard deviations, as far as their bounds and the mechanism allow.

A factor multiplies the standard deviation that a variable has after the cut at its bounds. Bounds never move outwards:
a truncated normal distribution gets another ``std`` between its old bounds, and a uniform one, which fills its bounds,
cannot grow. A distribution without bounds grows until the mechanism refuses its outermost values, such as a clearance
below 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import exp, inf, isfinite, log
from typing import Any

import numpy as np
from pydantic import ValidationError

from campaign.inputs.distributions import Continuous, Distribution
from campaign.spec.campaign_file import CampaignSpec
from clearcap.questions.whatif import change_distributions
from engine import MechanismError, check
from engine.arrays import Array
from engine.mechanism import Mechanism
from reporting import format_numbers
from reporting.tolerance.reweighting import Change

SAME = 1e-6  # relative difference below which two standard deviations are the same
_NEAREST = 1e-16  # distance from 0 and 1 of a probability whose quantile is taken
# Steps of the search for a standard deviation, in the logarithm of the scale; one that is not found is not possible.
_FIRST_STEP, _STEP_GROWTH, _MOST_STEPS = 0.25, 1.15, 15
_BISECTIONS = 12  # between a factor that the mechanism accepts and one that it refuses
_SEARCHED = 10.0  # factors up to this are tried on the mechanism at once
_GRID, _WIDEST = 2001, 12.0  # points and half width [standard deviations] of a distribution over production batches
_DIGITS = 7  # of a number for users to write into a file

# Parameters that a distribution may have in place of mean and std.
_SHIFTED = {"shift", "sigma_shift", "inertia"}  # the spread follows from more than the tolerance
_NATURAL = (
    *("dimension", "fit", "nominal", "tolerance", "cpk", *_SHIFTED, "inflation"),
    *("alpha", "beta", "shape", "scale", "log_mean", "log_std"),
)


@dataclass(frozen=True)
class Spread:
    """A distribution with another standard deviation."""

    law: Distribution
    factor: float  # ratio of its standard deviation to the old one
    keys: dict[str, Any] = field(default_factory=dict)  # to write into the variable's table to get it
    limit: str = ""  # why the factor is nearer to 1 than the requested one; empty if it is the requested one


class Spreads:
    """The variables of a campaign with other standard deviations.

    The mechanism refuses impossible values; without it, everything that the distributions allow is possible.
    """

    def __init__(self, spec: CampaignSpec, mechanism: Mechanism | None = None) -> None:
        self._spec, self._mechanism = spec, mechanism
        self._largest: dict[str, tuple[float, Spread]] = {}
        self._found: dict[tuple[str, float], Spread] = {}

    def of_variable(self, name: str, factor: float) -> Spread:
        """Return a variable with a factor times its standard deviation, or with the nearest possible factor."""
        if (name, factor) not in self._found:
            self._found[name, factor] = self._nearest(name, factor)
        return self._found[name, factor]

    def _nearest(self, name: str, factor: float) -> Spread:
        """Return a variable with the possible factor that is nearest to the requested one."""
        old = self._spec.variables[name]
        if factor <= 1:
            return with_spread(old, factor)
        asked, largest = self._largest.get(name, (0.0, Spread(old, 1.0)))
        if factor > asked and not largest.limit:
            asked, largest = self._largest[name] = max(factor, _SEARCHED), self._find_largest(name, factor)
        return largest if largest.limit and factor > largest.factor else with_spread(old, factor)

    def change(self, factors: Mapping[str, float], columns: Mapping[str, Array]) -> Change:
        """Return the effect on samples of multiplying the standard deviations of some variables by factors.

        `columns` has the values (n,) of the variables. The result is that of `change_distributions`, with the values of
        the variables at the same ranks, the settings to write, and the factor nearest to 1 if one cannot be reached.
        Raises SpecError if the samples are not drawn from distributions.
        """
        spreads = {name: self.of_variable(name, factor) for name, factor in factors.items()}
        change = change_distributions(self._spec, {name: each.law for name, each in spreads.items()}, columns)
        limited = [each for each in spreads.values() if each.limit]
        return replace(
            change,
            spread=min((each.factor for each in limited or spreads.values()), key=lambda f: abs(log(f))),
            moved={
                name: _moved(old, each.law, columns[name])
                for name, each in spreads.items()
                if isinstance(old := self._spec.variables[name], Continuous) and isinstance(each.law, Continuous)
            },
            limit="; ".join(dict.fromkeys(each.limit for each in limited)),
            settings=tuple(
                f"{name}.{key}={_shown(x)}" for name, each in spreads.items() for key, x in each.keys.items()
            ),
            written=tuple(text for name, factor in factors.items() for text in self.written(name, factor)),
        )

    def written(self, name: str, factor: float) -> tuple[str, ...]:
        """Return what to write for a factor on one standard deviation, in the digits of a drawing."""
        spread = self.of_variable(name, factor)
        std = spread.law.moments()[1]
        return tuple(f"{name}.{key}={_as_drawn(x, std)}" for key, x in spread.keys.items())

    def _find_largest(self, name: str, factor: float) -> Spread:
        """Return a variable with the largest spread that its bounds and the mechanism allow, up to the tried factor."""
        old = self._spec.variables[name]
        ends, most = old.ends(), with_spread(old, max(factor, _SEARCHED))
        refusal = self._refusal(name, ends, most.law)
        if not refusal:
            return most
        low, high, best = 0.0, log(most.factor), Spread(old, 1.0)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            tried = with_spread(old, exp(middle))
            refused = self._refusal(name, ends, tried.law)
            low, high = (low, middle) if refused else (middle, high)
            best, refusal = (best, refused) if refused else (tried, refusal)
        return replace(best, limit=refusal)

    def _refusal(self, name: str, ends: tuple[float, float], new: Distribution) -> str:
        """Return the message about a value beyond the old ends that the mechanism refuses; empty if there is none."""
        if self._mechanism is None:
            return ""
        (low, high), (least, most) = new.ends(), ends
        for value in [x for x, is_farther in ((low, low < least), (high, high > most)) if is_farther]:
            try:
                check(self._mechanism, {self._spec.targets()[name]: value})
            except MechanismError:
                return f"more would reach {name} = {value:.3g}, which the mechanism refuses"
        return ""


def with_spread(old: Distribution, factor: float) -> Spread:
    """Return a distribution of the same kind with a factor times the standard deviation, or the nearest possible."""
    if not isinstance(old, Continuous):
        return Spread(old, 1.0, {}, "its values are separate: its spread follows from their probabilities")
    if abs(factor - 1) < SAME:
        return Spread(old, 1.0)
    law = _search(old, factor)
    reached = law.moments()[1] / old.moments()[1]
    same = abs(reached / factor - 1) < 10 * SAME
    limit = "its bounds allow no more" if factor > 1 else "its distribution allows no less"
    return Spread(law, factor if same else reached, _changed_keys(old, law), "" if same else limit)


def _search(old: Continuous, factor: float) -> Continuous:
    """Return the distribution with a factor times the standard deviation, or the nearest one that exists.

    Steps are small, because between bounds the standard deviation may fall again while the spread before the cut grows.
    """
    from scipy.optimize import brentq, minimize_scalar  # takes 0.4 s to import

    wanted, way = factor * old.moments()[1], 1.0 if factor > 1 else -1.0

    def excess(scale: float) -> float | None:
        scaled = _scaled(old, exp(scale))
        return None if scaled is None else scaled.moments()[1] / wanted - 1.0

    passed, far, step, wall = [(0.0, 1 / factor - 1)], log(factor), _FIRST_STEP, inf
    for _ in range(_MOST_STEPS):
        found = excess(far)
        if found is None:
            wall = far
        elif abs(found) < SAME:
            return _scaled(old, exp(far)) or old
        elif found * way > 0:
            root = brentq(lambda scale: excess(scale) or 0.0, passed[-1][0], far, xtol=0.1 * SAME)
            return _scaled(old, exp(float(root))) or old
        else:
            passed.append((far, found))
        near, step = passed[-1][0], step * _STEP_GROWTH
        far = 0.5 * (near + wall) if isfinite(wall) else near + way * step
    best = max(range(len(passed)), key=lambda i: way * passed[i][1])
    scale = passed[best][0]
    if best + 1 < len(passed):
        ends = sorted((passed[max(best - 1, 0)][0], passed[best + 1][0]))
        scale = float(minimize_scalar(lambda at: -way * (excess(at) or -inf), bounds=ends, method="bounded").x)
    return _scaled(old, exp(scale)) or old


def _scaled(old: Continuous, scale: float) -> Continuous | None:
    """Return a distribution with its spread before the cut scaled; None if none exists within its bounds.

    The mean before the cut stays the same, except for an exponential distribution, whose mean determines its spread.
    """
    table = old.model_dump(exclude_none=True)
    has_moments = {"mean", "std"} <= type(old).model_fields.keys()
    if "tolerance" in table and not _SHIFTED & table.keys():  # the capability of the manufacturer stays the same
        table["tolerance"] *= scale
    elif "zone" in table:
        table |= {key: table[key] * scale for key in ("zone", "std") if key in table}
    elif table["distribution"] == "exponential":
        table = {key: x for key, x in table.items() if key not in ("mean", "std")}
        table["scale"] = old.parent().moments()[1] * scale
    elif has_moments:
        mean, std = old.parent().moments()
        table = {key: x for key, x in table.items() if key not in _NATURAL} | {"mean": mean, "std": std * scale}
    elif scale > 1:
        return None
    else:
        table |= _drawn_in(old, table, scale)
    if table.get("batch"):
        table["batch"] = {**table["batch"], "std": table["batch"]["std"] * scale}
    try:
        return type(old).model_validate(table)
    except ValidationError:
        return None


def _drawn_in(old: Continuous, table: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """Return the ends and mode of a distribution, moved towards its mean; its ends determine its spread."""
    mean = old.moments()[0]
    keys = {key: mean + scale * (table[key] - mean) for key in ("lower", "upper", "mode") if key in table}
    return keys | ({"within": [mean + scale * (x - mean) for x in table["within"]]} if "within" in table else {})


def _changed_keys(old: Continuous, new: Continuous) -> dict[str, Any]:
    """Return the keys to write for a new distribution, with dotted keys for tables within the variable's table."""
    keys = {key: value for key, value in new.model_dump(exclude_none=True).items() if value != getattr(old, key)}
    if "batch" in keys:
        keys["batch.std"] = keys.pop("batch")["std"]
    return keys


def _shown(value: Any) -> str:
    """Return a value as TOML."""
    return f"[{', '.join(map(_shown, value))}]" if isinstance(value, tuple | list) else f"{value:.{_DIGITS}g}"


def _as_drawn(value: Any, std: float) -> str:
    """Return a value in the digits of a drawing: to 1 % of the standard deviation, or of a smaller value itself."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(_as_drawn(x, std) for x in value)}]"
    places = format_numbers.decimals_for(min(std, abs(value)) if value else std)
    return format_numbers.plain(round(value, places))


def _moved(old: Continuous, new: Continuous, x: Array) -> Array:
    """Return the values of a new distribution at the ranks of values of the old one."""
    ranks = np.clip(old.cdf(x), _NEAREST, 1 - _NEAREST)
    if new.batch is None:
        return new.ppf(ranks)
    (mean, std), (low, high) = new.moments(), new.support()  # quantiles over all production batches have no formula
    grid = np.linspace(max(low, mean - _WIDEST * std), min(high, mean + _WIDEST * std), _GRID)
    return np.interp(ranks, new.cdf(grid), grid)
