"""Columns of the results: one row per sample, every number with its unit."""

from collections.abc import Mapping

import pyarrow as pa

from engine.mechanism import Mechanism, unit_of
from engine.mechanism.quantities import Quantity, UnitSystem

# earlier builds did not have them
LATER_NUMBERS = (
    "max_created_energy",
    "created_energy",
    "max_lost_energy",
    "lost_energy",
    "max_kinetic_energy",
    "max_turn",
    "start_travel",
)
REMARK_COLUMNS = ("at_impact", "ambiguous")
LATER_COLUMNS = (*LATER_NUMBERS, *REMARK_COLUMNS)
CERTIFICATE_COLUMNS = (
    "sample",
    "status",
    "message",
    "steps",
    "wall_s",
    "max_residual",
    "max_penetration",
    *LATER_NUMBERS,
    "settled",
    *REMARK_COLUMNS,
    "attempts",
    "earlier_attempts",
)
_QUANTITIES = {  # of the numbers of a run's certificate that have a unit
    "time": "time",
    "wall_s": "real time",
    "max_penetration": "length",
    "max_violation": "length",
    "max_created_energy": "energy",
    "created_energy": "energy",
    "max_lost_energy": "energy",
    "lost_energy": "energy",
    "max_kinetic_energy": "energy",
    "max_turn": "angle",
    "start_travel": "length",
}

OF_SAMPLERS = {"component": pa.int64(), "log_weight": pa.float64(), "aimed": pa.bool_()}


def certificate_units(system: UnitSystem) -> dict[str, str]:
    """Return the units of the numbers of a run's certificate that have one, by name; see `engine.Certificate`."""
    return {name: Quantity(quantity).unit(system) for name, quantity in _QUANTITIES.items()}


def results_schema(
    mechanism: Mechanism, targets: Mapping[str, str], campaign_id: str, of_sampler: tuple[str, ...] = ()
) -> pa.Schema:
    """Return the schema of a campaign's table, from the key that each variable sets and the columns of its sampler."""
    units = certificate_units(mechanism.units)
    fields = [
        pa.field("sample", pa.int64(), nullable=False),
        *(_number(name, unit_of(mechanism, target), nullable=False) for name, target in targets.items()),
        *(_number(name, unit) for name, unit in mechanism.response_units().items()),
        pa.field("status", pa.string(), nullable=False),
        pa.field("message", pa.string(), nullable=False),
        pa.field("steps", pa.int64()),
        _number("wall_s", units["wall_s"]),
        _number("max_residual", "1"),
        _number("max_penetration", units["max_penetration"]),
        *(_number(name, units[name]) for name in LATER_NUMBERS),
        pa.field("settled", pa.bool_(), nullable=False),
        pa.field("at_impact", pa.string()),  # names of responses, separated by commas; see `engine.Run`
        pa.field("ambiguous", pa.bool_()),
        pa.field("attempts", pa.int64(), nullable=False),
        pa.field("earlier_attempts", pa.string(), nullable=False),
        *(pa.field(name, OF_SAMPLERS[name], nullable=False) for name in of_sampler),
    ]
    return pa.schema(fields, metadata={"format": "1", "campaign": campaign_id})


def _number(name: str, unit: str, *, nullable: bool = True) -> pa.Field:
    return pa.field(name, pa.float64(), nullable=nullable, metadata={"unit": unit})
