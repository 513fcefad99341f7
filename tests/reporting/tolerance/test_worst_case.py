"""The worst case over corners: eqs. 24-27 by hand, and what it says on the page."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reporting import ReportError
from reporting.render.html import render_html
from reporting.tolerance.worst_case import worst_case
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, drawn_by

CORNERS = np.array(list(itertools.product((0.01, 0.13), repeat=3)))
INPUTS = {f"J{j + 1}": CORNERS[:, j] for j in range(3)}


def test_of_a_linear_response_by_hand():
    """12 + 2 x - 3 y: lowest at small x and large y, whatever z."""
    worst = worst_case(12 + 2 * INPUTS["J1"] - 3 * INPUTS["J2"], INPUTS, 11.0, 12.1)
    assert worst.lowest == pytest.approx(12 + 0.02 - 0.39)
    assert worst.highest == pytest.approx(12 + 0.26 - 0.03)
    assert worst.nominal == pytest.approx(12 - 0.07)
    assert worst.tolerance == pytest.approx(0.3)
    assert (worst.lowest_corner["J1"], worst.lowest_corner["J2"]) == (0.01, 0.13)
    assert (worst.highest_corner["J1"], worst.highest_corner["J2"]) == (0.13, 0.01)
    assert worst.within is False  # 12.23 above 12.1


@given(st.lists(st.floats(-1e6, 1e6), min_size=8, max_size=8), st.floats(-100, 100), st.floats(0.01, 100))
def test_shift_and_scale(y, shift, scale):
    """Nominal and tolerance follow a change of unit."""
    base, moved = worst_case(np.array(y), INPUTS), worst_case(scale * np.array(y) + shift, INPUTS)
    size = 1e-9 * (1 + abs(shift) + scale * max(map(abs, y)))
    assert moved.nominal == pytest.approx(scale * base.nominal + shift, abs=size)
    assert moved.tolerance == pytest.approx(scale * base.tolerance, abs=size)


def test_corners_without_a_value_are_counted_and_never_within():
    """A breaker that does not latch at a corner does not keep its limits there."""
    y = np.arange(8.0)
    y[3] = math.nan
    worst = worst_case(y, INPUTS, -1.0, 9.0)
    assert (worst.lowest, worst.highest, worst.missing, worst.within) == (0.0, 7.0, 1, False)
    nothing = worst_case(np.full(8, math.nan), INPUTS)
    assert (nothing.lowest, nothing.tolerance, nothing.missing, nothing.within) == (None, None, 8, None)


def test_columns_of_different_lengths_are_refused():
    """With their names."""
    with pytest.raises(ReportError, match=r"J2: .*length"):
        worst_case(np.zeros(8), INPUTS | {"J2": np.zeros(7)})


@pytest.mark.slow
@pytest.mark.parametrize("failures", [0, 9])
def test_on_the_page(failures):
    """Headline, table, and the warning that indices of corners mean nothing."""
    from dataclasses import replace

    spec = replace(c60_spec(129), **drawn_by("worst_case"))
    analysis = analysis_of(c60_table(129, failures), spec)
    page = render_html(analysis)
    limited = [r for r in analysis.responses if r.worst.within is not None]
    kept = sum(r.worst.within for r in limited)
    kept_in_words = f"Worst case: {kept} of 6 responses with limits stay within them at every corner."
    assert analysis.headline.endswith(kept_in_words)
    assert (analysis.headline == kept_in_words) == (failures == 0)
    assert 'id="worst"' in page
    assert "not a production" in page
    assert ("9 of 129 without a value" in page) == (failures > 0)
    assert 'id="worst"' not in render_html(analysis_of(c60_table(129), c60_spec(129)))
