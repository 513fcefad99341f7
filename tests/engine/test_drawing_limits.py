"""Limits as drawings state them: tables of ISO 286-2 and ISO 2768-1, the formulas behind them, what is refused."""

import math

import pytest

from engine import drawing_limits
from engine.drawing_limits import dimension_limits, fit_limits

# Deviations in micrometres as ISO 286-2 tabulates them.
HOLES = {
    "25 H7": (0, 21), "25 G7": (7, 28), "25 F8": (20, 53), "25 E9": (40, 92), "25 D10": (65, 149), "25 C11": (110, 240),
    "25 J7": (-9, 12), "25 JS7": (-10.5, 10.5), "25 K7": (-15, 6), "25 M7": (-21, 0), "25 N7": (-28, -7),
    "25 P7": (-35, -14), "25 R7": (-41, -20), "25 S7": (-48, -27), "25 K6": (-11, 2), "25 N9": (-52, 0),
    "25 P9": (-74, -22), "100 H8": (0, 54), "100 U7": (-146, -111), "2 K7": (-10, 0), "2 N9": (-29, -4),
    "280 M6": (-41, -9), "8 P9": (-51, -15), "50 H11": (0, 160), "200 N8": (-77, -5), "6 H6": (0, 8),
}  # fmt: skip
SHAFTS = {
    "25 g6": (-20, -7), "25 f7": (-41, -20), "25 e8": (-73, -40), "25 d9": (-117, -65), "25 h6": (-13, 0),
    "25 h9": (-52, 0), "25 j6": (-4, 9), "25 js6": (-6.5, 6.5), "25 k6": (2, 15), "25 m6": (8, 21), "25 n6": (15, 28),
    "25 p6": (22, 35), "25 r6": (28, 41), "25 s6": (35, 48), "25 t6": (41, 54), "25 u6": (48, 61), "25 k8": (0, 33),
    "100 c11": (-390, -170), "100 x6": (178, 200), "3 g6": (-8, -2), "450 zc7": (2400, 2463), "12 a11": (-400, -290),
    "5 j5": (-2, 3), "5 j7": (-4, 8),
}  # fmt: skip


def _micrometres(text):
    low, high = dimension_limits(text)
    size = float(text.split()[0])
    return pytest.approx((1000 * (low - size), 1000 * (high - size)), abs=1e-9)


def test_tabulated_deviations():
    for text, deviations in {**HOLES, **SHAFTS}.items():
        assert deviations == _micrometres(text), text


# letter: grade, factor; the distance is that grade's tolerance + factor x D, rounded
ABOVE_GRADE = {
    **{"t": (7, 0.63), "u": (7, 1.0), "v": (7, 1.25), "x": (7, 1.6), "y": (7, 2.0), "z": (7, 2.5), "za": (8, 3.15)},
    **{"zb": (9, 4.0), "zc": (10, 5.0)},
}
POWERS = {"d": (16, 0.44), "e": (11, 0.41), "f": (5.5, 0.41), "g": (2.5, 0.34), "n": (5, 0.34)}


def _mean_sizes(ends):
    """Return the geometric means of the ranges above 30 mm; below, the standard departs from its formulas."""
    return [(i, math.sqrt(ends[i - 1] * ends[i])) for i in range(1, len(ends)) if ends[i] > 30]


def test_grades_follow_their_formula():
    """IT6 to IT18 are 10, 16, 25, ... times i = 0.45 D^(1/3) + 0.001 D, rounded: a slip of a digit shows."""
    factors = (10, 16, 25, 40, 64, 100, 160, 250, 400, 640, 1000, 1600, 2500)
    for grade, factor in zip(range(6, 19), factors, strict=True):
        for i, d in _mean_sizes(drawing_limits._RANGES):
            assert drawing_limits._GRADES[grade][i] == pytest.approx(
                factor * (0.45 * d ** (1 / 3) + 0.001 * d), rel=0.03
            )


def test_fundamental_deviations_follow_their_formulas():
    tables = {**drawing_limits._BELOW, **drawing_limits._ABOVE}
    for letter, (factor, power) in POWERS.items():
        for i, d in _mean_sizes(drawing_limits._RANGES):
            assert tables[letter][i] == pytest.approx(factor * d**power, rel=0.05, abs=0.6), (letter, i)
    for i, d in _mean_sizes(drawing_limits._PARTS):
        main = next(j for j, end in enumerate(drawing_limits._RANGES) if drawing_limits._PARTS[i] <= end)
        for letter, (grade, factor) in ABOVE_GRADE.items():
            formula = drawing_limits._GRADES[grade][main] + factor * d
            assert tables[letter][i] == pytest.approx(formula, rel=0.06, abs=1.5), (letter, i)
        assert tables["a"][i] == pytest.approx(265 + 1.3 * d if d <= 120 else 3.5 * d, rel=0.05), i
        assert tables["b"][i] == pytest.approx(140 + 0.85 * d if d <= 160 else 1.8 * d, rel=0.05), i
        if d > 40:
            assert tables["c"][i] == pytest.approx(95 + 0.8 * d, rel=0.05), i


def test_tables_rise_with_the_size():
    for table in (*drawing_limits._GRADES.values(), *drawing_limits._BELOW.values(), *drawing_limits._ABOVE.values()):
        assert list(table) == sorted(table)


def test_deviations_as_written():
    for text, limits in {
        "20 ±0.1": (19.9, 20.1),
        "20 +-0.1": (19.9, 20.1),
        "20+0.05/-0.01": (19.99, 20.05),
        "20 +0.05 -0.01": (19.99, 20.05),
        "20 -0.01/-0.03": (19.97, 19.99),
        "20 0/-0.02": (19.98, 20.0),
        "30 ISO 2768-m": (29.8, 30.2),
        "30.5 2768-mK": (30.2, 30.8),
        "0.5 ISO 2768-f": (0.45, 0.55),
        "12H7": (12.0, 12.018),
    }.items():
        assert dimension_limits(text) == limits, text


def test_fits():
    assert fit_limits("12 H7/g6") == ((12.0, 12.018), (11.983, 11.994))
    assert fit_limits("40H8-f7") == ((40.0, 40.039), (39.95, 39.975))


def test_refusals():
    for text in (
        *("H7", "12", "12 Q7", "12 H19", "12 H0", "600 H7", "0 H7", "0.8 A11", "20 t6", "12 K9", "12 J9", "12 j9"),
        *("12 I7", "20 ±0", "20 0.1/0.1", "20 ISO 2768-x", "0.4 ISO 2768-m", "3000 ISO 2768-f", "2 ISO 2768-v"),
        *("0.9 H14", "12 Hh7", "20 +0.1", "12 cd7", "-12 H7"),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            dimension_limits(text)
    for text in ("12 H7", "12 h7/G6", "12 g6/H7", "12 H7/g", "H7/g6"):
        with pytest.raises(ValueError, match=r"\w"):
            fit_limits(text)
