"""One settled run of the C-60 after the other, in this process."""

from statistics import median
from typing import Any

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.worker.row import sample_values
from engine import Certificate, load_mechanism, simulate

SAMPLES = 12


def measure(unit_us: float) -> dict[str, Any]:
    """Return medians over the first samples of the shipped campaign; ``unit_us``: the reference."""
    mechanism, plan = load_mechanism("c60"), make_plan(load_campaign("c60"))
    runs = [_quicker(mechanism, sample_values(plan, sample)) for sample in range(SAMPLES)]
    settled = [certificate for certificate in runs if certificate.settled]
    step_us = median(1e6 * c.wall_s / c.steps for c in settled)
    return {
        "runs": len(runs),
        "settled": len(settled),
        "run_s": median(c.wall_s for c in settled),
        "slowest_run_s": max(c.wall_s for c in settled),
        "steps": median(c.steps for c in settled),
        "step_us": step_us,
        "step_in_solves": step_us / unit_us,
        "iterations_per_step": median(c.iterations / c.steps for c in settled),
    }


def _quicker(mechanism: Any, values: dict[str, float]) -> Certificate:
    """Return the certificate of the quicker of two runs."""
    return min((simulate(mechanism, values).certificate for _ in range(2)), key=lambda c: c.wall_s)
