"""A run with half the step: the same physics of the same sample, stepped differently.

If a mechanism sticks, slides and impacts, its position of rest depends on its history. With other step lengths the
history differs by chance, so two runs of a sample show to what extent its inputs determine its result.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from campaign.plan import Plan
from campaign.worker.messages import Simulate
from engine import Run
from engine.mechanism import Mechanism, get_value, unit_of

if TYPE_CHECKING:
    from engine.loop import Cancel

STEP = "simulation.step"  # the fixed step, or the shortest of adaptive ones
OF_ADAPTIVE = ("simulation.adaptive.longest", "simulation.adaptive.travel")
WALL_LIMIT = "simulation.wall_limit"


@dataclass(frozen=True)
class HalvedStep:
    """A replacement of `engine.simulate` that halves the step, or all step lengths if steps are adaptive.

    The time limit of the run is doubled, because it takes twice as many steps.

    `simulate` has the parameters of `engine.simulate`.
    """

    simulate: Simulate

    def __call__(
        self,
        mechanism: Mechanism,
        values: Mapping[str, float],
        *,
        step: float | None = None,
        horizon: float | None = None,
        cancel: "Cancel | None" = None,
    ) -> Run:
        """Simulate a mechanism; the parameters are those of `engine.simulate`."""
        halved = halved_settings(mechanism, values, step)
        limit = {WALL_LIMIT: 2.0 * values.get(WALL_LIMIT, mechanism.simulation.wall_limit)}
        fixed = None if step is None else halved.pop(STEP)
        return self.simulate(mechanism, {**values, **limit, **halved}, step=fixed, horizon=horizon, cancel=cancel)


def halved_settings(mechanism: Mechanism, values: Mapping[str, float], step: float | None) -> dict[str, float]:
    """Return, by key, half of each setting that determines the step lengths of a run.

    Settings are those of ``values``, numbers that the run changes, else the mechanism's. ``step`` is the fixed step of
    the run, None for the mechanism's steps.
    """
    if step is not None:
        return {STEP: 0.5 * step}
    keys = (STEP, *(OF_ADAPTIVE if mechanism.simulation.adaptive else ()))
    return {key: 0.5 * values.get(key, get_value(mechanism, key)) for key in keys}


def what_differs(plan: Plan, inputs: Mapping[str, float]) -> str:
    """Return, in words, the settings in which a sample's repeat differs from its run; inputs by variable name."""
    values = {plan.targets[name]: value for name, value in inputs.items() if name in plan.targets}
    halved = halved_settings(plan.mechanism, values, plan.spec.simulation.step)
    return ", ".join(f"{key} = {value!r} {unit_of(plan.mechanism, key)}" for key, value in halved.items())
