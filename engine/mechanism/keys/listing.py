"""List the keys of a mechanism that can be set, with the value, unit, limits and meaning of each number."""

import fnmatch
from dataclasses import dataclass

from engine.mechanism.components import limits
from engine.mechanism.joints.journal import JournalJoint
from engine.mechanism.keys.key_paths import SETTINGS, Place, settable_places
from engine.mechanism.models import Mechanism
from engine.mechanism.parameters import PREFIX, users

_RELATIONS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


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
    """Return every number that can be set, in the order of the file format.

    The pattern is a part of the wanted keys, or with ``*``, ``?`` or ``[...]`` it is one for the whole key; case is
    ignored.
    """
    short = {_clearance(mechanism, name): name for name in mechanism.loose_joints()}
    wanted = [(key, place) for key, place in settable_places(mechanism) if _fits(key, short.get(key, ""), pattern)]
    used = users(mechanism.formulas)
    return [_number(mechanism, key, place, short.get(key, ""), used) for key, place in wanted]


def _clearance(mechanism: Mechanism, joint: str) -> str:
    return f"joints.{joint}.{mechanism.joints[joint].CLEARANCE}"


def _fits(key: str, short: str, pattern: str) -> bool:
    wanted = pattern.lower()
    if any(mark in wanted for mark in "*?["):
        return any(fnmatch.fnmatchcase(name.lower(), wanted) for name in (key, short) if name)
    return wanted in key.lower() or wanted == short.lower()


def _number(mechanism: Mechanism, key: str, place: Place, short: str, used: dict[str, list[str]]) -> SettableNumber:
    """Return the entry for one number; ``used`` maps each parameter to the keys that use it."""
    name = key.removeprefix(PREFIX) if key.startswith(PREFIX) else ""
    found = limits(place.field)
    if isinstance(place.owner, JournalJoint) and key.endswith(".radial_clearance"):
        found = {"gt": 0.0, "le": place.owner.clearance_limit}
    return SettableNumber(
        key=key,
        value=place.value,
        unit=mechanism.parameter_units[name] if name else mechanism.unit_at(place),
        lower=found.get("gt", found.get("ge")),
        upper=found.get("lt", found.get("le")),
        limits=", ".join(f"{_RELATIONS[relation]} {bound:.6g}" for relation, bound in found.items()),
        expression=mechanism.formulas.get(key, ""),
        description=_use(used.get(name, [])) if name else (place.field.description or "") if place.field else "",
        short=short,
        varies=not key.startswith(SETTINGS),
    )


def _use(keys: list[str]) -> str:
    """Return a description of where a parameter is used."""
    if not keys:
        return "used on test benches only"
    others = f" and {len(keys) - 3} others" if len(keys) > 4 else ""
    return f"used in {', '.join(keys[:3] if others else keys)}{others}"
