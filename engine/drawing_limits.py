"""Limits of a size as a drawing states it: deviations, classes of ISO 286 such as H7, general tolerances of ISO 2768.

All sizes are in mm. Deviations of ISO 286-1 are from its tables, to 500 mm: the standard tolerances IT1 to IT18, and
the fundamental deviations a to zc of shafts. Those of holes follow by the rules of the standard: A to H mirror the
shafts; K, M, N to IT8 and P to ZC to IT7 mirror them and add the difference between their grade and the next finer one.
"""

import re
from bisect import bisect_left
from decimal import Decimal
from typing import NamedTuple

_MICROMETRE = Decimal("0.001")
_NONE = -1  # a class that the standard does not define
_Row = tuple[float, ...]

# Upper ends [mm] of the ranges of sizes: the main ranges, and their parts, in which a to c and r to zc change.
_RANGES = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
_PARTS = (
    *(3, 6, 10, 14, 18, 24, 30, 40, 50, 65, 80, 100, 120, 140, 160, 180, 200, 225, 250, 280, 315),
    *(355, 400, 450, 500),
)


def _table(text: str) -> dict[str | int, _Row]:
    """Return the numbers of each line by its first word, a letter or a grade."""
    lines = (line.split() for line in text.strip().splitlines())
    return {int(key) if key.isdigit() else key: tuple(map(float, numbers)) for key, *numbers in lines}


# Standard tolerances [micrometres] by grade, one for each main range.
_GRADES = _table(
    """
    1 0.8 1 1 1.2 1.5 1.5 2 2.5 3.5 4.5 6 7 8
    2 1.2 1.5 1.5 2 2.5 2.5 3 4 5 7 8 9 10
    3 2 2.5 2.5 3 4 4 5 6 8 10 12 13 15
    4 3 4 4 5 6 7 8 10 12 14 16 18 20
    5 4 5 6 8 9 11 13 15 18 20 23 25 27
    6 6 8 9 11 13 16 19 22 25 29 32 36 40
    7 10 12 15 18 21 25 30 35 40 46 52 57 63
    8 14 18 22 27 33 39 46 54 63 72 81 89 97
    9 25 30 36 43 52 62 74 87 100 115 130 140 155
    10 40 48 58 70 84 100 120 140 160 185 210 230 250
    11 60 75 90 110 130 160 190 220 250 290 320 360 400
    12 100 120 150 180 210 250 300 350 400 460 520 570 630
    13 140 180 220 270 330 390 460 540 630 720 810 890 970
    14 250 300 360 430 520 620 740 870 1000 1150 1300 1400 1550
    15 400 480 580 700 840 1000 1200 1400 1600 1850 2100 2300 2500
    16 600 750 900 1100 1300 1600 1900 2200 2500 2900 3200 3600 4000
    17 1000 1200 1500 1800 2100 2500 3000 3500 4000 4600 5200 5700 6300
    18 1400 1800 2200 2700 3300 3900 4600 5400 6300 7200 8100 8900 9700
    """
)

# Distance [micrometres] of a shaft's zone from the nominal size: below it for a to h, above it for k to zc. One for
# each main range, or for each part; fewer where the standard ends, or its editions differ (cd, ef, fg).
_BELOW = _table(
    """
    a 270 270 280 290 290 300 300 310 320 340 360 380 410 460 520 580 660 740 820 920 1050 1200 1350 1500 1650
    b 140 140 150 150 150 160 160 170 180 190 200 220 240 260 280 310 340 380 420 480 540 600 680 760 840
    c 60 70 80 95 95 110 110 120 130 140 150 170 180 200 210 230 240 260 280 300 330 360 400 440 480
    cd 34 46 56
    d 20 30 40 50 65 80 100 120 145 170 190 210 230
    e 14 20 25 32 40 50 60 72 85 100 110 125 135
    ef 10 14 18
    f 6 10 13 16 20 25 30 36 43 50 56 62 68
    fg 4 6 8
    g 2 4 5 6 7 9 10 12 14 15 17 18 20
    h 0 0 0 0 0 0 0 0 0 0 0 0 0
    """
)
_ABOVE = _table(
    """
    k 0 1 1 1 2 2 2 3 3 4 4 4 5
    m 2 4 6 7 8 9 11 13 15 17 20 21 23
    n 4 8 10 12 15 17 20 23 27 31 34 37 40
    p 6 12 15 18 22 26 32 37 43 50 56 62 68
    r 10 15 19 23 23 28 28 34 34 41 43 51 54 63 65 68 77 80 84 94 98 108 114 126 132
    s 14 19 23 28 28 35 35 43 43 53 59 71 79 92 100 108 122 130 140 158 170 190 208 232 252
    t -1 -1 -1 -1 -1 -1 41 48 54 66 75 91 104 122 134 146 166 180 196 218 240 268 294 330 360
    u 18 23 28 33 33 41 48 60 70 87 102 124 144 170 190 210 236 258 284 315 350 390 435 490 540
    v -1 -1 -1 -1 39 47 55 68 81 102 120 146 172 202 228 252 284 310 340 385 425 475 530 595 660
    x 20 28 34 40 45 54 64 80 97 122 146 178 210 248 280 310 350 385 425 475 525 590 660 740 820
    y -1 -1 -1 -1 -1 63 75 94 114 144 174 214 254 300 340 380 425 470 520 580 650 730 820 920 1000
    z 26 35 42 50 60 73 88 112 136 172 210 258 310 365 415 465 520 575 640 710 790 900 1000 1100 1250
    za 32 42 52 64 77 98 118 148 180 226 274 335 400 470 535 600 670 740 820 920 1000 1150 1300 1450 1600
    zb 40 50 67 90 108 136 160 200 242 300 360 445 525 620 700 780 880 960 1050 1200 1300 1500 1650 1850 2100
    zc 60 80 97 130 150 188 218 274 325 405 480 585 690 800 900 1000 1150 1250 1350 1550 1700 1900 2100 2400 2600
    """
)
# j and J lie on both sides: the lower deviation of a shaft, the upper one of a hole, by grade.
_J_LOWER = _table(
    """
    5 2 2 2 3 4 5 7 9 11 13 16 18 20
    6 2 2 2 3 4 5 7 9 11 13 16 18 20
    7 4 4 5 6 8 10 12 15 18 21 26 28 32
    8 6
    """
)
_J_UPPER = _table(
    """
    6 2 5 5 6 8 10 13 16 18 22 25 29 33
    7 4 6 8 10 12 14 18 22 26 30 36 39 43
    8 6 10 12 15 20 24 28 34 41 47 55 60 66
    """
)
_FINEST_OF_RULE, _COARSEST_OF_RULE = 3, {"K": 8, "M": 8, "N": 8}  # others of K to ZC: IT7

# General tolerances of ISO 2768-1 [mm] for lengths, by class; upper ends of the ranges [mm].
_GENERAL_FROM, _GENERAL_RANGES = Decimal("0.5"), (3, 6, 30, 120, 400, 1000, 2000, 4000)
_GENERAL = {
    "f": ("0.05", "0.05", "0.1", "0.15", "0.2", "0.3", "0.5"),
    "m": ("0.1", "0.1", "0.2", "0.3", "0.5", "0.8", "1.2", "2"),
    "c": ("0.2", "0.3", "0.5", "0.8", "1.2", "2", "3", "4"),
    "v": ("", "0.5", "1", "1.5", "2.5", "4", "6", "8"),
}

_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_CLASS = r"(?P<{0}>[A-Za-z]{{1,2}})(?P<{0}_grade>\d{{1,2}})"
_SIZED = re.compile(rf"\s*(?P<size>{_NUMBER})\s*(?P<rest>.*?)\s*", re.DOTALL)
_CLASSED = re.compile(_CLASS.format("letter"))
_PAIRED = re.compile(_CLASS.format("hole") + r"\s*[/-]\s*" + _CLASS.format("shaft"))
_EQUAL = re.compile(rf"(?:±|\+\s*/?\s*-)\s*(?P<width>{_NUMBER})")
_UNEQUAL = re.compile(rf"(?P<first>[+-]?\s*(?:{_NUMBER}))\s*(?:/|\s)\s*(?P<second>[+-]?\s*(?:{_NUMBER}))")
_GENERAL_CLASS = re.compile(r"(?:ISO\s*)?2768(?:-1)?\s*[- ]\s*(?P<letter>[fmcv])[HKL]?", re.IGNORECASE)


class Limits(NamedTuple):
    """Smallest and largest size [mm] that a drawing allows."""

    low: float
    high: float


def dimension_limits(text: str) -> Limits:
    """Return the limits of a dimension: ``20 ±0.1``, ``20 +0.05/-0.01``, ``12 H7``, ``30 ISO 2768-m``; ValueError."""
    size, rest = _size(text)
    if found := _EQUAL.fullmatch(rest):
        width = Decimal(found["width"])
        return _limits(size, -width, width, text)
    if found := _UNEQUAL.fullmatch(rest):
        first, second = (Decimal(re.sub(r"\s", "", found[name])) for name in ("first", "second"))
        return _limits(size, min(first, second), max(first, second), text)
    if found := _GENERAL_CLASS.fullmatch(rest):
        width = _general(size, found["letter"].lower())
        return _limits(size, -width, width, text)
    if found := _CLASSED.fullmatch(rest):
        return _limits(size, *_deviations(size, found["letter"], int(found["letter_grade"])), text)
    raise ValueError(
        f"{text!r}: not a dimension with limits; write such as '20 ±0.1', '20 +0.05/-0.01', '12 H7' or '30 ISO 2768-m'"
    )


def fit_limits(text: str) -> tuple[Limits, Limits]:
    """Return the limits of hole and shaft of a fit, such as ``12 H7/g6``; ValueError if it is none of the standard."""
    size, rest = _size(text)
    found = _PAIRED.fullmatch(rest)
    if found is None or not found["hole"].isupper() or not found["shaft"].islower():
        raise ValueError(
            f"{text!r}: not a fit; write size, class of the hole in capitals and class of the shaft, such as '12 H7/g6'"
        )
    hole = _limits(size, *_deviations(size, found["hole"], int(found["hole_grade"])), text)
    return hole, _limits(size, *_deviations(size, found["shaft"], int(found["shaft_grade"])), text)


def _size(text: str) -> tuple[Decimal, str]:
    """Return the nominal size [mm] and what follows it."""
    found = _SIZED.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r}: does not begin with a size in mm, such as '12 H7'")
    return Decimal(found["size"]), found["rest"]


def _limits(size: Decimal, low: Decimal, high: Decimal, text: str) -> Limits:
    if not low < high:
        raise ValueError(f"{text!r}: the limits are equal; a dimension without a tolerance is a constant")
    return Limits(float(size + low), float(size + high))


def _general(size: Decimal, letter: str) -> Decimal:
    """Return half the general tolerance [mm] of a length."""
    widths = _GENERAL[letter]
    place = bisect_left(_GENERAL_RANGES, size)
    if size < _GENERAL_FROM or place >= len(widths) or not widths[place]:
        raise ValueError(f"{size} mm: ISO 2768-1 has no tolerance of class {letter} at this size; state the deviations")
    return Decimal(widths[place])


def _deviations(size: Decimal, letters: str, grade: int) -> tuple[Decimal, Decimal]:
    """Return lower and upper deviation [mm] of a class such as H7 or g6."""
    name = f"{letters}{grade}"
    if not 0 < size <= _RANGES[-1]:
        raise ValueError(
            f"{size} mm: the classes of ISO 286 are known here up to {_RANGES[-1]} mm; state the deviations"
        )
    if grade not in _GRADES or (grade > 13 and size <= 1):
        raise ValueError(f"{name} at {size} mm: ISO 286 has no grade {grade} there; its grades are 1 to 18")
    width = _tolerance(size, grade)
    place = _lowest_of_hole(size, letters, grade) if letters.isupper() else _lowest_of_shaft(size, letters, grade)
    if place is None:
        raise ValueError(f"{name} at {size} mm: ISO 286 has no such class; state the deviations instead")
    return _MICROMETRE * place, _MICROMETRE * (place + width)


def _tolerance(size: Decimal, grade: int) -> Decimal:
    """Return the standard tolerance [micrometres]."""
    return Decimal(str(_GRADES[grade][bisect_left(_RANGES, size)]))


def _lowest_of_shaft(size: Decimal, letters: str, grade: int) -> Decimal | None:
    """Return the lower deviation [micrometres] of a shaft's class; None if the standard has no such class."""
    width = _tolerance(size, grade)
    if letters == "js":
        return -width / 2
    if letters == "j":
        lower = _entry(_J_LOWER.get(grade, ()), size)
        return None if lower is None else -lower
    if letters == "k" and not 4 <= grade <= 7:
        return Decimal(0)
    if letters in _BELOW:
        distance = None if letters in ("a", "b") and size <= 1 else _entry(_BELOW[letters], size)
        return None if distance is None else -distance - width
    return _entry(_ABOVE.get(letters, ()), size)


def _lowest_of_hole(size: Decimal, letters: str, grade: int) -> Decimal | None:
    """Return the lower deviation [micrometres] of a hole's class; None if the standard has no such class."""
    width, shaft = _tolerance(size, grade), letters.lower()
    if letters == "JS":
        return -width / 2
    if letters == "J":
        upper = _entry(_J_UPPER.get(grade, ()), size)
        return None if upper is None else upper - width
    if shaft in _BELOW:
        distance = None if letters in ("A", "B") and size <= 1 else _entry(_BELOW[shaft], size)
        return distance
    distance = _entry(_ABOVE.get(shaft, ()), size)
    if distance is None or (letters == "K" and grade > 8 and size > 3) or (letters == "N" and grade > 8 and size <= 1):
        return None
    if letters == "N" and grade > 8 and size > 3:
        return -width  # ends at the nominal size
    rule = 0 if size <= 3 or grade > _COARSEST_OF_RULE.get(letters, 7) else grade
    if 0 < rule < _FINEST_OF_RULE:
        return None
    finer = width - _tolerance(size, rule - 1) if rule else Decimal(0)
    if letters == "M" and grade == 6 and 250 < size <= 315:
        finer += 2  # the standard's exception
    return finer - distance - width


def _entry(table: _Row, size: Decimal) -> Decimal | None:
    """Return the entry of a table for a size; None if there is none."""
    place = bisect_left(_PARTS if len(table) == len(_PARTS) else _RANGES, size)
    return Decimal(str(table[place])) if place < len(table) and table[place] != _NONE else None
