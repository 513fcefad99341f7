"""The form of what-if: a slider and a number for each key of each distribution, and the settings that they make."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from campaign.plan import Plan, dump_spec

FIELD = "v."  # begins the name of a number's field; what follows is VARIABLE.KEY
STEPS = 100  # of a slider
PLACES = ("mean", "nominal", "lower", "upper", "mode", "origin", "value", "log_mean")  # keys that shift, not stretch
REACH, STRETCH = 2.0, 0.8  # a slider reaches this many sigmas to each side, or this part of the value


@dataclass(frozen=True)
class KeyField:
    """A key of a distribution that can be set.

    Attributes
    ----------
    setting : str
        ``VARIABLE.KEY``.
    key : str
    now : float
        As the campaign has it.
    text : str
        As it is asked.
    low, high, step : float
        Of the slider.
    """

    setting: str
    key: str
    now: float
    text: str
    low: float
    high: float
    step: float


@dataclass(frozen=True)
class VariableFields:
    """The keys of a variable's distribution that can be set.

    Attributes
    ----------
    name, unit, distribution : str
    keys : list of KeyField
    """

    name: str
    unit: str
    distribution: str
    keys: list[KeyField]


def variable_fields(plan: Plan, settings: Sequence[str]) -> list[VariableFields]:
    """Return the fields of the variables that vary, filled with what is asked.

    Parameters
    ----------
    plan : Plan
        The campaign.
    settings : sequence of str
        What is asked, each ``VARIABLE.KEY=VALUE``.
    """
    asked = dict(setting.partition("=")[::2] for setting in settings)
    found = []
    for name, table in dump_spec(plan.spec)["variables"].items():
        sigma = plan.spec.variables[name].moments()[1]
        numbers = {key: float(x) for key, x in table.items() if isinstance(x, int | float) and not isinstance(x, bool)}
        if sigma > 0:
            unit = (plan.schema.field(name).metadata or {}).get(b"unit", b"").decode()
            keys = [_field(name, key, now, sigma, asked) for key, now in numbers.items()]
            found.append(VariableFields(name, "" if unit == "1" else unit, table["distribution"], keys))
    return found


def other_settings(fields: Iterable[VariableFields], settings: Sequence[str]) -> list[str]:
    """Return the settings that no field shows."""
    shown = {key.setting for each in fields for key in each.keys}
    return [setting for setting in settings if setting.partition("=")[0] not in shown]


def settings_of(fields: Iterable[VariableFields], given: Mapping[str, str], others: str) -> list[str]:
    """Return the settings that a sent form makes: numbers that are other ones than the campaign's, then the others.

    Parameters
    ----------
    fields : iterable of VariableFields
        The form.
    given : mapping of str to str
        Its numbers as text, by the name of the field.
    others : str
        One setting on each line.
    """
    changed = []
    for key in (key for each in fields for key in each.keys):
        text = given.get(f"{FIELD}{key.setting}", "").strip()
        if text and not _is_equal(text, key.now):
            changed.append(f"{key.setting}={text}")
    return changed + [line.strip() for line in others.splitlines() if line.strip()]


def _field(name: str, key: str, now: float, sigma: float, asked: Mapping[str, str]) -> KeyField:
    """Return the field of a key; its slider has the present value in its middle."""
    half = REACH * sigma if key in PLACES or now == 0 else STRETCH * abs(now)
    text = asked.get(f"{name}.{key}", repr(now))
    return KeyField(f"{name}.{key}", key, now, text, now - half, now + half, 2 * half / STEPS)


def _is_equal(text: str, now: float) -> bool:
    """Return whether a text is a number, and this one."""
    try:
        return float(text) == now
    except ValueError:
        return False
