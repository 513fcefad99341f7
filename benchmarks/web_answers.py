"""The cost of the service's answers: what-if of the paper's campaign and of a million synthetic samples.

The samples follow the C-60's campaign with its seven variables; the ten responses are sums of them with noise.
Each figure is processor time, with its bound and the used share of the bound.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa

from benchmarks import ROOT
from campaign.inputs.sampling import draw
from campaign.plan import Plan, make_plan
from campaign.spec.load import Campaign, load_campaign
from campaign.store import Store, open_store
from campaign.store.layout import PLAN
from clearcap.questions.exported_rows import RowSelection, export_rows
from clearcap.questions.mechanisms import MechanismSource, simulate_once
from clearcap.web.jobs.pool import JobPool
from clearcap.web.jobs.process import job_environment
from clearcap.web.jobs.queries import (
    AskedRows,
    QueryService,
    advice_answer,
    histogram_answer,
    rows_version,
    what_if_answer,
)
from engine import warm_up
from engine.platform.private_folder import private_folder

PAPERS, MILLION = 30_850, 1_000_000
SETTINGS = ("J1.std=0.016", "J2.std=0.016")
REPEATS = 5
KEPT_QUESTIONS = 1000


def measure(unit_us: float) -> list[dict[str, Any]]:
    """Return the processor time of each answer [ms], its bound, and its ratio to a reference [us]."""
    # The answers are computed by a process with the environment of the service's computing processes.
    command = [sys.executable, "-m", "benchmarks.web_answers"]
    # The service's processes do not import from the current folder; this one must, to find `benchmarks`.
    environment = {**job_environment(), "PYTHONSAFEPATH": ""}
    done = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    return [{**row, "in_solves": 1e3 * row["processor_ms"] / unit_us} for row in json.loads(done.stdout)]


def main() -> None:
    """Print the cost of each answer as JSON."""
    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        root = Path(folder)
        store, folder_of_columns = open_store(str(root / "runs")), private_folder(root / "cache", "columns")
        loaded = load_campaign("c60")
        papers, million = (made_up_campaign(store, loaded, *size) for size in ((PAPERS, 100), (MILLION, 100_000)))
        small, large = (_asked(store, plan, folder_of_columns) for plan in (papers, million))
        rows = [
            _first("what if of 30,850 rows x 10 responses, the first (309 parts)", small, None),
            _next("the next", lambda n: what_if_answer(small, _settings(n), False), 60.0),
            _next("a histogram", lambda n: histogram_answer(small, "FC-1", _settings(n), False), None),
            _next("advice", lambda _: advice_answer(small), None, repeats=1),
            _first("what if of 1,000,000 rows x 10 responses, the first (compacted)", large, 3000.0),
            _next("the next", lambda n: what_if_answer(large, _settings(n), False), None),
            _next("a preview", lambda n: what_if_answer(large, _settings(n), True), None),
            _next("rows as CSV, two columns of a million", lambda _: _exported(store, million), None, repeats=1),
            *asyncio.run(_served(store, papers, folder_of_columns)),
        ]
    print(json.dumps(rows))


def _asked(store: Store, plan: Plan, folder: Path) -> AskedRows:
    """Return the reference to the rows of a campaign."""
    return AskedRows(store.url, plan.campaign_id, rows_version(store, plan.campaign_id), str(folder))


def _settings(number: int) -> tuple[str, ...]:
    """Return settings that have not been requested before."""
    return (*SETTINGS, f"J3.std={0.0160 + 0.0001 * number:.4f}")


def figure_row(what: str, seconds: float, bar_ms: float | None) -> dict[str, Any]:
    """Return a row of the table."""
    milliseconds = 1e3 * seconds
    share = "" if bar_ms is None else milliseconds / bar_ms
    return {"what": what, "processor_ms": milliseconds, "bar_ms": bar_ms or "", "share_of_bar": share}


def _first(what: str, rows: AskedRows, bar_ms: float | None) -> dict[str, Any]:
    """Return the cost of the first question to a campaign: reading its rows, writing its columns, the answer."""
    start = process_time()
    what_if_answer(rows, SETTINGS, False)
    return figure_row(what, process_time() - start, bar_ms)


def _next(what: str, ask: Callable[[int], object], bar_ms: float | None, repeats: int = REPEATS) -> dict[str, Any]:
    """Return the median cost of a further question to a campaign."""
    taken = []
    for number in range(repeats):
        start = process_time()
        ask(number)
        taken.append(process_time() - start)
    return figure_row(what, float(np.median(taken)), bar_ms)


def _exported(store: Store, plan: Plan) -> None:
    """Read an export completely."""
    for _ in export_rows(store, plan, "csv", RowSelection(("sample", "FC-1"))):
        pass


async def _served(store: Store, plan: Plan, folder: Path) -> list[dict[str, Any]]:
    """Return the cost in the serving process, and the time of a run in a warm process."""
    async with JobPool(1, warm_up=warm_up) as pool:
        answers = QueryService(pool, store, folder)
        await answers.ask("bench", what_if_answer, [plan.campaign_id], SETTINGS, False)
        start = process_time()
        for _ in range(KEPT_QUESTIONS):
            await answers.ask("bench", what_if_answer, [plan.campaign_id], SETTINGS, False)
        kept = (process_time() - start) / KEPT_QUESTIONS
        start = process_time()
        for number in range(REPEATS):
            await answers.ask("bench", what_if_answer, [plan.campaign_id], _settings(number + 50), False)
        passed_on = (process_time() - start) / REPEATS
        begun = perf_counter()
        await pool.run("bench", simulate_once, MechanismSource("c60"))
        run = perf_counter() - begun
    return [
        figure_row("an answer that is kept", kept, 1.0),
        figure_row("passing a question on to a process, in the one that serves", passed_on, None),
        figure_row("the first run of the C-60 in a warm process (time of the clock)", run, 2000.0),
    ]


def made_up_campaign(store: Store, loaded: Campaign, samples: int, batch: int, name: str = "") -> Plan:
    """Write a campaign that imitates another, with `batch` rows in a file and their manifest; return its plan."""
    # Its name is by default derived from the number of rows.
    named = {"samples": samples, "name": name or f"{loaded.spec.name}-{samples}", "stop": None}
    plan = make_plan(replace(loaded, spec=loaded.spec.model_copy(update=named)), batch)
    with patch("os.fsync"):  # durability is not needed, and fsync would take most of the time
        store.files.write(f"{plan.campaign_id}/{PLAN}", plan.to_json().encode())  # `create_plan` would also check it
        parts = [
            store.write_part(plan, number, _made_up_rows(plan, first, count))
            for number, (first, count) in enumerate(plan.batches)
        ]
        store.record(plan, parts)
    return plan


def _made_up_rows(plan: Plan, first: int, count: int) -> pa.Table:
    """Return synthetic rows."""
    variables = draw(plan.spec, first, count)
    scaled = [(x - x.mean()) / (x.std() or 1.0) for x in variables.values()]
    rng = np.random.default_rng(first)
    columns: dict[str, Any] = {"sample": np.arange(first, first + count), **variables}
    for number, name in enumerate(plan.mechanism.responses):
        limits = plan.spec.responses[name].limits()[:2] if name in plan.spec.responses else (None, None)
        low, high = (side if side is not None else end for side, end in zip(limits, (0.0, 10.0), strict=True))
        spread = sum(x * (1 + (number + k) % 3) for k, x in enumerate(scaled)) + rng.standard_normal(count)
        columns[name] = (low + high) / 2 + (high - low) / 50 * spread
    constants = {"status": "ok", "message": "", "earlier_attempts": "", "settled": True, "steps": 80, "attempts": 1}
    for name in plan.schema.names:
        columns.setdefault(name, np.full(count, constants.get(name, 1e-9)))
    return pa.table({name: pa.array(columns[name]) for name in plan.schema.names}).cast(plan.schema)


if __name__ == "__main__":
    main()
