"""Which of some words is meant by one that is not among them: a slip of the pen, or a word that it shares."""

import re
from collections.abc import Iterable
from itertools import islice

LONGEST = 60  # characters that are compared
MOST_WORDS = 500  # that are compared
MOST_SLIPS = 3


def closest(word: str, words: Iterable[str]) -> str | None:
    """Return the word that is most likely meant; None if none is likely.

    Likely is a word that differs by few letters added, left out, replaced or exchanged with the next: one in words of
    up to 5 letters, two in longer ones, three from 12 on. Otherwise one that begins with
    the word, or has all parts of it: ``clearance`` is meant for ``radial_clearance``.
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
    """Return how many letters are added, left out, replaced or exchanged with the next; beyond 3 it may stop."""
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
    """Return the number of slips between two words; None if they are more than is likely."""
    most = _allowed(first, second)
    if abs(len(first) - len(second)) > most:
        return None
    count = slip_count(first, second)
    return count if count <= most else None


def _allowed(first: str, second: str) -> int:
    """Return how many slips are likely between words of these lengths; J2 is no slip for J1."""
    length = min(len(first), len(second))
    if length <= 2:
        return int(length == 2 and len(first) != len(second))
    return 1 if length <= 5 else 2 if length < 12 else MOST_SLIPS


def _parts(word: str) -> frozenset[str]:
    """Return the parts of a word that are joined by underscores, hyphens or dots; short ones do not count."""
    return frozenset(part for part in re.split(r"[^a-z0-9]+", word) if len(part) > 2)
