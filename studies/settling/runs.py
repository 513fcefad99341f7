"""The runs of a settling: the C-60 with its phases and steps, and the result of a run."""

import time
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from engine import load_mechanism, simulate
from engine.mechanism import Mechanism
from engine.mechanism.models import Bench, mechanism_from, with_bench
from studies.settling.settlings import Settling

HALVINGS = range(4)  # the steps are divided by 1, 2, 4 and 8


class Ending(NamedTuple):
    """Result of a run."""

    status: str
    responses: dict[str, float]  # empty unless the run is ok
    steps: int
    iterations: int
    simulated: float  # ms
    processor_ms: float


def run(settling: Settling, gaps: Mapping[str, float], halvings: int = 0) -> Ending:
    """Return the result of a sample with its clearances (mm by joint) and steps halved `halvings` times."""
    mechanism = mechanism_of(settling)
    steps = settling.steps(halvings)
    values = {
        **gaps,
        "simulation.step": steps["step"],
        **{f"simulation.adaptive.{key}": value for key, value in steps["adaptive"].items()},
    }
    began = time.process_time()
    found = simulate(mechanism, values)
    spent = 1e3 * (time.process_time() - began)
    c = found.certificate
    return Ending(found.status, found.responses, c.steps, c.iterations, c.time, spent)


@lru_cache(maxsize=2)
def mechanism_of(settling: Settling) -> Mechanism:
    """Return the C-60 with this settling; cached, because reading its file takes longer than some runs."""
    data = load_mechanism("c60").model_dump(by_alias=True, exclude_unset=True)
    return mechanism_from(with_bench(data, "study", Bench.model_validate(settling.tables())), settling.name)
