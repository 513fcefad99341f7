"""One line of the trust card."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One line of the trust card.

    Attributes
    ----------
    name : str
        What was checked.
    level : str
        "good"; "attention": read on before you sign; "bad": do not sign; "info": nothing to judge.
    text : str
        The finding in words.
    value : float or None
        The number of the finding, if it has one.
    """

    name: str
    level: str
    text: str
    value: float | None = None
