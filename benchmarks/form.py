"""What the form of a bore or pin costs: a chain of links on rings that are oval, lobed or elastic, beside round ones.

All are measured in turns in one process, so that other load on the machine meets them alike.
"""

from time import process_time
from typing import Any

from benchmarks.chain import chain
from engine.assembly import Assembly, assemble
from engine.kernels.time_loop import ITERATIONS, OK, STATUS, STEPS
from engine.loop import control_of, drive
from engine.mechanism import Mechanism, mechanism_from

LINKS, ROUNDS, TIME, WALL_LIMIT = 10, 5, 0.1, 300.0  # time in s
HEIGHT = 2e-5  # m of the lobes, a fifth of the clearance
SIDES: dict[str, dict[str, dict[str, Any]]] = {
    "round": {},
    "oval bore": {"bearing": {"lobes": {"number": 2, "height": HEIGHT}}},
    "bore with three lobes": {"bearing": {"lobes": {"number": 3, "height": HEIGHT}}},
    "oval bore and pin": {side: {"lobes": {"number": 2, "height": HEIGHT}} for side in ("bearing", "journal")},
}
ELASTIC = {"ring_stiffness": 1e7, "ring_damping": 100.0}  # N/m, N s/m of each ring


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return a row for each form of the rings; ``unit_us`` is the reference [us]."""
    tables = {name: _with(sides, {}) for name, sides in SIDES.items()} | {"elastic": _with({}, ELASTIC)}
    made = {name: mechanism_from(each, "chain") for name, each in tables.items()}
    rows: dict[str, dict[str, Any]] = {}
    for _ in range(ROUNDS):
        for name, mechanism in made.items():
            row = _row(name, mechanism)
            if name not in rows or row["us a step"] < rows[name]["us a step"]:
                rows[name] = row
    least = rows["round"]["us a step"]
    return [
        {**row, "in solves": row["us a step"] / unit_us, "to round": row["us a step"] / least} for row in rows.values()
    ]


def _with(sides: dict[str, dict[str, Any]], keys: dict[str, Any]) -> dict[str, Any]:
    """Return the chain with more keys in the sides of its joints, and in the joints themselves."""
    tables = chain(LINKS)
    for joint in tables["joints"].values():
        joint |= {side: joint[side] | more for side, more in sides.items()} | keys
    return tables


def _row(name: str, mechanism: Mechanism) -> dict[str, Any]:
    assembly: Assembly = assemble(mechanism)
    control = control_of(mechanism, True)._replace(horizon=TIME)
    start = process_time()
    course = drive(assembly, control, WALL_LIMIT)
    steps = int(course.counts[STEPS])
    return {
        "rings": name,
        "contacts": len(assembly.contact_names),
        "steps": steps,
        "solved": bool(course.counts[STATUS] == OK),
        "iterations": float(course.counts[ITERATIONS]) / steps,
        "us a step": 1e6 * (process_time() - start) / steps,
    }
