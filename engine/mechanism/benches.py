"""Test benches and presets of a mechanism: tables that replace its own, and named sets of values."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from engine.errors import MechanismError
from engine.mechanism.base import Name, Number, TableModel, optional
from engine.mechanism.faults import did_you_mean

Table = dict[str, Any]
Tables = Annotated[dict[Name, Table], Field(default={}, description="tables that are added, or replace those here")]


class Plot(TableModel):
    """Two responses plotted against each other over the run, such as a force against a travel."""

    x: Name = Field(description="the response along the axis of abscissae")
    y: Name = Field(description="the response along the axis of ordinates")


class Preset(TableModel):
    """A named set of values."""

    title: str = Field(default="", description="what the values are")
    source: str = Field(default="", description="where they come from")
    values: dict[str, Number] = Field(description="key -> number, as they can be set")


class Bench(TableModel):
    """Tables added to a mechanism or removed from it for a test; `on_bench` checks the resulting mechanism."""

    title: str = Field(default="", description="what the test is called")
    without: tuple[str, ...] = Field(default=(), description='tables that are taken away, such as "contacts.C7"')
    plot: Plot | None = optional("two responses to draw against each other: { x, y }")
    simulation: Table = Field(default={}, description="keys of [simulation] that differ")
    phases: tuple[Table, ...] | None = optional("the parts of the run, in the place of those")
    validity: tuple[str, ...] | None = optional("the conditions, in the place of those")
    parameters: dict[Name, Any] = Field(default={}, description="parameters that are added, or replace those here")
    materials: Tables
    bodies: Tables
    joints: Tables
    couplings: Tables
    contacts: Tables
    springs: Tables
    dampers: Tables
    forces: Tables
    torques: Tables
    motions: Tables
    responses: Tables


NAMED = (
    *("materials", "bodies", "joints", "couplings", "contacts", "springs", "dampers", "forces", "torques", "motions"),
    "responses",
)


def with_bench(data: Mapping[str, Any], name: str, bench: Bench) -> dict[str, Any]:
    """Return a mechanism's plain data on a bench; raise MechanismError if that removes a table that is not there."""
    merged = {**data, "bench": name, "benches": {}, "presets": {}}
    tables = {table: dict(data.get(table, {})) for table in NAMED}
    for path in bench.without:
        table, _, entry = path.partition(".")
        if entry not in tables.get(table, {}):
            meant = did_you_mean(path, [f"{t}.{e}" for t in tables for e in tables[t]])
            text = f"{path!r}: no such table; allowed: TABLE.NAME of one that is there{meant}"
            raise MechanismError(f"benches.{name}.without = {text}")
        del tables[table][entry]
    for table in NAMED:
        tables[table].update(getattr(bench, table))
    merged |= {table: entries for table, entries in tables.items() if entries or table in data}
    if parameters := {**data.get("parameters", {}), **bench.parameters}:
        merged["parameters"] = parameters
    merged["simulation"] = {**data["simulation"], **bench.simulation}
    own = bench.model_dump(include={"title", "plot", "phases", "validity"}, exclude_unset=True)
    return merged | own
