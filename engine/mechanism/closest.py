"""What an unknown word is likely meant to be: a known one, or something for which docs/modelling.md has a recipe."""

import re
from collections.abc import Iterable
from itertools import islice

LONGEST = 60  # characters compared
MOST_WORDS = 500  # words compared
MOST_SLIPS = 3


def closest(word: str, words: Iterable[str]) -> str | None:
    """Return the word most likely meant: it differs by few slips, or else begins with the given word or has its parts.

    Up to one slip in words of up to 5 letters, two in longer ones, three from 12 on. ``clearance`` is taken for
    ``radial_clearance``. None if none is likely.
    """
    given = word[:LONGEST].lower()
    known = list(islice(words, MOST_WORDS))
    plain = [one[:LONGEST].lower() for one in known]
    likely = [(n, i) for i, one in enumerate(plain) if (n := slip_count(given, one)) <= _allowed(given, one)]
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


def _allowed(first: str, second: str) -> int:
    """Return the number of slips allowed between words of these lengths; J2 is not taken for J1."""
    length = min(len(first), len(second))
    if length <= 2:
        return int(length == 2 and len(first) != len(second))
    return 1 if length <= 5 else 2 if length < 12 else MOST_SLIPS


def _parts(word: str) -> frozenset[str]:
    """Return the parts of a word separated by underscores, hyphens or dots; short parts are ignored."""
    return frozenset(part for part in re.split(r"[^a-z0-9]+", word) if len(part) > 2)


RECIPES = {
    "A pair of gears, with backlash": "gear belt chain pulley coupler spline tooth",
    "A rack, a screw": "rack pinion screw thread spindle",
    "A planetary set": "planet epicyclic",
    "A motor": "motor engine",
    "A solenoid or magnet": "solenoid magnet electro",
    "A progressive, bistable or gas spring": "bistable progressive gas nonlinear dome snap_disc",
    "A one-way clutch": "clutch freewheel ratchet one_way overrunning",
    "A brake, or the friction of a guide or hinge": "brake bearing_friction seal stiction",
    "A rope, and a spring that lifts off": "rope cable wire tension_only",
    "An end stop that bounces": "limit stop range",
    "A hook on a hook, a tooth on a tooth": "hook claw pawl latch",
    "A press fit": "press_fit interference",
    "Stick and slip": "static stick kinetic stribeck",
    "Friction along and across a grain": "anisotropic orthotropic transverse lengthwise crosswise",
    "A bushing": "bushing mount rubber silent_block grommet",
    "A leaf spring": "beam leaf flex cantilever rod_spring",
    "The effort, stroke and energy of a push-button": "effort stroke actuation operating_force",
    "What there is none of yet, and what to do instead": "universal cardan hooke snap rolling bearing",
}
"""The titles of recipes, and what in the name of a key or type asks for one."""


def recipe_for(word: str) -> str:
    """Return `; see "TITLE" in docs/modelling.md` for an unknown key or type, or an empty text if no recipe fits."""
    asked = f"_{word.lower().replace('-', '_')}"  # a known word begins a part of it: a track is no rack
    titles = [title for title, words in RECIPES.items() if any(f"_{known}" in asked for known in words.split())]
    return f'; see "{titles[0]}" in docs/modelling.md' if titles else ""
