"""The what-if form: a slider and a number for each key of each distribution, and the settings of a sent form."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from campaign.plan import Plan, dump_spec

FIELD = "v."  # prefix of the name of a number's field, before VARIABLE.KEY
STEPS = 100  # steps of a slider
PLACES = ("mean", "nominal", "lower", "upper", "mode", "origin", "value", "log_mean")  # keys of location, not of scale
REACH, STRETCH = 2.0, 0.8  # reach of a slider to each side: sigmas for keys of location, share of the value for others


@dataclass(frozen=True)
class KeyField:
    """A key of a distribution that can be set."""

    setting: str  # ``VARIABLE.KEY``, without ``=VALUE``
    key: str
    now: float  # value in the campaign
    text: str  # value in the question
    low: float  # end of the slider, as is `high`
    high: float
    step: float


@dataclass(frozen=True)
class VariableFields:
    """The keys of a variable's distribution that can be set."""

    name: str
    unit: str
    distribution: str
    keys: list[KeyField]


def variable_fields(plan: Plan, settings: Sequence[str]) -> list[VariableFields]:
    """Return the fields of the variables with a nonzero sigma, filled with the settings of a question."""
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
    """Return the settings of a sent form: those of numbers that differ from the campaign's, then the others.

    `given` has the texts of the numbers, by the name of the field; `others` has one setting on each line.
    """
    changed = []
    for key in (key for each in fields for key in each.keys):
        text = given.get(f"{FIELD}{key.setting}", "").strip()
        if text and not _is_equal(text, key.now):
            changed.append(f"{key.setting}={text}")
    return changed + [line.strip() for line in others.splitlines() if line.strip()]


def _field(name: str, key: str, now: float, sigma: float, asked: Mapping[str, str]) -> KeyField:
    """Return the field of a key, with the present value in the middle of its slider."""
    half = REACH * sigma if key in PLACES or now == 0 else STRETCH * abs(now)
    text = asked.get(f"{name}.{key}", repr(now))
    return KeyField(f"{name}.{key}", key, now, text, now - half, now + half, 2 * half / STEPS)


def _is_equal(text: str, now: float) -> bool:
    """Return whether a text is a number equal to `now`."""
    try:
        return float(text) == now
    except ValueError:
        return False
