"""What a campaign holds fixed: friction, springs, masses, settings, as a report lists them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Assumption:
    """A quantity that is the same in every run.

    Attributes
    ----------
    group : str
        What it belongs to, such as "Friction and impact".
    name : str
        In words, such as "stiffness of spring A3".
    value : float, tuple of float, or str
        A number, the components of a vector, or words.
    unit : str
        Unit of the value, "1" for a pure number, empty for words.
    key : str
        Its key in the mechanism file; empty if it has none.
    """

    group: str
    name: str
    value: float | tuple[float, ...] | str
    unit: str
    key: str
