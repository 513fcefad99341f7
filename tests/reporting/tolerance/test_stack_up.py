"""Worst case over corners by hand (eqs. 24-27), by slopes against closed forms, and what the page says of both."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reporting import ReportError, VariableSpec
from reporting.render.html import render_html
from reporting.tolerance.stack_up import linear_stack, tolerance_of, worst_case
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, drawn_by

RNG = np.random.default_rng(12)
N = 400


def bounded(name, lower, upper):
    """Return a uniform variable between its bounds."""
    return VariableSpec(name, "mm", "uniform", lower, upper, (lower + upper) / 2, (upper - lower) / math.sqrt(12), ())


SPECS = (
    bounded("A", 19.9, 20.1),
    bounded("B", 9.8, 10.1),
    VariableSpec("C", "mm", "normal", None, None, 5.0, 0.02, ()),
)
COLUMNS = {"A": RNG.uniform(19.9, 20.1, N), "B": RNG.uniform(9.8, 10.1, N), "C": RNG.normal(5.0, 0.02, N)}
GAP = COLUMNS["A"] - COLUMNS["B"] - COLUMNS["C"]


def test_a_stack_of_three_dimensions_in_closed_form():
    """Gap = A - B - C: the middle of the tolerances, their sum, their root sum of squares and that of the sigmas."""
    found = linear_stack(GAP, COLUMNS, SPECS, (4.8, None), command=lambda at: f"A={at['A']:g} C={at['C']:g}")
    assert found.nominal == pytest.approx(20.0 - 9.95 - 5.0)
    half = (0.1, 0.15, 0.06)
    assert found.worst == pytest.approx((5.05 - sum(half), 5.05 + sum(half)))
    assert found.rss == pytest.approx((5.05 - math.hypot(*half), 5.05 + math.hypot(*half)))
    assert found.rss_sigma == pytest.approx(math.hypot(0.2 / math.sqrt(12), 0.3 / math.sqrt(12), 0.02))
    assert found.bender == pytest.approx((5.05 - 1.5 * math.hypot(*half), 5.05 + 1.5 * math.hypot(*half)))
    assert (found.shift, found.inertia) == (pytest.approx(0.0, abs=1e-12), pytest.approx(found.rss_sigma))
    assert [(v.variable, v.bounded) for v in found.variables] == [("B", True), ("A", True), ("C", False)]
    assert found.variables[1].slope == pytest.approx(1.0)
    assert (found.shape, found.exceeded, found.within) == ("linear", False, False)
    assert found.sampled == (GAP.min(), GAP.max())
    assert found.lowest_corner == pytest.approx({"A": 19.9, "B": 10.1, "C": 5.06})
    assert found.highest_command == "A=20.1 C=4.94"


def test_shifts_of_the_means_add_up_to_the_inertia_of_the_response():
    """Gap = A - B - C with A 0.03 and B -0.05 off their middles: 0.08, beside the root sum of squares of the sigmas."""
    specs = (replace(SPECS[0], mean=20.03, std=0.02), replace(SPECS[1], mean=9.9, std=0.03), SPECS[2])
    columns = {v.name: RNG.normal(v.mean, v.std, N) for v in specs}
    found = linear_stack(columns["A"] - columns["B"] - columns["C"], columns, specs)
    assert found.shift == pytest.approx(0.08)
    assert found.inertia == pytest.approx(math.hypot(0.08, 0.02, 0.03, 0.02))
    assert found.nominal + found.shift == pytest.approx(20.03 - 9.9 - 5.0)


def test_a_curved_response_is_called_curved():
    """The response A'^2 has no slope: its samples go beyond the worst case by slopes, and both are said."""
    x = (COLUMNS["A"] - 20.0) / 0.1
    found = linear_stack(x**2, COLUMNS, SPECS)
    assert found.shape == "curved"
    assert found.explained < 0.1
    assert found.explained_curved == pytest.approx(1.0)
    assert found.exceeded
    assert found.within is None


def test_jumps_are_neither_plane_nor_curve():
    """A response that jumps: not linear, and no square explains it."""
    found = linear_stack(np.sign(np.sin(60 * COLUMNS["A"])), COLUMNS, SPECS)
    assert found.shape == "not linear"
    assert found.explained_curved < 0.97
    assert not found.reliable
    noise = linear_stack(RNG.normal(size=N), COLUMNS, SPECS, (-9.0, 9.0))
    assert (noise.shape, noise.within) == ("not linear", None)


def test_correlations_enter_both_roots_and_not_the_worst_case():
    """Two variables that go together: the sigma of A - B shrinks to that of their difference."""
    z = RNG.normal(size=(2000, 2)) @ np.linalg.cholesky([[1, 0.8], [0.8, 1]]).T
    specs = [VariableSpec(name, "mm", "normal", None, None, 0.0, 1.0, ()) for name in ("A", "B")]
    columns = {"A": z[:, 0], "B": z[:, 1]}
    found = linear_stack(z[:, 0] - z[:, 1], columns, specs, correlated=True)
    assert found.rss_sigma == pytest.approx(math.sqrt(2 - 1.6), rel=0.05)
    assert np.diff(found.rss)[0] == pytest.approx(6 * math.sqrt(2 - 1.6), rel=0.05)
    assert np.diff(found.worst)[0] == pytest.approx(12.0)


def test_one_bound_and_none():
    """A variable with one bound ends there on one side, and three standard deviations from the mean on the other."""
    half = VariableSpec("A", "mm", "lognormal", 0.0, None, 0.5, 0.1, ())
    assert tolerance_of(half) == pytest.approx((0.0, 0.8))
    assert tolerance_of(SPECS[2]) == pytest.approx((4.94, 5.06))


def test_constants_missing_values_and_few_samples():
    """A constant keeps its value, rows without a value are left out, and too few samples give no slopes."""
    fixed = VariableSpec("D", "mm", "constant", 3.0, 3.0, 3.0, 0.0, ())
    columns = COLUMNS | {"D": np.full(N, 3.0)}
    holes = np.where(np.arange(N) % 7 == 0, np.nan, GAP)
    found = linear_stack(holes, columns, (*SPECS, fixed))
    assert found.n == np.isfinite(holes).sum()
    assert found.worst == pytest.approx((5.05 - 0.31, 5.05 + 0.31))
    assert found.lowest_corner["D"] == 3.0
    flat = linear_stack(np.full(N, 7.0), columns, SPECS)
    assert (flat.shape, flat.worst, flat.explained) == ("constant", (7.0, 7.0), None)
    assert linear_stack(GAP[:12], {name: x[:12] for name, x in COLUMNS.items()}, SPECS) is None
    assert linear_stack(GAP, columns, (fixed,)) is None


@pytest.mark.slow
def test_the_page_says_what_is_linear_and_where_it_fails():
    """Every response has its row and the two runs that check it; corners and grids have none."""
    table, spec = c60_table(300), c60_spec(300)
    analysis = analysis_of(table, spec)
    page = render_html(analysis)
    assert "Worst case,<br>linear" in page
    assert "Nothing was simulated at the ends" in page
    assert {r.spec.name: r.stack.shape for r in analysis.responses}["FC-6"] == "curved"
    assert {r.spec.name: r.stack.shape for r in analysis.responses}["latch_overlap"] == "not linear"
    assert "not reliable" in page
    assert "a sample lies beyond this worst case" in page
    assert "samples = 129" in page
    command = analysis.responses[0].stack.highest_command
    assert command.startswith("clearcap simulate c60 --set J1=0.1")
    assert command in page
    assert all(r.stack is None for r in analysis_of(table, c60_spec_of("grid")).responses)


def c60_spec_of(sampler):
    """Return the spec of a campaign with another sampler."""
    return replace(c60_spec(300), **drawn_by(sampler))


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
