"""Test whether a mechanism comes to rest with a fixed step, and otherwise which shorter step does."""

from engine.mechanism import Mechanism, set_values
from engine.preflight.caution import Caution
from engine.simulate import simulate

HALVINGS = 4
LONGEST_TRIAL = 10.0  # s


def step_caution(mechanism: Mechanism, step: float, horizon: float | None = None) -> Caution | None:
    """Return a caution, naming the longest suitable step, if a mechanism does not come to rest with a fixed step.

    Half the step, a quarter of it and so on are tried, one run each. If none comes to rest, the step is not to blame.

    `horizon` is the longest simulated time; None means the mechanism's.
    """
    limit = min(LONGEST_TRIAL, mechanism.simulation.wall_limit)
    mechanism = set_values(mechanism, {"simulation.wall_limit": limit})
    unit, message = mechanism.unit("time"), ""
    for halvings in range(HALVINGS + 1):
        shorter = 0.5**halvings * step
        run = simulate(mechanism, step=shorter, horizon=horizon)
        if run.status != "not_at_rest":
            break
        message = message or run.message
    if run.status != "ok" or not message:
        return None
    return Caution(
        "simulation.step",
        step,
        unit,
        f"with this fixed step the mechanism does not come to rest ({message})",
        f"up to {shorter:g} {unit}",
        f"with {shorter:g} {unit} it does: the longest that was tried, half and half again",
    )
