"""One line of the trust card."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One line of the trust card.

    Attributes
    ----------
    name : str
        Name of the checked property.
    level : str
        "good"; "attention" (read on before signing); "bad" (do not sign); "info" (nothing to judge).
    text : str
        The finding in words.
    value : float or None
        The number of the finding, if there is one.
    """

    name: str
    level: str
    text: str
    value: float | None = None
