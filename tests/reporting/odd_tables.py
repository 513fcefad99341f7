"""Random tables that no campaign should have: `python -m tests.reporting.odd_tables SEED COUNT` prints each failure.

A table ends in files without NaN and infinity, or is refused with a ReportError; anything else is a fault. A timer of
processor time ends the process with a traceback if one table takes more than `LONGEST`, even inside a library.
"""

import faulthandler
import json
import math
import signal
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np
import pyarrow as pa

from reporting import ReportError, ReportSpec, ResponseSpec, VariableSpec, write_report

LONGEST = 120.0  # s of processor time
ROWS = (0, 1, 2, 3, 5, 19, 20, 31, 60, 150, 400)


def column(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return a column: a usual shape, at a usual or odd scale, with a usual or odd fault."""
    z = (
        rng.normal(size=n),
        rng.standard_t(3, size=n),
        rng.exponential(size=n),
        np.full(n, 5.0),
        np.linspace(0.0, 1.0, n),
        np.round(rng.normal(size=n)),
        np.where(rng.random(n) < 0.99, 0.0, rng.normal(size=n)),
        (rng.random(n) < 0.5).astype(float),
    )[rng.integers(8)]
    z = z * 10.0 ** rng.choice([0, 0, 0, 0, 3, -6, 20, 50, 60, 200, 308, -200, -310])
    with np.errstate(over="ignore"):
        z = z + rng.choice([0.0, 0.0, 0.0, 1.0, 1e9, -1e6, 2.0**60])
    fault = rng.integers(8)
    if n and fault == 0:
        z[rng.integers(n)] = rng.choice([np.nan, np.inf, -np.inf])
    elif n and fault == 1:
        z[-1] += rng.choice([1e-9, 1e-6, 1.0, 1e6])
    elif fault == 2:
        z[rng.random(n) < 0.3] = np.nan
    elif fault == 3:
        z = rng.choice(z, size=n) if n else z
    return z


def odd_table(seed: int) -> tuple[pa.Table, ReportSpec]:
    """Return a table and its request."""
    rng = np.random.default_rng((17, seed))
    n = int(rng.choice(ROWS))
    inputs = {f"x{i}": column(rng, n) for i in range(rng.integers(4))}
    outputs = {f"y{i}": column(rng, n) for i in range(rng.integers(1, 4))}
    if inputs and rng.random() < 0.5:
        with np.errstate(all="ignore"):
            outputs["y0"] = sum(inputs.values()) + 0.1 * outputs["y0"]
    responses = []
    for name, y in outputs.items():
        known = y[np.isfinite(y)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        middle, half = low / 2 + high / 2, high / 2 - low / 2
        with np.errstate(all="ignore"):
            reach = half * rng.choice([1.0, 1.5, 3.0, 0.5, 1e-9, 1e3]) or 1.0
            lsl, usl = (float(middle + sign * reach) for sign in (-1, 1))
        limits = [limit if rng.random() < 0.7 and math.isfinite(limit) else None for limit in (lsl, usl)]
        responses.append(ResponseSpec(name, "", "1", *limits, None, "odd"))
    variables = tuple(VariableSpec(name, "1", "normal", None, None, 0.0, 1.0, ()) for name in inputs)
    kinds = [pa.float64(), pa.float64(), pa.float64(), pa.int64(), pa.float32(), pa.bool_()]

    def as_column(x: np.ndarray) -> pa.Array:
        kind = kinds[rng.integers(len(kinds))]
        try:
            return pa.array(x).cast(kind)
        except pa.ArrowInvalid:
            return pa.array(x)

    ok = rng.random(n) < rng.choice([1.0, 1.0, 0.9, 0.0])
    table = pa.table(
        {
            "sample": pa.array(np.arange(n)),
            "status": pa.array(np.where(ok, "ok", "not_converged").tolist(), pa.string()),
            "message": pa.array([""] * n, pa.string()),
            **{name: as_column(x) for name, x in (inputs | outputs).items()},
            "max_residual": pa.array(np.full(n, 1e-9)),
            "max_penetration": pa.array(np.full(n, 1e-9)),
            "settled": pa.array(np.ones(n, np.bool_)),
        }
    )
    return table, ReportSpec("Odd", "odd", {}, tuple(responses), variables, {}, max(n, 1))


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} in the JSON")


def main(first: int, count: int) -> int:
    """Report on some tables; return the number of faults."""
    faults = 0
    faulthandler.register(signal.SIGPROF, chain=True)  # what the signal does by default ends the process
    for seed in range(first, first + count):
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        print(f"table {seed}", file=sys.stderr, flush=True)
        try:
            table, spec = odd_table(seed)
            with tempfile.TemporaryDirectory() as folder:
                files = write_report(table, spec, Path(folder), kinds=("html", "json"))
                json.loads(Path(files["json"]).read_text(), parse_constant=_refuse)
        except ReportError:
            pass
        except Exception:
            faults += 1
            last = traceback.format_exc().splitlines()
            print(f"table {seed}: {last[-1]}\n" + "\n".join(last[-9:-1]), flush=True)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return faults


if __name__ == "__main__":
    sys.exit(bool(main(int(sys.argv[1]), int(sys.argv[2]))))
