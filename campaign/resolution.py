"""The resolution of a response by the solver; values of two runs that differ by less count as equal."""

from typing import Any

from engine.mechanism import Mechanism


def resolution(mechanism: Mechanism, response: str) -> tuple[float, float]:
    """Return the largest insignificant difference of a response, in its unit and as a share of the largest value, or 0.

    A position is known to within the penetration that a step tolerates, an angle to within that penetration divided by
    the size of the mechanism, and a force or a torque to within the relative residual of the friction problems.
    """
    unit, sim = mechanism.response_units()[response], mechanism.simulation
    if unit == mechanism.unit("length"):
        return sim.penetration, 0.0
    if unit == mechanism.unit("angle"):
        return sim.penetration / (_size(mechanism.model_dump()) or 1.0), 0.0
    if unit in (mechanism.unit("force"), mechanism.unit("torque")):
        return 0.0, sim.tolerance
    return 0.0, 0.0


def _size(part: Any, key: str = "") -> float:
    """Return the largest coordinate of any point in a mechanism, or in a part of it."""
    if isinstance(part, dict):
        return max((_size(value, name) for name, value in part.items()), default=0.0)
    if isinstance(part, list | tuple):
        is_point = "point" in key and all(isinstance(x, int | float) for x in part)
        return max((abs(x) if is_point else _size(x, key) for x in part), default=0.0)
    return 0.0
