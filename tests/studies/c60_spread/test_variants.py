"""The variants of the study: each changes something, and no two the same."""

import pytest

from studies.c60_spread import SHIPPED, variants

pytestmark = pytest.mark.slow

ALL = variants()


def test_variants_differ():
    """No two change the same, and none but the first changes nothing."""
    changes = [
        repr((v.tables, v.values, v.varied, v.speeds, v.clearances, v.correlation, v.bench, v.response, v.step))
        for v in ALL
    ]
    assert len(set(changes)) == len(ALL) == len({v.name for v in ALL})
    assert ALL[0].name == SHIPPED


def test_columns_are_of_clearances_alone():
    """A column of the tables of all responses changes how clearances are drawn, and nothing else."""
    columns = [v for v in ALL if v.heading]
    assert len({v.heading for v in columns}) == len(columns) > 3
    for v in columns:
        assert v.clearances or v.correlation
        others = (v.tables, v.values, v.varied, any(v.speeds), v.bench, v.step)
        assert not any(others)
