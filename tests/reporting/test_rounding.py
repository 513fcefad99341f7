"""A constant with rounding errors is a constant: nothing is divided by its last bits."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from reporting import capability
from reporting.format_numbers import index
from reporting.render.html import render_html
from reporting.samples import leveled
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

BITS = np.random.default_rng(0).normal(size=500)


@pytest.mark.parametrize(
    ("x", "resolution", "value"),
    [
        (1.0 + 2e-16 * BITS, 0.0, 1.0),
        (13.7 + 1e-13 * BITS, 0.0, 13.7),
        (5e-15 * BITS, 1e-11, 0.0),  # a position near 0: only the solver's tolerance tells that it is one
        (-250.0 - 5e-12 * BITS, 1e-10, -250.0),
    ],
)
def test_values_that_differ_by_rounding_are_one_value(x: np.ndarray, resolution: float, value: float) -> None:
    assert leveled(x, resolution).tolist() == [value] * 500


@pytest.mark.parametrize(
    ("x", "resolution"), [(1.0 + 1e-9 * BITS, 0.0), (5e-15 * BITS, 0.0), (1e-9 * BITS, 1e-11), (np.zeros(5), 1.0)]
)
def test_values_that_differ_by_more_are_left(x: np.ndarray, resolution: float) -> None:
    assert leveled(x, resolution) is x


def test_a_constant_with_rounding_errors_has_no_index() -> None:
    """Its spread is 25 times the distance of two doubles: before, Cpk was 3e12."""
    c = capability(13.7 + 1e-13 * BITS / 3, 13.0, 14.0)
    assert (c.std, c.cp, c.cpk, c.ppm_expected) == (0.0, None, None, None)


def test_a_response_at_rounding_level_is_named_as_such() -> None:
    """A block that stays where it is, beside a limit of 0.001: no index, histogram or cause, but its value."""
    table, spec = c60_table(500), c60_spec(500)
    at = table.schema.get_field_index("FC-1")
    table = table.set_column(at, "FC-1", pa.array(5e-15 * BITS))
    slide = replace(spec.responses[0], lsl=None, usl=0.001, resolution=1e-11)
    a = analysis_of(table, replace(spec, responses=(slide, *spec.responses[1:2])))
    r = a.responses[0]
    assert (r.verdict.word, r.capability.cpk, r.capability.mean, r.histogram) == ("constant", None, 0.0, None)
    assert 1e-14 < r.rounding < 5e-14
    assert all(i.verdict != "critical" for i in r.sensitivity.influences)
    assert "Constant, within the limits: FC-1." in a.headline
    page = " ".join(render_html(a).split())
    assert "All 500 values are 0 N but for rounding: they differ by" in page
    assert 'aria-label="Histogram of FC-1' not in page
    outside = analysis_of(table, replace(spec, responses=(replace(slide, usl=-0.001),)))
    assert (outside.responses[0].verdict.word, outside.responses[0].verdict.certain) == ("not capable", True)


@pytest.mark.parametrize(
    ("value", "text"),
    [(352009220703.352, "> 100.00"), (-352009.0, "< -100.00"), (99.5, "99.500"), (1.3299, "1.3299"), (1.0, "1.000")],
)
def test_an_index_is_never_printed_with_digits_beyond_sense(value: float, text: str) -> None:
    assert index(value) == text


def test_an_index_beyond_sense_is_a_bound_on_the_page() -> None:
    """A true spread, and limits 10,000 of its sigmas away."""
    table, spec = c60_table(200), c60_spec(200)
    far = replace(spec.responses[1], lsl=-500.0, usl=500.0)
    page = render_html(analysis_of(table, replace(spec, responses=(far,))))
    assert "Cpk &gt; 100.00" in page
    assert "&gt; 100.00 to" not in page
