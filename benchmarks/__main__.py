"""`python -m benchmarks`: measure, print tables, write the numbers as JSON."""

import argparse
import json
from collections.abc import Sequence
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
    first_use,
    friction,
    gaps,
    heaps,
    machine,
    overhead,
    report,
    web_answers,
    web_load,
)
from engine import warm_up

PARTS = (
    *("friction", "hard", "heaps", "c60", "chain", "campaign", "overhead", "report", "first_use", "siconos"),
    *("builds", "web_answers", "web_load", "gaps", "surfaces"),
)


def main() -> None:
    """Measure the requested parts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"any of {', '.join(PARTS)}; default: all")
    parser.add_argument("--out", type=Path, default=Path("build/benchmarks.json"), help="default: %(default)s")
    asked = parser.parse_args()
    unknown = set(asked.parts) - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}; allowed: {', '.join(PARTS)}")
    parts = asked.parts or PARTS
    console = Console(width=130)
    warm_up()  # compilation is not to be measured
    numbers: dict[str, Any] = {"machine": machine.description()}
    unit = numbers["machine"]["solve_42_us"]
    _show(console, "machine", [numbers["machine"]])
    if "friction" in parts:
        numbers["friction"] = friction.measure(unit)
        _show(console, "friction solver, medians", numbers["friction"])
    if "hard" in parts:
        numbers["hard"] = friction.measure_hard()
        _show(
            console, "friction problems made to be hard, from nothing and from a neighbour's impulses", numbers["hard"]
        )
    if "heaps" in parts:
        numbers["heaps"] = heaps.measure()
        _show(console, "the friction problem of a step of a heap", numbers["heaps"])
    if "c60" in parts:
        numbers["c60"] = c60.measure(unit)
        _show(console, "c60, one run after the other, medians", [numbers["c60"]])
        numbers["c60_parts"] = c60.measure_parts(unit)
        _show(console, "c60, processor time of the parts of a run, medians", numbers["c60_parts"])
    if "chain" in parts:
        numbers["chain"] = chain.measure(unit)
        _show(console, "chain of n links, processor time of a step a link", numbers["chain"])
    if "campaign" in parts:
        numbers["campaign"] = campaign.measure()
        _show(console, "clearcap run against bare processes", [numbers["campaign"]])
    if "overhead" in parts:
        numbers["overhead"] = overhead.measure()
        _show(console, "clearcap with runs that take no time", [numbers["overhead"]])
    if "report" in parts:
        numbers["report"] = report.measure()
        _show(console, "report of made-up samples, processes of their own", numbers["report"])
    if "first_use" in parts:
        numbers["first_use"] = first_use.measure(unit)
        _show(console, "first use, processes of their own", numbers["first_use"])
    if "siconos" in parts:
        numbers["siconos"] = against_siconos.measure()
        _show(console, "friction solver against Siconos, from nothing, medians", numbers["siconos"])
        numbers["siconos_motions"] = against_siconos.measure_motions()
        _show(console, "whole motions against Siconos' time stepping, m or rad", numbers["siconos_motions"])
    if "builds" in parts:
        costs, moved = builds.measure()
        numbers["builds"] = {"costs": costs, "responses": moved}
        _show(console, "c60, the same samples by two builds", costs)
        _show(console, "c60, their responses", moved)
    if "web_answers" in parts:
        numbers["web_answers"] = web_answers.measure(unit)
        _show(console, "answers of the service", numbers["web_answers"])
    if "web_load" in parts:
        figures, facts = web_load.measure()
        numbers["web_load"] = {"figures": figures, "facts": facts}
        _show(console, "the service under load", figures)
        _show(console, "the service under load, the whole run", [facts])
    if "gaps" in parts:
        numbers["gaps"] = gaps.measure(unit)
        _show(console, "a query of a contact's gap, point and frame", numbers["gaps"])
    if "surfaces" in parts:
        numbers["surfaces"] = gaps.measure_surfaces()
        _show(console, "gaps on surfaces of patches beside closed forms, processor time of one", numbers["surfaces"])
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    asked.out.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    console.print(f"written to {asked.out}")


def _show(console: Console, title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print rows as a table: several as lines, a single row as a column."""
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
