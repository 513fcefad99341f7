"""Synthetic campaigns, C-60-like: seven clearances, seven responses, some failures."""

from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from campaign.inputs.sampling import sampler_named
from reporting import Design, ReportSpec, ResponseSpec, VariableSpec
from reporting.analysis import Analysis, OtherSpreads, analyse
from reporting.samples import Repeats, read_samples

if TYPE_CHECKING:
    from reporting.samples import Rows

ASSUMED = "assumption of this project: no limits are published"
CLEARANCES = tuple(f"J{i}" for i in range(1, 8))


def c60_spec(requested: int) -> ReportSpec:
    x = np.linspace(0.01, 0.13, 61)
    density = np.exp(-(((x - 0.07) / 0.0175) ** 2) / 2) / (0.0175 * np.sqrt(2 * np.pi))
    text = "truncated normal, mean 0.07, sd 0.0175, on [0.01, 0.13]"
    variables = tuple(
        VariableSpec(name, "mm", text, 0.01, 0.13, 0.07, 0.0174327686281, tuple(zip(x, density, strict=True)))
        for name in CLEARANCES
    )
    responses = (
        ResponseSpec("FC-1", "contact force", "N", 9.0, 16.0, None, "Akhadkar, Acary, Brogliato 2018, section 4.2"),
        ResponseSpec("FC-2", "needle - pin, X", "mm", 10.35, 10.85, 10.6, ASSUMED),
        ResponseSpec("FC-3", "needle - pin, Y", "mm", -2.45, -1.95, -2.2, ASSUMED),
        ResponseSpec("FC-4", "needle - lamage, X", "mm", 5.05, 5.55, 5.3, ASSUMED),
        ResponseSpec("FC-5", "needle - lamage, Y", "mm", -8.05, -7.55, -7.8, ASSUMED),
        ResponseSpec("FC-6", "tripping bar - plunger", "mm", 0.2, None, None, ASSUMED),
        ResponseSpec("latch_overlap", "overlap of hook and tripping bar", "mm", None, None, None, ""),
    )
    return ReportSpec(
        title="Schneider C-60, ON position",
        campaign="c60-0123456789",
        header={"part": "C-60 1P", "author": "quality lab", "conclusion": "Fit for the pilot series."},
        responses=responses,
        variables=variables,
        provenance={"mechanism": "c60", "seed": "2018", "spec sha256": "ab" * 32, "engine build": "0123456789abcdef"},
        requested=requested,
    )


def c60_table(n: int, failures: int = 0, seed: int = 7) -> pa.Table:
    """Return n rows; the last `failures` of them failed, for changing reasons."""
    rng = np.random.default_rng(seed)
    joints = {name: np.clip(rng.normal(0.07, 0.0175, n), 0.01, 0.13) for name in CLEARANCES}
    z = {name: (column - 0.07) / 0.0175 for name, column in joints.items()}
    noise = rng.normal(size=(7, n))
    values = {
        "FC-1": 13.66 + 0.478 * (0.8 * z["J1"] + 0.6 * noise[0]),
        "FC-2": 10.58 + 0.05 * (0.6 * z["J2"] + 0.8 * noise[1]),
        "FC-3": -2.17 + 0.062 * (0.6 * z["J4"] + 0.8 * noise[2]),
        "FC-4": 5.31 + 0.1 * (0.6 * z["J4"] + 0.8 * noise[3]),
        "FC-5": -7.79 + 0.06 * (0.6 * z["J3"] + 0.8 * noise[4]),
        "FC-6": 0.36 + 0.04 * (0.8 * np.exp(0.5 * z["J7"]) + 0.2 * noise[5]),
        "latch_overlap": 0.42 + 0.03 * noise[6],
    }
    ok = np.arange(n) < n - failures
    kinds = ("not_converged", "invalid", "timeout")
    status = ["ok" if good else kinds[i % 3] for i, good in enumerate(ok)]
    message = ["" if good else f"step {1000 + i}: residual 3e-06 at contact C7" for i, good in enumerate(ok)]
    columns = {
        "sample": pa.array(np.arange(n), pa.int64()),
        **{name: pa.array(column) for name, column in joints.items()},
        **{name: pa.array(column, mask=~ok) for name, column in values.items()},
        "status": pa.array(status, pa.string()),
        "message": pa.array(message, pa.string()),
        "steps": pa.array(np.full(n, 6000), pa.int64()),
        "wall_s": pa.array(np.full(n, 0.2)),
        "max_residual": pa.array(np.where(ok, 3e-9 * rng.random(n), 3e-6)),
        "max_penetration": pa.array(8e-9 * rng.random(n)),
        "settled": pa.array(ok),
        "attempts": pa.array(np.ones(n, dtype=np.int64)),
    }
    table = pa.table(columns)
    at = table.schema.get_field_index("max_penetration")
    return table.set_column(at, table.field(at).with_metadata({"unit": "mm"}), table.column(at))


def analysis_of(
    rows: "Rows",
    spec: ReportSpec,
    spreads: OtherSpreads | None = None,
    against: "tuple[Rows, ReportSpec] | None" = None,
    repeats: Repeats | None = None,
) -> Analysis:
    """Return the analysis of a table of samples."""
    return analyse(read_samples(rows, spec), spec, spreads, against, repeats)


def repeats_of(table: pa.Table, every: int, scatter: dict[str, float], seed: int = 5) -> Repeats:
    """Return repeats of every so many samples; each response differs by the square root of 2 times its scatter."""
    rng, picked = np.random.default_rng(seed), table.take(np.arange(0, table.num_rows, every))
    values = {
        name: picked[name].to_numpy() + np.sqrt(2) * sigma * rng.normal(size=picked.num_rows)
        for name, sigma in scatter.items()
    }
    ok = np.array(picked["status"].to_pylist()) == "ok"
    remedy = "To repeat more: clearcap repeat c60-0123456789 --share 0.2"
    return Repeats(picked["sample"].to_numpy(), ok, values, picked.num_rows, remedy)


def drawn_by(sampler: str) -> dict[str, object]:
    """Return what a campaign tells a report of the samples of one of its samplers, as fields of `ReportSpec`."""
    known = sampler_named(sampler)
    return {"sampler": sampler, "design": Design(known.production, known.report), "corners": known.corners}
