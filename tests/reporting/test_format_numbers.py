"""Numbers as text: short, and never across a limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reporting.format_numbers import (
    deciding_index,
    decimals_for,
    fixed,
    grouped,
    index,
    index_interval,
    percent,
    plain,
    ppm,
    significant,
    z_score,
)
from tests.each import each


@pytest.mark.parametrize(
    ("value", "text"),
    [(9.0, "9"), (0.07, "0.07"), (-2.2, "-2.2"), (1e-6, "1e-6"), (0.1 + 0.2, "0.30000000000000004"), (None, "–")],
)
def test_plain(value, text) -> None:
    assert plain(value) == text


@each(
    ("value", "text"),
    [
        (1.6312, "1.631"),
        (1.33, "1.330"),
        (1.3299, "1.3299"),
        (1.32999, "1.32999"),
        (1.3300001, "1.3300001"),
        (0.9999996, "0.9999996"),
        (1.0, "1.000"),
        (-0.00001, "0.000"),
        (None, "–"),
    ],
)
def test_index_keeps_its_class(value, text) -> None:
    assert index(value) == text


@pytest.mark.parametrize(
    ("ends", "most", "text"),
    [
        ((1.25, 1.5), 100.0, "1.250 to 1.500"),
        ((1.25, None), 100.0, "1.250 or more"),
        ((None, 0.9), 100.0, "0.900 or less"),
        ((None, None), 100.0, "no bounds"),
        ((1.25, 1.8), 1.52, "1.250 to > 1.52"),
        ((1.25, None), 1.2, "> 1.20"),
        ((1.6, 1.8), 1.52, "> 1.52"),
    ],
)
def test_an_interval_without_an_end_shows_none(ends, most, text) -> None:
    assert index_interval(ends, most) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [(1.0, "100"), (0.9999999, "99.99999"), (0.0, "0"), (1e-7, "0.00001"), (0.992, "99.20"), (0.5, "50.00")],
)
def test_percent_is_never_all_or_nothing_by_rounding(share, text) -> None:
    assert percent(share) == text + "\u00a0%"


@each(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.497, "0.497"),
        (63.3425, "63.3"),
        (97.1017, "97.1"),
        (2991.25, "2\u202f991"),
        (999_999.9, "999\u202f999.9"),
        (1e6, "1\u202f000\u202f000"),
        (1e-30, "< 0.001"),
        (None, "–"),
    ],
)
def test_ppm(value, text) -> None:
    assert ppm(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.46, "0.460"), (3e-9, "3.00e-9"), (0.0, "0"), (123.4, "123"), (12345.0, "1.23e4")]
)
def test_significant(value, text) -> None:
    assert significant(value) == text


@pytest.mark.parametrize(("scale", "places"), [(0.478, 3), (0.0174, 4), (120.0, 0), (1.0, 2), (0.0, 3), (None, 3)])
def test_decimals_show_three_digits_of_sigma(scale, places) -> None:
    assert decimals_for(scale) == places


def test_grouped() -> None:
    assert grouped(30850) == "30\u202f850"
    assert grouped("1234.5") == "1\u202f234.5"


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.integers(0, 6))
def test_text_lies_on_the_side_of_the_limit_that_the_value_does(value, limit, places) -> None:
    shown = float(fixed(value, places, (limit,)))
    assert (shown > limit) == (value > limit)
    assert (shown < limit) == (value < limit)


def test_what_is_beyond_the_runs_is_only_bounded() -> None:
    """A model of 500 values shows no share below 2 ppm, and no Z above 4.61."""
    assert [ppm(value, 2.0) for value in (1e-9, 0.0, 1.99, 2.0)] == ["< 2.0", "< 2.0", "< 2.0", "2.00"]
    assert [ppm(1.0, least) for least in (250.0, 16_667.0)] == ["< 250", "< 17\u202f000"]  # 4 values, and less than one
    assert [z_score(value, 4.61) for value in (22.6, 4.0, None)] == ["> 4.61", "4.000", "–"]
    assert [index(value, 1.54) for value in (7.0, 1.4, None)] == ["> 1.54", "1.400", "–"]


def test_an_index_without_a_reject_is_more_than_its_lower_end() -> None:
    assert deciding_index(None, 1.6212) == "> 1.621"
    assert deciding_index(1.4590, 1.427) == index(1.4590)
    assert deciding_index(None, None) == "-"
