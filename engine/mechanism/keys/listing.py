"""The list of a mechanism's keys that may be set: value, unit, limits, and what each number means."""

import fnmatch
from dataclasses import dataclass

from engine.mechanism.joints.journal import JournalJoint
from engine.mechanism.keys.components import limits
from engine.mechanism.keys.places import SETTINGS, Place, settable_places
from engine.mechanism.models import Mechanism
from engine.mechanism.parameters.formulas import PREFIX
from engine.mechanism.parameters.usage import users

_RELATIONS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


@dataclass(frozen=True)
class SettableNumber:
    """A number of a mechanism that ``--set`` and the variables of a campaign can change.

    Attributes
    ----------
    key : str
        Its dotted path.
    value : float
        Its value in the file.
    unit : str
        ``"1"`` for a pure number.
    lower, upper : float or None
        Limits of this number alone; None where there is none.
    limits : str
        The same in words, such as ``"> 0"`` or ``"> 0, <= 0.3"``; empty without limits.
    expression : str
        From which its value follows; empty if the file has a number.
    description : str
        What it means.
    short : str
        The name of the joint, if that stands for the key; otherwise empty.
    varies : bool
        Whether a variable of a campaign may set it; the settings of a simulation are the same for all its runs.
    """

    key: str
    value: float
    unit: str
    lower: float | None
    upper: float | None
    limits: str
    expression: str
    description: str
    short: str
    varies: bool


def settable_numbers(mechanism: Mechanism, pattern: str = "") -> list[SettableNumber]:
    """Return every number that may be set, in the order of the file format.

    Parameters
    ----------
    mechanism : Mechanism
    pattern : str
        A part of the keys that are wanted, or with ``*``, ``?`` or ``[...]`` a pattern of the whole key; upper and
        lower case are the same. By default all.
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
    """Return the entry of one number; ``used`` are the keys that use each parameter."""
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
    """Return where a parameter is used."""
    if not keys:
        return "used on test benches only"
    others = f" and {len(keys) - 3} others" if len(keys) > 4 else ""
    return f"used in {', '.join(keys[:3] if others else keys)}{others}"
