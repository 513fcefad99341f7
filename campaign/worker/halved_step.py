"""A run with half the step: the same physics of the same sample, stepped differently.

Where a mechanism sticks, slides and strikes, its rest depends on what it went through. With steps of other lengths it
goes through something else by chance, so two runs of a sample show how far its result is determined by its inputs.
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
    """A function in the place of `engine.simulate` that halves the step: every step's length, if they are adaptive.

    A run with twice the steps may take twice the time.

    Attributes
    ----------
    simulate : callable
        What simulates.
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
        """Simulate a mechanism; parameters as of `engine.simulate`."""
        halved = halved_settings(mechanism, values, step)
        limit = {WALL_LIMIT: 2.0 * values.get(WALL_LIMIT, mechanism.simulation.wall_limit)}
        fixed = None if step is None else halved.pop(STEP)
        return self.simulate(mechanism, {**values, **limit, **halved}, step=fixed, horizon=horizon, cancel=cancel)


def halved_settings(mechanism: Mechanism, values: Mapping[str, float], step: float | None) -> dict[str, float]:
    """Return half of each setting that the lengths of a run's steps depend on, by its key.

    Parameters
    ----------
    mechanism : Mechanism
        Its settings count where ``values`` has none.
    values : mapping of str to float
        Numbers that the run changes.
    step : float or None
        The one fixed step of the run, which replaces the mechanism's steps.
    """
    if step is not None:
        return {STEP: 0.5 * step}
    keys = (STEP, *(OF_ADAPTIVE if mechanism.simulation.adaptive else ()))
    return {key: 0.5 * values.get(key, get_value(mechanism, key)) for key in keys}


def what_differs(plan: Plan, inputs: Mapping[str, float]) -> str:
    """Return the settings of a sample's repeat that are not those of its run, in words.

    Parameters
    ----------
    plan : Plan
        The campaign.
    inputs : mapping of str to float
        Inputs of the sample by variable name.
    """
    values = {plan.targets[name]: value for name, value in inputs.items() if name in plan.targets}
    halved = halved_settings(plan.mechanism, values, plan.spec.simulation.step)
    return ", ".join(f"{key} = {value!r} {unit_of(plan.mechanism, key)}" for key, value in halved.items())
