"""Check that the variables of a campaign can set their targets: existing keys, one variable each, allowed values."""

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from pydantic import TypeAdapter, ValidationError

from campaign.inputs.distributions import Distribution, Empirical, Variable
from campaign.spec.campaign_file import MOST_VARIABLES
from campaign.spec.faults import SpecFault, fault
from engine import MechanismError, check
from engine.mechanism import Mechanism, full_key, get_value
from engine.mechanism.base import is_number
from engine.mechanism.keys.key_paths import SETTINGS, following
from engine.mechanism.parameters import PREFIX

_DISTRIBUTION: TypeAdapter[Distribution] = TypeAdapter(Variable)


def target_faults(raw: Mapping[str, Any], mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the faults of the variables of a campaign, as read, and of their targets, one at a time.

    The campaign may have other faults; only variables that are valid by themselves are checked.
    """
    # more variables are refused in any case: checking them too would only take time
    variables = dict(islice(_sound_variables(raw.get("variables")), MOST_VARIABLES))
    targets = {name: variable.target or name for name, variable in variables.items()}
    setters: dict[str, str] = {}  # full key -> name of the first variable that sets it
    for name, target in targets.items():
        setters.setdefault(full_key(mechanism, target), name)
    parameters = {key.removeprefix(PREFIX): name for key, name in setters.items() if key.startswith(PREFIX)}
    followers = following(mechanism.formulas, parameters)
    for name, variable in variables.items():
        target, keys = targets[name], ["variables", name]
        key = full_key(mechanism, target)
        origins = sorted(followers.get(key, set()))
        if setters[key] != name:
            yield fault(keys, None, f"{setters[key]} and {name} both set {target}; keep one of them")
        elif origins:
            first, text = origins[0], mechanism.formulas[key]
            yield fault(
                keys,
                None,
                f"{name} sets {target}, which follows from {PREFIX}{first} ({text}), and {parameters[first]} sets "
                f"{PREFIX}{first}; keep one of them, or add a parameter of its own to the expression",
            )
        else:
            yield from _faults_of(name, target, {*variable.ends(), *_extremes(raw, name)}, mechanism)


def _sound_variables(table: Any) -> Iterator[tuple[str, Distribution]]:
    """Yield the variables that are valid by themselves."""
    for name, entry in table.items() if isinstance(table, dict) else ():
        try:
            variable = _DISTRIBUTION.validate_python(entry)
        except ValidationError:
            continue
        if not isinstance(variable, Empirical) or variable.values:  # an unreadable file is already a fault
            yield name, variable


def _extremes(raw: Mapping[str, Any], name: str) -> list[float]:
    """Return the smallest and the largest value that the user lists for a variable, if any is listed."""
    grid, table = raw.get("grid"), raw.get("table")
    columns = table.get("columns") if isinstance(table, dict) else None
    listed = [entry.get(name) for entry in (grid, columns) if isinstance(entry, dict)]
    numbers = [x for values in listed if isinstance(values, list) for x in values if is_number(x)]
    return [min(numbers), max(numbers)] if numbers else []


def _faults_of(name: str, target: str, values: set[float], mechanism: Mechanism) -> Iterator[SpecFault]:
    """Yield the faults of a variable whose target cannot be set, or of values that the mechanism refuses."""
    keys = ["variables", name]
    try:
        get_value(mechanism, target)
    except MechanismError as error:
        yield fault(keys, None, f"does not set a number of {mechanism.name}: {_reason(error)}")
        return
    if target.startswith(SETTINGS):
        setting = target.removeprefix(SETTINGS)
        text = f"{target} says how a run is computed, and is the same for all; allowed: numbers of the mechanism; "
        yield fault(keys, None, f"{text}give {setting} in [simulation] of the campaign, or in the mechanism file")
        return
    if target.startswith(PREFIX) and not following(mechanism.formulas, [target.removeprefix(PREFIX)]):
        on_bench = f" on bench {mechanism.bench}" if mechanism.bench else ""
        yield fault(keys, None, f"nothing of {mechanism.name}{on_bench} follows from {target}; remove the variable")
        return
    for value in sorted(values):
        try:
            check(mechanism, {target: value})
        except MechanismError as error:
            text = f"reaches {target} = {value:g}, which {mechanism.name} refuses: {_reason(error, target)}"
            yield fault(keys, None, f"{text}; or {_remedy(value, values)}")


def _remedy(value: float, values: set[float]) -> str:
    """Return how to keep a variable away from one of its ends, if it has two."""
    if min(values) == max(values):
        return "give the variable another value"
    return "raise its lower end" if value == min(values) else "lower its upper end"


def _reason(error: MechanismError, told: str = "") -> str:
    """Return the faults of an engine error in one line, without its heading; without the key if it is ``told``."""
    if told and error.faults:
        return "; ".join(fault.text if fault.key == told else str(fault) for fault in error.faults)
    heading, *lines = str(error).splitlines()
    return "; ".join(line.strip() for line in lines) or heading
