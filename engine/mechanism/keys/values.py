"""Read or set one number of a mechanism by its key, return its unit, or list all keys.

A key is the name of a joint, which refers to its clearance, or the dotted path of a number in the file, such as
`springs.A3.preload`, `joints.J1.bearing.point.x` or `parameters.arm`. In an ideal joint only points and axes have keys,
because its other numbers have no effect. Setting a number has the same effect as writing it into the file: expressions
that use a parameter get new values. Since this happens for each sample of a campaign, only the tables on the path to a
number are checked again, not the whole mechanism.
"""

import fnmatch
import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Any

from pydantic import ValidationError

from engine.errors import Fault, MechanismError
from engine.mechanism.base import LARGEST_NUMBER, is_number, limits
from engine.mechanism.closest import closest
from engine.mechanism.expression import ExpressionFault, evaluate, parse
from engine.mechanism.faults import faults_of
from engine.mechanism.joints import Joint
from engine.mechanism.journals import JournalJoint
from engine.mechanism.keys.key_paths import (
    PREFIX,
    SETTINGS,
    Place,
    along,
    by_tokens,
    following,
    settable_places,
    users,
    without_effect,
)
from engine.mechanism.models import Mechanism

MOST_NAMED = 20

_RELATIONS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def get_value(mechanism: Mechanism, key: str) -> float:
    """Return the number with a key, in the unit of `unit_of`; components of a direction are those in the file.

    Raise MechanismError if no number has this key; the message suggests the key that may be meant.
    """
    return float(_places(mechanism, key)[-1].value)


def unit_of(mechanism: Mechanism, key: str) -> str:
    """Return the unit of the number with a key, "1" for a pure number; raise MechanismError if none has this key."""
    return _unit(mechanism, key, _places(mechanism, key)[-1])


def full_key(mechanism: Mechanism, key: str) -> str:
    """Return the dotted path for a key: the name of a joint is replaced by the path of its clearance."""
    return f"joints.{key}.{mechanism.joints[key].CLEARANCE}" if key in mechanism.joints else key


def settable_keys(mechanism: Mechanism) -> list[str]:
    """Return every key that can be set: first the names of the joints with play, then all dotted paths."""
    return [*mechanism.loose_joints(), *(key for key, _ in settable_places(mechanism))]


def set_values(mechanism: Mechanism, changes: Mapping[str, float]) -> Mechanism:
    """Return a mechanism with some of its numbers replaced.

    Parameters
    ----------
    mechanism : Mechanism
        The original; it is not changed.
    changes : mapping
        Key -> number in the unit of the key; a key is the name of a joint (its clearance) or a dotted path. A number
        given as an expression in the file no longer follows its parameters once it is set itself.

    Returns
    -------
    Mechanism

    Raises
    ------
    MechanismError
        With one line for each key that is unknown or whose number is not allowed.
    """
    if joints := _with_clearances(mechanism, changes):
        return mechanism.with_tables({"joints": joints}, mechanism.formulas)
    faults: list[tuple[str, Fault]] = []  # the key set by the caller, and what is wrong with it
    settings: dict[str, _Setting] = {}
    for key, given in changes.items():
        try:
            unit = partial(_unit, mechanism, key, _places(mechanism, key)[-1])
            number = _finite(key, given, unit)
            first = settings.setdefault(full_key(mechanism, key), _Setting(number, key, number, unit))
            if first.number != number:
                raise _refused(key, f"{first.key} stands for the same number; set it once")
        except MechanismError as error:
            faults += [(key, fault) for fault in error.faults]
    formulas = mechanism.formulas
    if formulas:
        formulas = {key: text for key, text in formulas.items() if key not in settings}
        settings |= _followers(mechanism, formulas, settings, faults)
    update = {
        table: _rebuilt(mechanism, along(mechanism, [table])[-1], [table], below, faults)
        for table, below in by_tokens(settings).items()
    }
    if faults:
        order = list(changes)
        found = [fault for _, fault in sorted(faults, key=lambda entry: order.index(entry[0]))]
        lines = [f"  {fault}" for fault in found]
        raise MechanismError("\n".join([f"mechanism {mechanism.name}: values that cannot be set", *lines]), found)
    return mechanism.with_tables(update, formulas)


def _with_clearances(mechanism: Mechanism, changes: Mapping[str, float]) -> dict[str, Joint]:
    """Return the joints with other clearances; empty where anything else is set, or a number might be refused."""
    joints: dict[str, Joint] = dict(mechanism.joints)
    for name, number in changes.items():
        joint = joints.get(name)
        changed = joint.with_clearance(float(number)) if joint and isinstance(number, float) else None
        if changed is None or full_key(mechanism, name) in mechanism.formulas:
            return {}
        joints[name] = changed
    return joints


@dataclass(frozen=True)
class _Setting:
    """A number to set, with the key, number and unit of the change that it results from."""

    number: float
    key: str
    given: float
    unit: Callable[[], str]  # called only for messages

    def fault(self, text: str) -> tuple[str, Fault]:
        return self.key, Fault(tuple(self.key.split(".")), text, self.given, self.unit())


def _finite(key: str, number: Any, unit: Callable[[], str]) -> float:
    """Return ``number`` as a float; numbers of numpy are accepted, texts and booleans are not."""
    if isinstance(number, Real) and not isinstance(number, bool):
        try:
            finite = float(number)
        except OverflowError:  # an integer beyond the range of floats
            finite = math.inf
        if math.isfinite(finite):
            if abs(finite) > LARGEST_NUMBER:
                text = f"implausible for a physical quantity; allowed: sizes up to {LARGEST_NUMBER:g}; correct it"
                raise _refused(key, text, number, unit())
            return finite
    raise _refused(key, f"not a finite number; allowed: a number in {unit()}; give one", number)


def _refused(key: str, text: str, value: Any = None, unit: str = "") -> MechanismError:
    """Return the error for one key."""
    fault = Fault(tuple(key.split(".")), text, value, unit if is_number(value) else "")
    return MechanismError(str(fault), [fault])


def _followers(
    mechanism: Mechanism, formulas: Mapping[str, str], settings: Mapping[str, _Setting], faults: list[tuple[str, Fault]]
) -> dict[str, _Setting]:
    """Return the settings of the numbers whose expressions depend on the parameters that are set."""
    changed = {key.removeprefix(PREFIX): setting for key, setting in settings.items() if key.startswith(PREFIX)}
    if not changed:
        return {}
    values = {**mechanism.parameters, **{name: setting.number for name, setting in changed.items()}}
    found: dict[str, _Setting] = {}
    for key, origins in following(formulas, changed).items():
        origin = next(setting for name, setting in changed.items() if name in origins)
        try:
            number = values[key.removeprefix(PREFIX)] = evaluate(parse(formulas[key]), values)
        except ExpressionFault as fault:
            faults.append(origin.fault(f"then {key} = {formulas[key]!r}: {fault}"))
        else:
            found[key] = _Setting(number, origin.key, origin.given, origin.unit)
    return found


def _rebuilt(
    mechanism: Mechanism, place: Place, path: list[str], settings: Any, faults: list[tuple[str, Fault]]
) -> Any:
    """Return a place's value with the settings below it applied and every table on the path checked; collect faults."""
    if isinstance(settings, _Setting):
        if isinstance(place.owner, Mechanism) and (text := _outside(place, settings.number)):
            faults.append(settings.fault(text))  # a table checks the numbers in it, and this one is in none
        return settings.number
    below = {token: place.at(token) or place for token in settings}
    new = {token: _rebuilt(mechanism, below[token], [*path, token], inner, faults) for token, inner in settings.items()}
    try:
        return place.with_below(new)
    except ValidationError as error:
        for fault in faults_of(error, type(place.value), mechanism.units):
            faults.append(_refusal(mechanism, fault, path, dict(_ends(settings))))
        return place.value


def _outside(place: Place, number: float) -> str:
    """Return what is wrong with a number beyond the limits of its field; empty if it is within them."""
    found = limits(place.field).items()
    if all(getattr(operator, relation)(number, bound) for relation, bound in found):
        return ""
    return f"allowed: {', '.join(f'{_RELATIONS[relation]} {bound:g}' for relation, bound in found)}; correct it"


def _ends(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, _Setting]]:
    """Yield each setting below a table together with its key in the table."""
    for token, inner in settings.items():
        if isinstance(inner, _Setting):
            yield prefix + token, inner
        else:
            yield from _ends(inner, f"{prefix}{token}.")


def _refusal(
    mechanism: Mechanism, fault: Fault, path: list[str], settings: Mapping[str, _Setting]
) -> tuple[str, Fault]:
    """Return the key that was set, and the fault why a table refuses its number or another that results from it."""
    table = ".".join(path)
    for key, setting in settings.items():
        if key == fault.key or key.startswith(f"{fault.key}."):
            itself = full_key(mechanism, setting.key) == f"{table}.{key}"
            return setting.fault(fault.text if itself else f"then {table}.{key} = {setting.number:g}: {fault.text}")
    then = f"then {table}.{fault}" if fault.key else f"then {table}: {fault.text}"
    first, *others = {setting.key: setting for setting in settings.values()}.values()
    if others:
        return first.key, Fault(tuple(first.key.split(".")), then, others=tuple(other.key for other in others))
    return first.fault(then)


def _unit(mechanism: Mechanism, key: str, place: Place) -> str:
    """Return the unit of the number with a given key and place."""
    return mechanism.parameter_units[key.removeprefix(PREFIX)] if key.startswith(PREFIX) else mechanism.unit_at(place)


def _places(mechanism: Mechanism, key: str) -> list[Place]:
    """Return the places along the path of a key: the mechanism first, the number last."""
    tokens = full_key(mechanism, key).split(".")
    places = along(mechanism, tokens)
    if reason := without_effect(mechanism, tokens):
        raise _refused(key, reason)
    if len(places) <= len(tokens):
        raise _refused(key, unknown_key(mechanism, key))
    if places[-1].value is None:
        raise _refused(key, "has no number in this mechanism; write one into the file first")
    if not isinstance(places[-1].value, float):
        inside = sorted((k for k, _ in settable_places(mechanism, ".".join(tokens))), key=lambda k: k.count("."))
        inner_keys = f"; inside it: {', '.join(inside[:8])}{', ...' if len(inside) > 8 else ''}" if inside else ""
        raise _refused(key, f"not a single number; allowed: single numbers{inner_keys}")
    return places


def unknown_key(mechanism: Mechanism, key: str) -> str:
    """Return the message that no number has this key, with what exists where it goes wrong and the likely key."""
    meant = meant_key(mechanism, key)
    question = f"; did you mean '{meant}'?" if meant else ""
    places = along(mechanism, key.split("."))
    if len(places) > 1:
        known = ".".join(key.split(".")[: len(places) - 1])
        below = list(places[-1].below())
        names = ", ".join(below[:MOST_NAMED]) + (", ..." if len(below) > MOST_NAMED else "")
        return f"unknown key; {f'{known} has {names}' if below else f'{known} has nothing inside'}{question}"
    joints = ", ".join(mechanism.loose_joints()) or "none has play"
    return (
        f"unknown key; allowed: a joint ({joints}), whose clearance it sets, "
        f"or the dotted path of a number in the file, as clearcap mechanism show --keys lists them{question}"
    )


def meant_key(mechanism: Mechanism, key: str) -> str:
    """Return the key of the existing number that an unknown key most likely means; empty if none is likely.

    A wrong token matches a name in its table that differs by a slip, an index the component at its place. If the table
    is missing, all are searched for the name; a single token matches the first number whose key ends with it.
    """
    tokens, root = key.split("."), Place(mechanism)
    tables = [(token, place) for token, place in root.below().items() if isinstance(place.value, Mapping)]
    for table, start in [("", root), *tables]:
        if found := next(_followed(start, tokens, exact=bool(table)), None):
            return ".".join([*filter(None, [table]), *found])
    named = (key for key, _ in settable_places(mechanism) if key.rpartition(".")[2] == tokens[-1])
    return next(named, "") if len(tokens) == 1 else ""


def _followed(place: Place, tokens: Sequence[str], *, exact: bool) -> Iterator[list[str]]:
    """Yield the path to a number below a place that resembles the tokens; with ``exact`` the first token must match."""
    if not tokens:
        if isinstance(place.value, float):
            yield []
        return
    below, token = place.below(), tokens[0]
    by_index = dict(zip(map(str, range(len(below))), below, strict=True)) if isinstance(place.value, tuple) else {}
    twins = {f"{axis}{axis}": axis for axis in "xyz"} | {name: name[::-1] for name in ("xy", "xz", "yz")}
    likely = [name for name in below if name == token or twins.get(name) == token]
    if not exact:
        likely += [name for name in (by_index.get(token), closest(token, below)) if name]
    for name in likely:
        for rest in _followed(below[name], tokens[1:], exact=False):
            yield [name, *rest]


# List the keys of a mechanism that can be set, with the value, unit, limits and meaning of each number.


@dataclass(frozen=True)
class SettableNumber:
    """A number of a mechanism that ``--set`` and the variables of a campaign can change."""

    key: str  # dotted path
    value: float  # in the file
    unit: str  # "1" for a pure number
    lower: float | None  # limit of this number by itself, as is upper; None: there is none
    upper: float | None
    limits: str  # the same in words, such as "> 0" or "> 0, <= 0.3"; empty: there are none
    expression: str  # that gives the value; empty if the file contains a number
    description: str
    short: str  # name of the joint, if it can be used instead of the key; otherwise empty
    varies: bool  # whether a variable of a campaign may set it; settings are the same for all its runs


def settable_numbers(mechanism: Mechanism, pattern: str = "") -> list[SettableNumber]:
    """Return every number of a mechanism that `set_values` and the variables of a campaign can change.

    Parameters
    ----------
    mechanism : Mechanism
        Any mechanism.
    pattern : str
        A part of the keys that are wanted, a pattern of whole keys with ``*``, ``?`` or ``[...]``, or the name of a
        joint with play.

    Returns
    -------
    list of SettableNumber
        Key, value, unit, limits and meaning of each, in the order of the tables of a mechanism file.
    """
    short = {full_key(mechanism, name): name for name in mechanism.loose_joints()}
    wanted = [(key, place) for key, place in settable_places(mechanism) if _fits(key, short.get(key, ""), pattern)]
    used = users({**mechanism.formulas, **mechanism.response_formulas()})
    return [_number(mechanism, key, place, short.get(key, ""), used) for key, place in wanted]


def _fits(key: str, short: str, pattern: str) -> bool:
    """Return whether a pattern is a part of a key, or, with ``*``, ``?`` or ``[...]``, matches all of it."""
    wanted = pattern.lower()
    if any(mark in wanted for mark in "*?["):
        return any(fnmatch.fnmatchcase(name.lower(), wanted) for name in (key, short) if name)
    return wanted in key.lower() or wanted == short.lower()


def _number(mechanism: Mechanism, key: str, place: Place, short: str, used: dict[str, list[str]]) -> SettableNumber:
    """Return the entry for one number; ``used`` maps each parameter to the keys that use it."""
    name = key.removeprefix(PREFIX) if key.startswith(PREFIX) else ""
    described = place.field.description if place.field else ""
    found = limits(place.field)
    if isinstance(place.owner, JournalJoint) and key.endswith(".radial_clearance"):
        found = {"gt": place.owner.least_clearance, "le": place.owner.clearance_limit}
    return SettableNumber(
        key=key,
        value=place.value,
        unit=_unit(mechanism, key, place),
        lower=found.get("gt", found.get("ge")),
        upper=found.get("lt", found.get("le")),
        limits=", ".join(f"{_RELATIONS[relation]} {bound:.6g}" for relation, bound in found.items()),
        expression=mechanism.formulas.get(key, ""),
        description=_use(used.get(name, [])) if name else described or "",
        short=short,
        varies=not key.startswith(SETTINGS),
    )


def _use(keys: list[str]) -> str:
    """Return a description of where a parameter is used."""
    if not keys:
        return "used on test benches only"
    others = f" and {len(keys) - 3} others" if len(keys) > 4 else ""
    return f"used in {', '.join(keys[:3] if others else keys)}{others}"
