"""Errors of the engine: each message is complete and addressed to the user."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

LONGEST_FAULT = 1000  # characters per line
_LONGEST_VALUE = 80  # characters of a value within a line
_PARTS = re.compile(r"(?P<what>.*?)(?:^|; )allowed(?: here)?: (?P<allowed>.*?)(?:; (?P<remedy>.*))?", re.DOTALL)


@dataclass(frozen=True)
class Fault:
    """One fault: what is wrong, where, and what to do.

    Parameters
    ----------
    keys : tuple of str
        Keys down to the one at fault, as written by the user; list entries by their index from 0. Empty if the fault is
        in the file as a whole.
    text : str
        What is wrong; what is allowed; what to do.
    value : object
        Value of the key; None if it has none or is a table.
    unit : str
        Unit of the value, if it is a number with a unit.
    others : tuple of str
        Dotted paths of other keys that share the fault.
    within : tuple of Fault
        Faults of the file named by the value.
    line, column : int or None
        Position of the key, or its nearest table, in the text, counted from 1; None if the data were not read from a
        text.
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
        """The value with its unit as shown in a line; empty if there is none."""
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
        """What is allowed; empty if the text does not say."""
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
        """Return plain data: the fields, the three parts of the text, and the line shown to the user."""
        return {
            "keys": list(self.keys),
            "value": self.shown or None,
            **{name: getattr(self, name) for name in ("text", "what", "allowed", "remedy", "line", "column")},
            "others": list(self.others),
            "within": [fault.to_json() for fault in self.within],
            "said": str(self),
        }


def some(names: Sequence[str], most: int = 5) -> str:
    """Return names as text; of many only the first."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def one_line(text: str) -> str:
    """Return a fault as one line of bounded length; a key or value in a file can contain any character."""
    shown = text if len(text) <= LONGEST_FAULT else f"{text[: LONGEST_FAULT - 200]} ... {text[-195:]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shown)


class EngineError(Exception):
    """Base class of all errors that the engine raises deliberately."""


class MechanismError(EngineError):
    """The description of a mechanism, or a value set in it, is wrong.

    Parameters
    ----------
    message : str
        The file or mechanism, followed by one line per fault.
    faults : iterable of Fault
        The same faults as data; empty if the error cannot be attributed to a single key.
    """

    def __init__(self, message: str, faults: Iterable[Fault] = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class NotAssemblable(MechanismError):
    """The parts overlap as drawn, or ideal joints are open, and no start pose nearby puts that right.

    Parameters
    ----------
    message : str
        The mechanism, one line per overlap and open joint, and the reason.
    reason : str
        What is in the way, in one sentence with its numbers.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        """Return how to make it again in another process."""
        return type(self), (str(self), self.reason)


class CadError(EngineError):
    """A CAD file cannot be read, or does not contain what is requested of it."""


class TrajectoryError(EngineError):
    """A trajectory file cannot be written or read."""


class FolderError(EngineError):
    """The folder of compiled code is not safe: another user could have put files there, so none of it is run."""


class UnsupportedNumbaError(EngineError, ImportError):
    """The installed Numba lacks what the engine cannot do without."""
