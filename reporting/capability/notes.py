"""Notes of a capability: why numbers are missing, and cautions."""

import math
from collections.abc import Sequence

from reporting.arrays import Array

NOT_NORMAL = (
    "Skewness and kurtosis of these values contradict a normal distribution, so the ppm expected of one has no "
    "interval: the true share may lie anywhere."
)
NO_WITHIN = "No batch has two different values, so there is no sigma and no index within batches."


def why_missing(
    finite: Array, size: int, std: float | None, limits: tuple[float | None, float | None, float | None]
) -> tuple[str, ...]:
    """Return why numbers are missing; `size` counts all values, `limits` are lower limit, upper limit and target."""
    lsl, usl, target = limits
    has_limit = lsl is not None or usl is not None
    notes: Sequence[tuple[bool, str]] = (
        (size > finite.size, f"{size - finite.size} of {size} values are not finite and were left out."),
        (finite.size == 0, "No values."),
        (finite.size == 1, "One value has no spread, so there is no index."),
        (
            finite.size > 1 and std == 0,
            "All values are equal: the spread is zero, so there is no index and no expected ppm.",
        ),
        (
            std is not None and not math.isfinite(std),
            "The values are too large to be squared, so there is no spread and no index.",
        ),
        (not has_limit, "Without limits there is no index and no share out of limits."),
        (has_limit and usl is None, "Lower limit only: Cp, Cc and Cpm are undefined; Cpk is Cpl."),
        (has_limit and lsl is None, "Upper limit only: Cp, Cc and Cpm are undefined; Cpk is Cpu."),
        (lsl is not None and usl is not None and target is None, "Without a target Cpm is undefined."),
    )
    return tuple(text for holds, text in notes if holds)
