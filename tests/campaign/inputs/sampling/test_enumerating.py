"""Samplers that draw nothing at random: corners, grids, tables."""

import itertools

import pytest
from pydantic import ValidationError

from campaign.inputs.sampling import draw
from tests.campaign.inputs.sampling.campaigns import UNIT, J, spec


def test_corners_are_every_combination_of_ends_and_the_middle():
    """Bit j of the sample number is the end of variable j; any piece of them is the same as in the whole."""
    ranges = {"a": (0.0, 1.0), "b": (2.0, 4.0), "c": (-1.0, 1.0)}
    variables = {name: {"distribution": "uniform", "lower": low, "upper": high} for name, (low, high) in ranges.items()}
    campaign = spec(variables, samples=9, sampler="worst_case")
    whole = draw(campaign, 0, 9)
    rows = list(zip(*whole.values(), strict=True))
    assert set(rows[:8]) == set(itertools.product(*ranges.values()))
    assert rows[5] == (1.0, 2.0, 1.0)
    assert rows[8] == (0.5, 3.0, 0.0)
    piece = draw(campaign, 3, 4)
    assert all((piece[name] == whole[name][3:7]).all() for name in variables)


def test_grid_is_every_combination_of_levels():
    """Levels by number from end to end, or as given; a constant needs none; any piece is that of the whole."""
    variables = {"a": UNIT, "k": {"distribution": "constant", "value": 9.0}, "b": J}
    campaign = spec(variables, samples=6, sampler="grid", grid={"b": [0.03, 0.05], "a": 3})
    whole = draw(campaign, 0, 6)
    rows = list(zip(*whole.values(), strict=True))
    assert sorted(rows) == sorted(itertools.product([0.0, 0.5, 1.0], [9.0], [0.03, 0.05]))
    piece = draw(campaign, 2, 3)
    assert all((piece[name] == whole[name][2:5]).all() for name in variables)


def test_list_is_the_users_table():
    """Row i is sample i; columns that are no variable were left out when it was read."""
    columns = {"b": [0.03, 0.05, 0.04], "a": [0.0, 0.5, 1.0]}
    campaign = spec({"a": UNIT, "b": J}, samples=2, sampler="list", table={"columns": columns})
    assert {name: x.tolist() for name, x in draw(campaign, 1, 1).items()} == {"a": [0.5], "b": [0.05]}
    assert list(draw(campaign, 0, 2)) == ["a", "b"]


@pytest.mark.parametrize("sampler", ["worst_case", "grid", "list"])
def test_batches_are_not_passed_over(sampler):
    """A sampler that draws nothing refuses variables that vary by production batch."""
    more = {"grid": {"grid": {"a": 2}}, "list": {"table": {"columns": {"a": [0.5]}}}}.get(sampler, {})
    with pytest.raises(ValidationError, match=r"variables\.a\.batch"):
        spec({"a": {**UNIT, "batch": {"size": 2, "std": 0.01}}}, samples=1, sampler=sampler, **more)
