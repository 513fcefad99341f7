"""`python -m benchmarks`: measure, print tables, write the numbers as JSON."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks import (
    against_siconos,
    builds,
    c60,
    campaign,
    chain,
    coordinator,
    first_use,
    form,
    friction,
    gaps,
    heaps,
    machine,
    peers,
    report,
    scheduler,
    web_answers,
    web_load,
)
from engine import warm_up

# What each part measures, from the reference [us], by the key of its numbers.
PARTS: dict[str, dict[str, Callable[[float], Any]]] = {
    "friction": {"friction": friction.measure},
    "hard": {"hard": lambda _: friction.measure_hard()},
    "heaps": {"heaps": lambda _: heaps.measure()},
    "c60": {"c60": c60.measure, "c60_parts": c60.measure_parts},
    "chain": {"chain": chain.measure},
    "form": {"form": form.measure},
    "campaign": {"campaign": lambda _: campaign.measure()},
    "overhead": {"overhead": lambda _: campaign.measure_overhead()},
    "coordinator": {"coordinator": lambda _: coordinator.measure()},
    "scheduler": {"scheduler": lambda _: scheduler.measure()},
    "report": {"report": lambda _: report.measure()},
    "first_use": {"first_use": first_use.measure},
    "siconos": {
        "siconos": lambda _: against_siconos.measure(),
        "siconos_motions": lambda _: against_siconos.measure_motions(),
    },
    "peers": {"peers": lambda _: peers.measure()},
    "builds": {"builds": lambda _: builds.measure()},
    "web_answers": {"web_answers": web_answers.measure},
    "web_load": {"web_load": lambda _: web_load.measure()},
    "gaps": {"gaps": gaps.measure},
    "surfaces": {"surfaces": lambda _: gaps.measure_surfaces()},
}
# Titles of the tables; several tables of one measurement have their own, by the key of their numbers.
TITLES: dict[str, str | dict[str, str]] = {
    "friction": "friction solver, medians",
    "hard": "friction problems made to be hard, from nothing and from a neighbour's impulses",
    "heaps": "the friction problem of a step of a heap",
    "c60": "c60, one run after the other, medians",
    "c60_parts": "c60, processor time of the parts of a run, medians",
    "chain": "chain of n links, processor time of a step a link",
    "form": "a chain of ten links on rings of other forms, processor time of a step",
    "campaign": "clearcap run against bare processes",
    "overhead": "clearcap with runs that take no time",
    "coordinator": "a coordinator of workers by a clock, on a store that answers in 20 ms",
    "scheduler": "a dask scheduler of workers that answer at once, processor time",
    "report": "report of made-up samples, processes of their own",
    "first_use": "first use, processes of their own",
    "siconos": "friction solver against Siconos, from nothing, medians",
    "siconos_motions": "whole motions against Siconos' time stepping, m or rad",
    "peers": {
        "rows": "other programs: a row that takes no time, processor time",
        "starts": "other programs: import, model and a step, processes of their own",
        "heaps": "other programs: the first step of a heap, from nothing",
        "motions": "other programs: mean error over the instants, to the program's own finer step",
        "equal": "other programs: time at equal error",
    },
    "builds": {"costs": "c60, the same samples by two builds", "responses": "c60, their responses"},
    "web_answers": "answers of the service",
    "web_load": {"figures": "the service under load", "facts": "the service under load, the whole run"},
    "gaps": "a query of a contact's gap, point and frame",
    "surfaces": "gaps on surfaces of patches beside closed forms, processor time of one",
}


def main() -> None:
    """Measure the requested parts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"any of {', '.join(PARTS)}; default: all")
    parser.add_argument("--out", type=Path, default=Path("build/benchmarks.json"), help="default: %(default)s")
    asked = parser.parse_args()
    unknown = set(asked.parts) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}; allowed: {', '.join(PARTS)}")
    console = Console(width=130)
    warm_up()  # compilation is not to be measured
    numbers: dict[str, Any] = {"machine": machine.description()}
    unit = numbers["machine"]["solve_42_us"]
    _show(console, "machine", numbers["machine"])
    for part, measurements in PARTS.items():
        for key, measure in measurements.items() if part in (asked.parts or PARTS) else ():
            numbers[key], titles = measure(unit), TITLES[key]
            if isinstance(titles, str):
                _show(console, titles, numbers[key])
            else:
                for name, title in titles.items():
                    _show(console, title, numbers[key][name])
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    asked.out.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    console.print(f"written to {asked.out}")


def _show(console: Console, title: str, rows: list[dict[str, Any]] | dict[str, Any]) -> None:
    """Print rows as a table: several as lines, a single row as a column."""
    rows = [rows] if isinstance(rows, dict) else rows
    table = Table(title=title, title_justify="left", min_width=40)
    if len(rows) == 1:
        table.show_header = False
        table.add_column()
        table.add_column(justify="right")
        for name, value in rows[0].items():
            table.add_row(name, _text(value))
    else:
        for name in rows[0]:
            table.add_column(name, justify="right")
        for row in rows:
            table.add_row(*map(_text, row.values()))
    console.print(table)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
