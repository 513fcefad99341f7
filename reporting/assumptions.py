"""Quantities that a campaign holds fixed (friction, springs, masses, settings), as listed in a report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Assumption:
    """A quantity that is the same in every run.

    Attributes
    ----------
    group : str
        Heading under which it is listed, such as "Friction and impact".
    name : str
        Name in words, such as "stiffness of spring A3".
    value : float, tuple of float, or str
        A number, the components of a vector, or a text.
    unit : str
        Unit of the value, "1" for a pure number, empty for a text.
    key : str
        Key in the mechanism file; empty if it has none.
    """

    group: str
    name: str
    value: float | tuple[float, ...] | str
    unit: str
    key: str
