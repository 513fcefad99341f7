"""The JSON Schema of the mechanism file, for editors and other programs."""

from typing import Any

from engine.mechanism.base import TableModel
from engine.mechanism.expression import LONGEST
from engine.mechanism.geometry.cad_table import (
    AS_DRAWN,
    DENSITY,
    GEOMETRY_OF,
    GROUPS,
    ONE_DENSITY,
    PART,
    PARTS,
    SELECTORS,
    CadTable,
)
from engine.mechanism.meshes.mesh import OF_A_BODY, MeshFile
from engine.mechanism.models import Mechanism

EXPRESSION = {
    "type": "string",
    "maxLength": LONGEST,
    "description": 'an expression over the parameters of the file, such as "arm / 2"',
}
_WITHOUT_EXPRESSIONS = ("Preset", "Bench")
_OF_THE_NUMBER = ("type", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def mechanism_schema() -> dict[str, Any]:
    """Return the JSON Schema of the mechanism file; wherever a number is allowed, an expression is too."""
    schema = Mechanism.model_json_schema(by_alias=True)
    tables = schema["$defs"]
    del schema["properties"]["geometry"], schema["properties"]["meshes"]  # written by clearcap
    for name in ("GeometryCertificate", "DrawnBody", "DrawnFace", "DrawnJoint", "DrawnGap", "MeshCertificate"):
        del tables[name]
    _add_geometry(schema)
    for name, table in tables.items():
        tables[name] = table if name in _WITHOUT_EXPRESSIONS else _or_expression(table)
    schema["properties"] = {key: _or_expression(entry) for key, entry in schema["properties"].items()}
    tables["Expression"] = EXPRESSION
    return schema


def _add_geometry(schema: dict[str, Any]) -> None:
    """Add the keys that name geometry of a CAD file in place of other keys."""
    tables = schema["$defs"]
    schema["properties"]["cad"] = _table_of(CadTable, tables)
    of_parts = {"type": "array", "items": {"type": "string"}}
    schema["properties"]["groups"] = {"type": "object", "additionalProperties": of_parts, "description": GROUPS}
    as_drawn = {"type": "string", "const": AS_DRAWN}
    tables["Body"]["properties"] |= {
        "part": {"type": "string", "description": PART},
        "parts": {"type": "array", "items": {"type": "string"}, "minItems": 1, "description": PARTS},
        "density": {
            "anyOf": [
                *ONE_DENSITY["anyOf"],
                {"type": "array", "items": ONE_DENSITY},
                {"type": "object", "additionalProperties": ONE_DENSITY},
            ],
            "description": DENSITY,
        },
        "mesh": {**_table_of(MeshFile, tables), "description": OF_A_BODY},
    }
    for kind, model in SELECTORS.items():
        selector = _table_of(model, tables)["properties"][kind]
        for name in GEOMETRY_OF[kind]:
            side = tables[name]
            own = side["properties"].get(kind)
            words = f"{own['description']}; or {selector['description']}" if own else ""
            side["properties"][kind] = {"description": words, "anyOf": [own, selector]} if own else selector
            own_keys = [key for key in side.get("required", ()) if key != "body"]
            if own_keys and "anyOf" not in side:
                side["required"] = ["body"]
                side["anyOf"] = [{"required": own_keys}, {"required": [kind]}]
    for joint in ("Revolute", "Cylindrical"):
        for key in ("radial_clearance", "rings"):
            own = tables[joint]["properties"][key]
            tables[joint]["properties"][key] = {**own, "anyOf": [*own["anyOf"], as_drawn]}


def _table_of(model: type[TableModel], tables: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a table, and add the tables it refers to to ``tables``."""
    schema = model.model_json_schema(by_alias=True)
    tables |= schema.pop("$defs", {})
    return schema


def _or_expression(part: Any) -> Any:
    """Return a part of the schema with every number replaced by the choice of a number or an expression."""
    if isinstance(part, list):
        return [_or_expression(inner) for inner in part]
    if not isinstance(part, dict):
        return part
    if part.get("type") != "number":
        return {key: _or_expression(inner) for key, inner in part.items()}
    number = {key: value for key, value in part.items() if key in _OF_THE_NUMBER}
    others = {key: value for key, value in part.items() if key not in _OF_THE_NUMBER}
    return {**others, "anyOf": [number, {"$ref": "#/$defs/Expression"}]}
