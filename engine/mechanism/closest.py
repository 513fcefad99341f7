"""Find the known word that an unknown one is likely meant to be: a typing error, or a word that shares its parts."""

import re
from collections.abc import Iterable
from itertools import islice

LONGEST = 60  # characters compared
MOST_WORDS = 500  # words compared
MOST_SLIPS = 3


def closest(word: str, words: Iterable[str]) -> str | None:
    """Return the word most likely meant; None if none is likely.

    A word is likely if it differs by few slips, a slip being a letter added, left out, replaced or swapped with the
    next one: up to one slip in words of up to 5 letters, two in longer ones, three from 12 letters on. Failing that, a
    word is likely if it begins with the given word or contains all its parts: ``clearance`` is taken for
    ``radial_clearance``.
    """
    given = word[:LONGEST].lower()
    known = list(islice(words, MOST_WORDS))
    likely = [(count, i) for i, one in enumerate(known) if (count := _slips(given, one[:LONGEST].lower())) is not None]
    if likely:
        return known[min(likely)[1]]
    parts = _parts(given)
    whole = [one for one in known if parts and parts <= _parts(one.lower())]
    begun = [one for one in known if len(given) >= 3 and one.lower().startswith(given)]
    return next(iter([*sorted(begun, key=len), *sorted(whole, key=len)]), None)


def slip_count(first: str, second: str) -> int:
    """Return the number of letters added, left out, replaced or swapped with the next; counting may stop beyond 3."""
    if abs(len(first) - len(second)) > MOST_SLIPS:
        return MOST_SLIPS + 1
    before: list[int] = []
    row = list(range(len(second) + 1))
    for i, letter in enumerate(first):
        last, before, row = before, row, [i + 1]
        for j, other in enumerate(second):
            row.append(min(row[j] + 1, before[j + 1] + 1, before[j] + (letter != other)))
            if i and j and letter == second[j - 1] and first[i - 1] == other:
                row[-1] = min(row[-1], last[j - 1] + 1)
        if min(row) > MOST_SLIPS:
            break
    return max(row[-1], min(row))


def _slips(first: str, second: str) -> int | None:
    """Return the number of slips between two words; None if there are too many."""
    most = _allowed(first, second)
    if abs(len(first) - len(second)) > most:
        return None
    count = slip_count(first, second)
    return count if count <= most else None


def _allowed(first: str, second: str) -> int:
    """Return the number of slips allowed between words of these lengths; J2 is not taken for J1."""
    length = min(len(first), len(second))
    if length <= 2:
        return int(length == 2 and len(first) != len(second))
    return 1 if length <= 5 else 2 if length < 12 else MOST_SLIPS


def _parts(word: str) -> frozenset[str]:
    """Return the parts of a word separated by underscores, hyphens or dots; short parts are ignored."""
    return frozenset(part for part in re.split(r"[^a-z0-9]+", word) if len(part) > 2)
