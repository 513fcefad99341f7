"""The description of a mechanism, read from a TOML file and checked, and the mechanisms shipped with clearcap."""

from engine.mechanism.keys.schema import mechanism_schema
from engine.mechanism.keys.values import full_key, get_value, set_values, settable_keys, unit_of
from engine.mechanism.load import library_names, load_mechanism, load_mechanism_text
from engine.mechanism.models import Mechanism, mechanism_from

__all__ = [
    "Mechanism",
    "full_key",
    "get_value",
    "library_names",
    "load_mechanism",
    "load_mechanism_text",
    "mechanism_from",
    "mechanism_schema",
    "set_values",
    "settable_keys",
    "unit_of",
]
