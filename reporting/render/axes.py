"""Colours, sizes, axis labels and axis ranges shared by the figures of a report."""

BAR, REJECT, LIMIT, TARGET, FIT, OTHER = "#7fa6cc", "#c2371d", "#a61c00", "#1f6f43", "#7a3e9d", "#c9772b"
# Figures are as wide as a telephone, so that their text is readable on one; wider screens show two side by side.
HALF, TALL = 480.0, 262.0


def unit_suffix(unit: str) -> str:
    """Return the unit with a space before it; empty for a number without unit."""
    return "" if unit in ("", "1") else f" {unit}"


def around(values: list[float]) -> tuple[float, float]:
    """Return the ends of an axis that shows all values, with a margin."""
    low, high = min(values), max(values)
    room = 0.04 * (high - low) or 0.02 * abs(low) or 1.0
    return low - room, high + room


def axis_name(name: str, unit: str) -> str:
    """Return the label of an axis."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def density_name(unit: str) -> str:
    """Return the label of a density axis."""
    bare = unit in ("", "1")
    return "density" if bare else f"density [1/{unit}]" if " " not in unit else f"density [1/({unit})]"
