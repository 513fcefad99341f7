"""A caution: something that looks wrong in a mechanism although it could run."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Caution:
    """Something that looks wrong in a mechanism, where it is, and what to do."""

    key: str  # dotted path in the mechanism file
    value: float | None  # the number at this key, if it is a single number
    unit: str  # of the value; "1" for a pure number
    text: str  # what looks wrong
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
