"""A summary of a mechanism as plain data, and what looks wrong in it, for the terminal and for pages."""

from typing import Any

from campaign.compiling import compile_engine
from engine import check, set_values
from engine.mechanism import Mechanism, get_value, unit_of
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import FreeFormSurface
from engine.preflight import cautions


def mechanism_summary(mechanism: Mechanism) -> dict[str, Any]:
    """Return the contents of a mechanism: inputs with value and unit, responses, validity conditions.

    Keys: ``name``, ``title``, ``description``, ``units``, ``digest``; the numbers of ``bodies``, ``moving_bodies``,
    ``joints`` and ``contacts``; ``parameters`` and ``clearances`` by name, each with ``value`` and ``unit``;
    ``responses`` by name, each with ``title`` and ``unit``; ``validity``; titles of ``benches`` and ``presets``.
    """
    units = mechanism.response_units()
    return {
        "name": mechanism.name,
        "title": mechanism.title,
        "description": mechanism.description.strip(),
        "units": mechanism.units,
        "digest": mechanism.digest(),
        "bodies": len(mechanism.bodies),
        "moving_bodies": sum(not body.fixed for body in mechanism.bodies.values()),
        "joints": len(mechanism.joints),
        "contacts": len(mechanism.contacts),
        "parameters": {
            name: {"value": value, "unit": mechanism.parameter_units[name]}
            for name, value in mechanism.parameters.items()
        },
        "clearances": {
            name: {"value": get_value(mechanism, name), "unit": unit_of(mechanism, name)}
            for name in mechanism.loose_joints()
        },
        "responses": {
            name: {"title": response.title, "unit": units[name]} for name, response in mechanism.responses.items()
        },
        "validity": [str(condition) for condition in mechanism.validity],
        "benches": {name: bench.title for name, bench in mechanism.benches.items()},
        "presets": {name: preset.title for name, preset in mechanism.presets.items()},
    }


def converted_surfaces(mechanism: Mechanism) -> dict[str, dict[str, Any]]:
    """Return the number of ``patches`` for each contact with B-splines, the conversion ``error`` and its ``unit``."""
    found = {name: contact.sides[1].primitive for name, contact in mechanism.contacts.items()}
    splines = {name: shape for name, shape in found.items() if isinstance(shape, FreeFormSurface) and not shape.patches}
    unit = Quantity("length").unit(mechanism.units)
    return {
        name: {"patches": len(shape.top), "error": shape.conversion_error, "unit": unit}
        for name, shape in splines.items()
    }


def mechanism_warnings(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Check the start of a mechanism, including on its test benches and with its presets; return what looks wrong.

    Each caution comes once, as plain data, with its ``text`` and with ``where``: the bench or preset, empty for
    neither. Raises EngineError if the mechanism cannot start, for example because parts overlap.
    """
    compile_engine()
    variants = {"": mechanism, **{f"bench {name}": mechanism.on_bench(name) for name in mechanism.benches}}
    variants |= {f"preset {name}": set_values(mechanism, mechanism.preset(name)) for name in mechanism.presets}
    warnings: dict[str, dict[str, Any]] = {}
    for where, variant in variants.items():
        check(variant)
        for caution in cautions(variant):
            warnings.setdefault(str(caution), {**caution.to_json(), "where": where, "text": str(caution)})
    return [*warnings.values()]
