"""Positions of the keys in a TOML text, so that an editor can show a fault next to its line."""

import tomllib
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from engine.errors import Fault
from engine.platform.toml_file import TOKEN

Keys = tuple[str, ...]  # keys from the outermost inwards; entries of lists by their index from 0


@dataclass(frozen=True)
class TextPosition:
    """A position in a text.

    Parameters
    ----------
    line, column : int
        Counted from 1; columns count characters.
    """

    line: int
    column: int


def position_of(text: str, keys: Sequence[str]) -> TextPosition:
    """Return the position of a key in a TOML text.

    Parameters
    ----------
    text : str
        TOML that `engine.platform.toml_file.parse_toml` accepts; any other text is followed as far as possible.
    keys : sequence of str
        The tables and the key, from the outside in; list entries by their index from 0.

    Returns
    -------
    TextPosition
        Position of the key; if the text lacks it, of the nearest enclosing table; otherwise the start of the text.
    """
    return _nearest(key_positions(text), keys)


def with_positions(faults: Iterable[Fault], content: bytes) -> tuple[Fault, ...]:
    """Return the faults of a text, which `parse_toml` accepts, with the line and column of their keys."""
    known = key_positions(content.decode("utf-8-sig"))
    places = ((fault, _nearest(known, fault.keys)) for fault in faults)
    return tuple(replace(fault, line=place.line, column=place.column) for fault, place in places)


def key_positions(text: str) -> dict[Keys, TextPosition]:
    """Return the position of each key, entry and table of a TOML text; for a table, its header or its first key."""
    reader = _KeyReader(text)
    reader.read()
    line_starts = [0, *(i + 1 for i, c in enumerate(text) if c == "\n")]
    places = {}
    for keys, at in {**reader.implied, **reader.written}.items():
        line = bisect_right(line_starts, at)
        places[keys] = TextPosition(line, at - line_starts[line - 1] + 1)
    return places


def _nearest(known: dict[Keys, TextPosition], keys: Sequence[str]) -> TextPosition:
    for length in range(len(keys), 0, -1):
        if place := known.get(tuple(keys[:length])):
            return place
    return TextPosition(1, 1)


class _KeyReader:
    """Parses a text token by token, and records the index of the first character of each full path of keys."""

    def __init__(self, text: str) -> None:
        tokens = ((token.lastgroup, token[0], token.start()) for token in TOKEN.finditer(text))
        self._tokens = [token for token in tokens if token[0] not in ("skipped", "dot")][::-1]
        self._entries: Counter[Keys] = Counter()  # entries so far of each array of tables
        self.written: dict[Keys, int] = {}
        self.implied: dict[Keys, int] = {}  # tables named only in the paths of their keys, by the first such path

    def read(self) -> None:
        """Read the whole text."""
        table: Keys = ()
        while kind := self._next_kind():
            if kind == "open":
                table = self._header()
            elif kind in ("word", "string"):
                self._entry(table)
            else:
                self._tokens.pop()

    def _next_kind(self) -> str:
        """Return the kind of the next token; empty at the end."""
        return self._tokens[-1][0] or "" if self._tokens else ""

    def _names(self) -> list[tuple[str, int]]:
        """Read the parts of a key; return each with the index of its first character."""
        names = []
        while self._next_kind() in ("word", "string"):
            _, text, at = self._tokens.pop()
            names.append((_unquoted(text), at))
        return names

    def _header(self) -> Keys:
        """Read ``[table]`` or ``[[table]]``; return the keys of the table."""
        depth = 0
        while self._next_kind() == "open":
            self._tokens.pop()
            depth += 1
        keys: Keys = ()
        names = self._names()
        for i, (name, at) in enumerate(names):
            keys, is_last = (*keys, name), i == len(names) - 1
            (self.written if is_last else self.implied).setdefault(keys, at)
            if is_last and depth > 1:
                self._entries[keys] += 1
            if keys in self._entries:
                keys = (*keys, str(self._entries[keys] - 1))
                self.written.setdefault(keys, at)
        while self._next_kind() == "close":
            self._tokens.pop()
        return keys

    def _entry(self, table: Keys) -> None:
        """Read ``key = value`` in a table."""
        keys, names = table, self._names()
        for i, (name, at) in enumerate(names):
            keys = (*keys, name)
            (self.written if i == len(names) - 1 else self.implied).setdefault(keys, at)
        if self._next_kind() == "key":
            self._tokens.pop()
            self._value(keys)

    def _value(self, keys: Keys) -> None:
        """Read a value up to its end."""
        if self._next_kind() != "open":
            while self._next_kind() not in ("comma", "close", "end", ""):
                self._tokens.pop()
            return
        is_list, count = self._tokens.pop()[1] == "[", 0
        while (kind := self._next_kind()) not in ("close", ""):
            if kind in ("comma", "end"):
                count += kind == "comma"
                self._tokens.pop()
            elif is_list:
                self.written.setdefault((*keys, str(count)), self._tokens[-1][2])
                self._value((*keys, str(count)))
            elif kind in ("word", "string"):
                self._entry(keys)
            else:
                self._tokens.pop()
        if kind:
            self._tokens.pop()


def _unquoted(text: str) -> str:
    """Return the part of a key that a token represents."""
    if text[0] not in "\"'":
        return text
    try:
        return next(iter(tomllib.loads(f"{text} = 0")))
    except tomllib.TOMLDecodeError:
        return text
