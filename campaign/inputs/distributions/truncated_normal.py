"""Normal distribution between two bounds."""

from typing import ClassVar, Literal

from pydantic import Field

from campaign.inputs.distributions.normal import Normal
from engine.mechanism.base import Number


class TruncatedNormal(Normal):
    """Normal distribution cut to [lower, upper]; the default if a variable names no distribution."""

    hint: ClassVar[str] = "; or name another distribution: truncated_normal is used where none is named"

    distribution: Literal["truncated_normal"] = Field(  # type: ignore[assignment]
        default="truncated_normal", description="Name of the distribution."
    )
    lower: Number = Field(description="Lower bound of the values, in the target's unit; below the upper bound.")
    upper: Number = Field(description="Upper bound of the values, in the target's unit; above the lower bound.")

    def words(self) -> str:
        return f"truncated {super().words()}"
