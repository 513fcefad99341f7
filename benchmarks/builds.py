"""The same samples of the C-60 with this build and with an earlier one, alternately, in separate processes.

`python -m benchmarks builds` checks out the earlier commit, compiles both builds, and lets them simulate twenty samples
alternately, so that other load on the machine affects both equally. This build also simulates the samples with the
settling of the earlier build, free fall: differences are then due to the solver alone.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import mean, median, stdev
from typing import Any

from benchmarks import ROOT

BEFORE = "798d972"  # the build before the solver of 6 x 6 blocks and the settling under drag
BLOCK, BLOCKS = 20, 5
SECONDS = 1800
RESPONSES = ("FC-1", "FC-2", "FC-3", "FC-4", "FC-5", "FC-6")
# the program of a process of either build: it runs samples of a campaign from a number on, one JSON line per sample
RUNS = f"""
import json, sys, time
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.worker.row import sample_values
from engine import simulate
plan, first = make_plan(load_campaign(sys.argv[1])), int(sys.argv[2])
mechanism = plan.mechanism
simulate(mechanism, sample_values(plan, first))
for sample in range(first, first + {BLOCK}):
    values, before = sample_values(plan, sample), time.process_time()
    run = simulate(mechanism, values)
    spent, c = time.process_time() - before, run.certificate
    row = dict(ms=1e3 * spent, loop_ms=1e3 * c.wall_s, steps=c.steps, iterations=c.iterations, ok=run.status == "ok")
    print(json.dumps(row | dict(residual=c.max_residual, penetration=c.max_penetration, responses=run.responses)))
"""


def measure() -> dict[str, list[dict[str, Any]]]:
    """Return the cost of a run with both builds, and their responses."""
    with tempfile.TemporaryDirectory(prefix="clearcap-before-") as folder:
        before = Path(folder) / "before"
        _git("worktree", "add", "--detach", str(before), BEFORE)
        try:
            rows: dict[tuple[Path, str], list[dict[str, Any]]]
            rows = {(before, "c60"): [], (ROOT, "c60_paper"): [], (ROOT, "c60"): []}
            for block in range(BLOCKS):
                for (build, campaign), runs in rows.items():
                    runs += _runs(build, campaign, BLOCK * block)
        finally:
            _git("worktree", "remove", "--force", str(before))
    old, falling, new = rows.values()
    moved = [_moved(name, old, falling, "free fall") for name in RESPONSES]
    return {
        "costs": [_cost(BEFORE, old, old), _cost("this, free fall", falling, old), _cost("this", new, old)],
        "responses": moved + [_moved(name, old, new, "as shipped") for name in RESPONSES],
    }


def _git(*words: str) -> None:
    subprocess.run(["git", "-C", str(ROOT), *words], check=True, capture_output=True)


def _runs(build: Path, campaign: str, first: int) -> list[dict[str, Any]]:
    """Return the runs of a build for the samples of a campaign from ``first`` on."""
    environment = {**os.environ, "PYTHONPATH": str(build)}
    done = subprocess.run(
        [sys.executable, "-c", RUNS, campaign, str(first)],
        cwd=build,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def _cost(name: str, rows: list[dict[str, Any]], before: list[dict[str, Any]]) -> dict[str, Any]:
    """Return means and medians of the costs of a build's runs, and their speed relative to the earlier build."""
    return {
        "build": name,
        "ok": f"{sum(row['ok'] for row in rows)} of {len(rows)}",
        "processor ms": mean(row["ms"] for row in rows),
        "median": median(row["ms"] for row in rows),
        "loop ms": median(row["loop_ms"] for row in rows),
        "steps": mean(row["steps"] for row in rows),
        "iterations": mean(row["iterations"] for row in rows),
        "largest residual": max(row["residual"] for row in rows),
        "deepest mm": max(row["penetration"] for row in rows),
        "times as quick": mean(old["ms"] for old in before) / mean(row["ms"] for row in rows),
    }


def _moved(response: str, old: list[dict[str, Any]], new: list[dict[str, Any]], settling: str) -> dict[str, Any]:
    """Return means and sigmas of a response with both builds, and the changes of single samples."""
    pairs = [
        (a["responses"][response], b["responses"][response])
        for a, b in zip(old, new, strict=True)
        if a["ok"] and b["ok"]
    ]
    before, after = zip(*pairs, strict=True)
    return {
        "response": response,
        "settling": settling,
        "mean before": mean(before),
        "mean now": mean(after),
        "sigma before": stdev(before),
        "sigma now": stdev(after),
        "rms change": mean((a - b) ** 2 for a, b in pairs) ** 0.5,
        "largest change": max(abs(a - b) for a, b in pairs),
    }
