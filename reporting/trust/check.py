"""One line of the trust card."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One line of the trust card."""

    name: str  # of the checked property
    level: str  # "good"; "attention" (read on before signing); "bad" (do not sign); "info" (nothing to judge)
    text: str  # the finding in words
    value: float | None = None  # the number of the finding, if there is one
