"""What is wrong with a file or a value, as data; the line that a user reads is made from it."""

import re
from dataclasses import dataclass
from typing import Any

LONGEST_FAULT = 1000  # characters of a line
_LONGEST_VALUE = 80  # characters of a value in a line
_PARTS = re.compile(r"(?P<what>.*?)(?:^|; )allowed(?: here)?: (?P<allowed>.*?)(?:; (?P<remedy>.*))?", re.DOTALL)


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong, where, and what to do.

    Parameters
    ----------
    keys : tuple of str
        The keys down to the one at fault, as the user wrote them; entries of lists by their number from 0. Empty if it
        is the file as a whole.
    text : str
        What is wrong; what is allowed; what to do.
    value : object
        The value of the key; None if it has none, or if it is a table.
    unit : str
        Unit of the value, if it is a number that has one.
    others : tuple of str
        Dotted paths of further keys that are at fault together with this one.
    within : tuple of Fault
        Faults of the file that the value names.
    line, column : int or None
        Where the key, or its nearest table, stands in the text that was read, from 1; None if it was no text.
    """

    keys: tuple[str, ...]
    text: str
    value: Any = None
    unit: str = ""
    others: tuple[str, ...] = ()
    within: tuple["Fault", ...] = ()
    line: int | None = None
    column: int | None = None

    @property
    def key(self) -> str:
        """Dotted path of the key."""
        return ".".join(self.keys)

    @property
    def shown(self) -> str:
        """The value with its unit, as a line shows it; empty if there is none."""
        if self.value is None:
            return ""
        value = str(self.value).lower() if isinstance(self.value, bool) else repr(self.value)
        short = value if len(value) <= _LONGEST_VALUE else value[: _LONGEST_VALUE - 3] + "..."
        return f"{short} {self.unit}" if self.unit not in ("", "1") else short

    @property
    def what(self) -> str:
        """What is wrong; empty if the text says only what is allowed."""
        return self._parts()[0]

    @property
    def allowed(self) -> str:
        """What would be allowed; empty if the text does not say."""
        return self._parts()[1]

    @property
    def remedy(self) -> str:
        """What to do; empty if the text does not say."""
        return self._parts()[2]

    def _parts(self) -> tuple[str, str, str]:
        """Return the three parts of the text."""
        if parts := _PARTS.fullmatch(self.text):
            return parts["what"], parts["allowed"], parts["remedy"] or ""
        what, _, remedy = self.text.rpartition("; ")
        return (what, "", remedy) if what else (remedy, "", "")

    def __str__(self) -> str:
        where = ", ".join((self.key, *self.others))
        value = f" = {self.shown}" if self.shown else ""
        return one_line(f"{where}{value}: {self.text}" if self.keys else self.text)

    def to_json(self) -> dict[str, Any]:
        """Return plain data: the fields, the three parts of the text, and the line that a user reads."""
        return {
            "keys": list(self.keys),
            "value": self.shown or None,
            **{name: getattr(self, name) for name in ("text", "what", "allowed", "remedy", "line", "column")},
            "others": list(self.others),
            "within": [fault.to_json() for fault in self.within],
            "said": str(self),
        }


def one_line(text: str) -> str:
    """Return a fault as one line of bounded length; a key or value of a file can hold any character."""
    shown = text if len(text) <= LONGEST_FAULT else f"{text[: LONGEST_FAULT - 200]} ... {text[-195:]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shown)
