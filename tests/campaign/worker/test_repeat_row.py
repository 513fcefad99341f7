"""A sample computed again: what makes two rows the same."""

import pytest

from campaign.spec.result_columns import ENERGY_COLUMNS
from campaign.worker.repeat_row import _same

ROW = {
    "status": "ok",
    "message": "",
    "steps": 79,
    "max_residual": 1e-9,
    "max_penetration": 4e-9,
    "max_created_energy": 2e-9,
    "created_energy": 3e-9,
    "settled": True,
    "wall_s": 0.01,
    "FC-1": 12.6,
}


def test_a_row_of_an_earlier_build_has_no_energies():
    """It is compared in what it has."""
    earlier = {name: value for name, value in ROW.items() if name not in ENERGY_COLUMNS}
    assert _same(ROW, earlier, ["FC-1"])


@pytest.mark.parametrize(("name", "same"), [("created_energy", False), ("FC-1", False), ("wall_s", True)])
def test_rows_differ_in_what_the_sample_determines(name, same):
    """One bit is enough; the time of the clock does not count."""
    assert _same(ROW | {name: ROW[name] * (1 + 1e-15)}, ROW, ["FC-1"]) == same
