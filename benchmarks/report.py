"""The cost of a report: of the paper's campaign, and of a million samples that do not fit into memory at once.

Each report is written by a separate process, so that time and memory include everything: imports, the samples
(synthetic instead of from a store), the page, the workbook, the JSON.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import ROOT

PIECE = 50_000  # rows at a time, as from a store
SIZES = (30_850, 1_000_000)
RESPONSES = 6


def measure() -> list[dict[str, Any]]:
    """Return time [s], processor time [s], memory [MiB] and the size of the page [MB] of reports of 6 responses."""
    # ``making_s`` is the part of the time spent on making the samples.
    return [report_of(samples) for samples in SIZES]


def report_of(samples: int) -> dict[str, Any]:
    """Return the cost of one report; see `measure`."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        command = [sys.executable, "-m", "benchmarks.report", str(samples), folder]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def main() -> None:
    """Write a report and print its cost; the arguments are the number of samples and the folder."""
    from collections.abc import Iterator
    from dataclasses import replace
    from time import perf_counter, process_time

    import numpy as np
    import pyarrow as pa

    from benchmarks.machine import most_memory_mib
    from reporting import write_report
    from reporting.samples import AMBIGUOUS, AT_IMPACT, LATER
    from tests.reporting.synthetic import c60_spec, c60_table

    samples, folder = int(sys.argv[1]), Path(sys.argv[2])
    spec, making = c60_spec(samples), 0.0

    def pieces() -> Iterator[pa.Table]:
        nonlocal making
        for first in range(0, samples, PIECE):
            start = perf_counter()
            count = min(PIECE, samples - first)
            numbers = pa.array(range(first, first + count), pa.int64())
            table = c60_table(count, count // 1000, seed=first).set_column(0, "sample", numbers)
            for name in LATER:
                table = table.append_column(name, pa.array(np.full(count, 0.01)))
            table = table.append_column(AT_IMPACT, pa.array([""] * count))
            table = table.append_column(AMBIGUOUS, pa.array(np.zeros(count, bool)))
            making += perf_counter() - start
            yield table

    start = perf_counter()
    spec = replace(spec, responses=spec.responses[:RESPONSES], ordered=False)  # as a campaign's samples
    written = write_report(pieces(), spec, folder)
    figures = {
        "samples": samples,
        "responses": RESPONSES,
        "variables": len(spec.variables),
        "wall_s": perf_counter() - start,
        "making_s": making,
        "processor_s": process_time(),
        "memory_MiB": most_memory_mib(),
        "page_MB": Path(written["html"]).stat().st_size / 1e6,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
