"""A chain of n links released off the vertical (`benchmarks.chain`): the step cost per link should not grow with n.

Ideal joints have bilateral rows only; a joint with clearance has two rings and friction 0.1.
"""

from time import process_time
from typing import Any

from benchmarks.chain import chain
from engine.assembly import assemble
from engine.kernels.time_loop import ITERATIONS, OK, REPEATED, STATUS, STEPS
from engine.loop import control_of, drive
from engine.mechanism import mechanism_from

LINKS = (10, 30, 100, 300, 1000)
CLEARANCES = {"ideal": 0.0, "with play": 1e-4}  # m
TIME, WALL_LIMIT = 0.05, 300.0  # s


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return a row for each kind of joint and number of links; ``unit_us`` is the reference [us]."""
    rows = []
    for kind in CLEARANCES:
        least = 0.0
        for links in LINKS:
            row = _row(kind, links)
            least = least or row["us a link"]
            rows.append({**row, "in solves": row["us a link"] / unit_us, "to 10 links": row["us a link"] / least})
    return rows


def _row(kind: str, links: int) -> dict[str, Any]:
    mechanism = mechanism_from(chain(links, CLEARANCES[kind]), "chain")
    assembly, control = assemble(mechanism), control_of(mechanism, True)._replace(horizon=TIME)
    start = process_time()  # time of this process only, without other load
    course = drive(assembly, control, WALL_LIMIT)
    steps = int(course.counts[STEPS])
    return {
        "joints": kind,
        "links": links,
        "steps": steps,
        "solved": bool(course.counts[STATUS] == OK),
        "repeated": int(course.counts[REPEATED]),
        "iterations": float(course.counts[ITERATIONS]) / steps,
        "us a link": 1e6 * (process_time() - start) / steps / links,
    }
