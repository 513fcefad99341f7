"""Fixtures of the report tests."""

from collections.abc import Callable
from dataclasses import replace

import pyarrow as pa
import pytest

from reporting import ReportSpec
from tests.fitted_once import fitted_once as fitted_once  # a fixture of all tests below
from tests.reporting.synthetic import c60_spec, c60_table


@pytest.fixture
def campaign() -> Callable[..., tuple[pa.Table, ReportSpec]]:
    """Return a maker of (table, spec); keywords replace fields of the spec."""

    def make(n: int = 60, failures: int = 0, **changes: object) -> tuple[pa.Table, ReportSpec]:
        return c60_table(n, failures), replace(c60_spec(n), **changes)

    return make
