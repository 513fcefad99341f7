"""The settlings that the study compares: drag of their phases, steps, and the runs of the C-60 with them."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

from engine import load_mechanism, simulate
from engine.mechanism import Mechanism
from engine.mechanism.models import Bench, mechanism_from, with_bench

FEWER = 5
FREE_FALL = "free fall, as in the paper"
CHOSEN = "drag 10, then 2: as shipped"
CONTINUED = "as shipped, then on without drag"
WINDOWS = ("as shipped, window 0.1", "as shipped, window 3")
LIMIT = "drag 20, steps from 0.008, travel 0.004"  # beyond it, more drag and shorter steps hardly matter
HALVINGS = range(4)  # the steps are divided by 1, 2, 4 and 8


@dataclass(frozen=True)
class Settling:
    """A settling, independent of that in the mechanism file."""

    name: str  # row of the tables
    # rate in each phase [1/ms]: with the latch held, with the latch free, and in further phases
    drag: tuple[float, ...] = (0.0, 0.0)
    step: float = 2e-3  # shortest [ms]
    longest: float = 0.064  # step [ms]
    travel: float = 8e-3  # permitted to a contact point in a step longer than the shortest one [mm]
    theta: float = 0.5  # position within a step at which loads and contacts are evaluated
    window: float = 0.3  # time without motion that ends a phase [ms]
    held: float | None = None  # time for which the latch is held [ms]; None: until rest
    free: bool = False  # the latch is never held, so that the first phase has the latch free
    fewer: int = FEWER  # only every `fewer`-th sample is simulated

    def tables(self) -> dict[str, Any]:
        """Return the tables that override those of the mechanism file, as in a test bench."""
        names = ("free", "rest") if self.free else ("hold", "free", "rest")
        phases: list[dict[str, Any]] = [
            {"name": name, "damping": rate} for name, rate in zip(names, self.drag, strict=False)
        ]
        if self.held is not None:
            phases[0]["duration"] = self.held
        return {
            "phases": phases,
            "simulation": {"theta": self.theta, "rest": {"window": self.window, "drift": 1e-6}, **self.steps(0)},
            "without": ["torques.latch_hold"] if self.free else [],
        }

    def steps(self, halvings: int) -> dict[str, Any]:
        """Return the step keys of [simulation], with all steps halved `halvings` times."""
        share = 0.5**halvings
        return {"step": share * self.step, "adaptive": {"longest": share * self.longest, "travel": share * self.travel}}


class Ending(NamedTuple):
    """Result of a run."""

    status: str
    responses: dict[str, float]  # empty unless the run is ok
    steps: int
    iterations: int
    simulated: float  # ms
    processor_ms: float


def settlings() -> list[Settling]:
    """Return the compared settlings, the paper's free fall first."""
    steps = (2e-3, 4e-3, 8e-3, 1.6e-2, 3.2e-2)
    return [
        Settling(FREE_FALL, fewer=1),
        *(Settling(f"free fall, theta 1, steps from {h:g}", theta=1.0, step=h) for h in steps),
        *(Settling(f"drag {d:g}, steps from 0.002", (d, d)) for d in (1.0, 5.0)),
        *(Settling(f"drag {d:g}, theta 1, steps from 0.008", (d, d), 8e-3, theta=1.0) for d in (1, 2, 5, 10, 20)),
        *_with_coarse_steps(),
    ]


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
    processor_ms = 1e3 * (time.process_time() - began)
    c = found.certificate
    return Ending(found.status, found.responses, c.steps, c.iterations, c.time, processor_ms)


@lru_cache(maxsize=2)
def mechanism_of(settling: Settling) -> Mechanism:
    """Return the C-60 with this settling; cached, because reading its file takes longer than some runs."""
    data = load_mechanism("c60").model_dump(by_alias=True, exclude_unset=True)
    return mechanism_from(with_bench(data, "study", Bench.model_validate(settling.tables())), settling.name)


def _with_coarse_steps() -> list[Settling]:
    """Return the settlings with drag, theta 1 and a shortest step of 0.016 ms, and those they are compared with."""
    weak = Settling("drag 5, theta 1, steps from 0.016", (5.0, 5.0), step=1.6e-2, theta=1.0)
    chosen = replace(weak, name=CHOSEN, drag=(10.0, 2.0))
    return [
        replace(weak, fewer=1),
        *(replace(weak, name=f"drag 5, window {window:g}", window=window) for window in (0.05, 0.1)),
        replace(weak, name="drag 5, then 10", drag=(5.0, 10.0)),
        replace(weak, name="drag 10", drag=(10.0, 10.0), fewer=1),
        replace(weak, name="drag 10, then 5", drag=(10.0, 5.0)),
        replace(weak, name="drag 10, then 1", drag=(10.0, 1.0)),
        replace(chosen, fewer=1),
        replace(chosen, name="as shipped, theta 1/2", theta=0.5),
        *(replace(chosen, name=f"as shipped, steps from {h:g}", step=h) for h in (2e-3, 8e-3, 3.2e-2)),
        *(replace(chosen, name=f"as shipped, travel {travel:g}", travel=travel) for travel in (4e-3, 1.6e-2)),
        *(replace(chosen, name=f"as shipped, longest {longest:g}", longest=longest) for longest in (0.032, 0.128)),
        replace(chosen, name="drag 20 while held for 1 ms, then 5", drag=(20.0, 5.0), held=1.0),
        replace(chosen, name="drag 10, latch never held", drag=(10.0,), free=True),
        *(replace(chosen, name=name, window=window) for name, window in zip(WINDOWS, (0.1, 3.0), strict=True)),
        replace(chosen, name=CONTINUED, drag=(10.0, 2.0, 0.0)),
        replace(chosen, name=LIMIT, drag=(20.0, 20.0), step=8e-3, travel=4e-3),
    ]
