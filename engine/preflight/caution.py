"""A caution: what looks wrong in a mechanism that could run all the same."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Caution:
    """What looks wrong in a mechanism, where, and what to do.

    Attributes
    ----------
    key : str
        Dotted path in the mechanism file.
    value : float or None
        The number there, if it is one number.
    unit : str
        Its unit; "1" for a pure number.
    text : str
        What looks wrong.
    customary : str
        What would be customary.
    remedy : str
        What to do.
    """

    key: str
    value: float | None
    unit: str
    text: str
    customary: str
    remedy: str

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        value = "" if self.value is None else f" = {self.value:g}{unit}"
        customary = f"; customary: {self.customary}" if self.customary else ""
        return f"{self.key}{value}: {self.text}{customary}; {self.remedy}"

    def to_json(self) -> dict[str, object]:
        """Return plain data."""
        return {**asdict(self), "message": str(self)}
