"""A caution: something that looks wrong in a mechanism although it could run."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Caution:
    """Something that looks wrong in a mechanism, where it is, and what to do.

    Attributes
    ----------
    key : str
        Dotted path in the mechanism file.
    value : float or None
        The number at this key, if it is a single number.
    unit : str
        Unit of the value; "1" for a pure number.
    text : str
        What looks wrong.
    customary : str
        What is customary.
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
