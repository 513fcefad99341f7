"""The keys of the mechanism file as JSON Schema, for editors and other programs."""

from typing import Any

from engine.mechanism.models import Mechanism
from engine.mechanism.parameters.expression import LONGEST

EXPRESSION = {
    "type": "string",
    "maxLength": LONGEST,
    "description": 'an expression over the parameters of the file, such as "arm / 2"',
}
_WITHOUT_EXPRESSIONS = ("Preset", "Bench")
_OF_THE_NUMBER = ("type", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def mechanism_schema() -> dict[str, Any]:
    """Return the JSON Schema of the mechanism file; where a number is allowed, so is an expression."""
    schema = Mechanism.model_json_schema(by_alias=True)
    tables = schema["$defs"]
    for name, table in tables.items():
        tables[name] = table if name in _WITHOUT_EXPRESSIONS else _or_expression(table)
    schema["properties"] = {key: _or_expression(entry) for key, entry in schema["properties"].items()}
    tables["Expression"] = EXPRESSION
    return schema


def _or_expression(part: Any) -> Any:
    """Return a part of the schema in which an expression may stand in the place of each number."""
    if isinstance(part, list):
        return [_or_expression(inner) for inner in part]
    if not isinstance(part, dict):
        return part
    if part.get("type") != "number":
        return {key: _or_expression(inner) for key, inner in part.items()}
    number = {key: value for key, value in part.items() if key in _OF_THE_NUMBER}
    others = {key: value for key, value in part.items() if key not in _OF_THE_NUMBER}
    return {**others, "anyOf": [number, {"$ref": "#/$defs/Expression"}]}
