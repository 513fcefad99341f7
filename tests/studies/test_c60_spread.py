"""The study of the C-60's spread: every variant is a mechanism that can start, and differs from the shipped one."""

import pytest

from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign
from engine import check
from engine.mechanism import get_value
from studies.c60_spread import Variant, mechanism_of, row, variants

ALL = variants()


@pytest.mark.parametrize("variant", ALL, ids=lambda variant: variant.name)
def test_every_variant_can_start(variant):
    """With its first sample's clearances and its values; it has its response."""
    spec = load_campaign("c60").spec
    mechanism = mechanism_of(variant)
    values = {name: float(x[0]) for name, x in draw(spec, 0, 1).items()} | variant.values
    check(mechanism, values)
    assert variant.response in mechanism.responses
    assert all(get_value(mechanism, key) for key in variant.varied)


def test_variants_differ():
    """No two change the same, and none but the first changes nothing."""
    changes = [repr((v.tables, v.values, v.varied, v.bench, v.response, v.step)) for v in ALL]
    assert len(set(changes)) == len(ALL) == len({v.name for v in ALL})


def test_a_row_counts_what_is_there():
    """Failed runs are left out of mean and sigma and seen in the count."""
    nan = float("nan")
    assert row(Variant("v"), [(1.0, 2.0), (nan, nan), (3.0, 4.0)]) == (
        "| v | 2 of 3 | 2.00 | 1.414 | 1.00 to 3.00 | 3.000 | 1.414 |"
    )
    assert row(Variant("v"), [(nan, nan)]) == "| v | 0 of 1 | | | | | |"
