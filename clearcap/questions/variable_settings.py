"""Settings of ``clearcap whatif --set``: keys of variables; missing values are taken from the old distribution.

If the kind of a distribution or its set of parameters changes, missing bounds, mean and standard deviation are taken
from the old distribution. The user is told which values were taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np
from pydantic import ValidationError

from campaign.errors import SpecError
from campaign.inputs.distributions import DISTRIBUTIONS, Constant, Distribution
from campaign.inputs.distributions.bounded import Triangular, Uniform
from campaign.inputs.distributions.skewed import Exponential
from campaign.plan import dump_spec
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import structure_faults
from engine.mechanism.faults import did_you_mean
from engine.platform.toml_file import UnfitToml, parse_toml

# Alternative sets of parameters; a distribution is given by one of them.
_PARAMETERS = (
    ("mean", "std"),
    ("nominal", "tolerance", "cpk"),
    ("alpha", "beta"),
    ("shape", "scale"),
    ("log_mean", "log_std"),
)
# Half the width, in standard deviations, of distributions that end at their own bounds.
_HALF_WIDTH: dict[type[Distribution], float] = {Uniform: sqrt(3.0), Triangular: sqrt(6.0)}


@dataclass(frozen=True)
class ChangedVariables:
    """The variables whose distribution settings change."""

    variables: dict[str, Distribution]  # new distributions
    # For each variable, which values were taken from the old distribution or no longer apply.
    assumptions: tuple[str, ...]


def changed_variables(spec: CampaignSpec, settings: Sequence[str]) -> ChangedVariables:
    """Return the variables whose distribution settings change.

    A setting is ``VARIABLE.KEY=VALUE``: a key of the variable's table and a TOML value; an empty one removes the key.
    Raises SpecError if a setting does not name a variable and one of its keys, or if a distribution is impossible.
    """
    tables, written = dump_spec(spec), dict[str, set[str]]()
    for setting in settings:
        name, key = _apply(tables["variables"], setting)
        written.setdefault(name, set()).add(key)
    assumed = {}
    for name, keys in written.items():
        table, words = _completed(tables["variables"][name], spec.variables[name], keys)
        tables["variables"][name], assumed[name] = table, words
    try:
        new = CampaignSpec.model_validate(tables)
    except ValidationError as error:
        faults = [
            str(fault).replace("missing; add it", "missing; give it in the same command")
            for fault in structure_faults(error, CampaignSpec)
        ]
        raise SpecError("\n  ".join(["--set:", *faults])) from error
    changed = {name: v for name, v in new.variables.items() if v != spec.variables[name]}
    said = (_said(name, spec.variables[name], v, assumed.get(name, "")) for name, v in changed.items())
    return ChangedVariables(changed, tuple(filter(None, said)))


def _said(name: str, old: Distribution, new: Distribution, assumed: str) -> str:
    """Describe a new distribution if some of its values were taken from the old one; empty otherwise."""
    sigma = f"its sigma was {old.moments()[1]:.4g} and is {new.moments()[1]:.4g}"
    return f"{name} is now {new.text()} ({assumed.strip('; ')}); {sigma}" if assumed else ""


def _apply(variables: dict[str, dict[str, Any]], setting: str) -> tuple[str, str]:
    """Apply one setting to the tables of the variables; return the variable and its key."""
    name = next((n for n in sorted(variables, key=len, reverse=True) if setting.startswith(f"{n}.")), None)
    key, sign, text = setting[len(name or "") + 1 :].partition("=")
    if name is None or not sign or not key:
        first = setting.partition(".")[0].partition("=")[0]
        raise SpecError(
            f"--set {setting}: allowed is VARIABLE.KEY=VALUE with VARIABLE one of {', '.join(variables)}"
            f"{did_you_mean(first, list(variables))}; write for example --set {next(iter(variables))}.std=0.01"
        )
    if key == "target":
        raise SpecError(
            f"--set {setting}: target is the key of the mechanism that {name} sets, and no part of its distribution;"
            " another target needs a new campaign"
        )
    *tables, last = key.split(".")
    table = variables[name]
    for part in tables:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SpecError(
                f"--set {setting}: {part} is not a table; allowed: VARIABLE.KEY=VALUE with a key of the variable"
            )
    if not text:
        table.pop(last, None)
        return name, key.partition(".")[0]
    try:
        table[last] = parse_toml(f"x = {text}".encode("utf-8", "surrogateescape"))["x"]
    except UnfitToml:
        table[last] = text  # a name whose quotes the shell removed
    return name, key.partition(".")[0]


def _completed(table: dict[str, Any], old: Distribution, written: set[str]) -> tuple[dict[str, Any], str]:
    """Return a variable's table with the missing values added, and a description of values taken and dropped."""
    model = DISTRIBUTIONS.get(str(table.get("distribution")))
    chosen = None if model is None else next((keys for keys in _parameters(model) if written & set(keys)), None)
    if model is None or (type(old) is model and chosen is None):
        return table, ""
    another = type(old) is not model
    gone = {key for key in table if another and key not in model.model_fields}
    if chosen or another:  # except for mean and std, a key has another meaning in another kind of distribution
        same = set() if chosen or model is Exponential else {"mean", "std", "nominal", "tolerance", "cpk"}
        gone |= {key for keys in _PARAMETERS for key in keys} & table.keys() - same - set(chosen or ())
    kept = {key: value for key, value in table.items() if key in written or key not in gone}
    taken = {key: value for key, value in _missing(model, kept, old, chosen).items() if key not in written}
    stays = [key for key in kept if another and key not in written and isinstance(kept[key], float | int)]
    words = [f"{key} = {taken[key]:g} from the old distribution" for key in taken]
    words += [f"{key} = {kept[key]:g} as before" for key in stays]
    dropped = sorted(gone - written)
    return {**kept, **taken}, "; ".join(
        [", ".join(words), *([f"no longer used: {', '.join(dropped)}"] if dropped else [])]
    )


def _parameters(model: type[Distribution]) -> list[tuple[str, ...]]:
    """Return the alternative sets of parameters of a distribution."""
    if model is Exponential:
        return [("scale",), ("mean",), ("std",)]
    return [keys for keys in _PARAMETERS if set(keys) <= model.model_fields.keys()]


def _missing(
    model: type[Distribution], table: Mapping[str, Any], old: Distribution, chosen: tuple[str, ...] | None
) -> dict[str, float]:
    """Return the missing keys that the old distribution can provide: bounds, mean and standard deviation."""
    mean, std = old.moments()
    if model is Constant:
        return {} if "value" in table else {"value": mean}
    if model is Exponential:
        return {} if chosen else {"origin": mean - std, "scale": std}
    found = _ends(model, table, old)
    if model is Triangular and "mode" not in table and {"lower", "upper"} <= {**table, **found}.keys():
        found["mode"] = float(np.clip(mean, *({**table, **found}[end] for end in ("lower", "upper"))))
    sets = _parameters(model)
    if ("mean", "std") in sets and (chosen == ("mean", "std") or not any(set(keys) <= table.keys() for keys in sets)):
        found |= {
            key: x
            for key, x in (("mean", mean), ("std", std))
            if key not in table and chosen in (None, ("mean", "std"))
        }
    return found


def _ends(model: type[Distribution], table: Mapping[str, Any], old: Distribution) -> dict[str, float]:
    """Return the required but missing ends of a distribution: the old ends, or ends that keep the old mean and std."""
    lacking = [end for end in ("lower", "upper") if end in model.model_fields and end not in table]
    lacking = [end for end in lacking if model.model_fields[end].is_required()]
    ends = dict(zip(("lower", "upper"), old.support(), strict=True))
    if not all(map(isfinite, ends.values())):
        if model not in _HALF_WIDTH:
            return {}
        mean, std = old.moments()
        ends = {"lower": mean - _HALF_WIDTH[model] * std, "upper": mean + _HALF_WIDTH[model] * std}
    return {end: ends[end] for end in lacking}
