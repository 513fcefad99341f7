"""The card's lines on the energy that steps create and lose, and on bodies that turn far in one."""

import numpy as np
import pyarrow as pa
import pytest

from tests.reporting.synthetic import analysis_of, c60_spec, c60_table
from tests.reporting.trust.test_evidence import line

N = 40


def table_with(**columns: float) -> pa.Table:
    """Return rows in which sample 7 has the given numbers, and all others small ones."""
    table = c60_table(N)
    for name in ("created_energy", "lost_energy", "max_kinetic_energy", "max_turn"):
        numbers = np.full(N, 2.0 if name == "max_kinetic_energy" else 1e-3)
        numbers[7] = columns.get(name, numbers[7])
        table = table.append_column(name, pa.array(numbers))
    if "settled" in columns:
        at = table.schema.get_field_index("settled")
        table = table.set_column(at, "settled", pa.array(np.arange(N) != 9))
    return table


@pytest.mark.parametrize(
    ("columns", "level", "share"),
    [
        ({}, "good", 5e-4),
        ({"created_energy": 0.5}, "attention", 0.25),
        ({"lost_energy": 0.5}, "good", 0.25),
        ({"lost_energy": 0.5, "settled": 0.0}, "attention", 0.25),
        ({"lost_energy": np.nan}, "bad", None),
    ],
)
def test_energy_is_a_share_of_the_largest_kinetic_energy(columns, level, share):
    """What is lost counts unless all runs end at rest."""
    found = line(analysis_of(table_with(**columns), c60_spec(N)), "Energy")
    assert (found.level, found.value) == (level, share if share is None else pytest.approx(share))


@pytest.mark.parametrize(("turn", "level"), [(0.49, "good"), (2.0, "bad")])
def test_a_body_that_turns_far_in_a_step(turn, level):
    """The bound is that of adaptive steps."""
    assert line(analysis_of(table_with(max_turn=turn), c60_spec(N)), "Rotation in a step").level == level


def test_rows_of_earlier_builds_have_no_such_lines():
    """Nothing is said of what nobody measured."""
    names = {check.name for check in analysis_of(c60_table(N), c60_spec(N)).trust}
    assert not names & {"Energy", "Rotation in a step"}
