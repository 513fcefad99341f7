"""Correlated variables keep their distributions and have the rank correlations that were asked for."""

import numpy as np
import pytest
from pydantic import ValidationError

from campaign.inputs.sampling import draw
from campaign.inputs.sampling.inverse_transform import correlated
from tests.campaign.inputs.sampling.campaigns import DRAWING, UNIT, J, seven, spec
from tests.campaign.statistics import check_rank_correlation


def test_uncorrelated_variables_do_not_matter():
    """Correlating two variables leaves the first of them and all others as they were."""
    free, tied = seven(), seven(correlations=[["J4", "J2", 0.5]])
    drawn, before = draw(tied, 0, 400), draw(free, 0, 400)
    assert [name for name in before if not np.array_equal(drawn[name], before[name])] == ["J4"]


@pytest.mark.parametrize("sampler", DRAWING)
def test_rank_correlations_are_those_asked_for(sampler):
    """Spearman's correlation is the one given, of continuous variables of any shape; without an entry there is none."""
    variables = {name: {**J, "target": name} for name in ("a", "b")}
    variables["c"] = {"distribution": "lognormal", "log_mean": 0.0, "log_std": 1.0}
    wanted = {("a", "b"): 0.7, ("b", "c"): -0.5, ("a", "c"): -0.2}
    triples = [[*pair, rank] for pair, rank in wanted.items()]
    drawn = draw(spec(variables, samples=65_536, sampler=sampler, correlations=triples), 0, 65_536)
    for (a, b), rank in wanted.items():
        check_rank_correlation(drawn[a], drawn[b], rank)
    free = draw(spec(variables, samples=65_536, sampler=sampler), 0, 65_536)
    for a, b in wanted:
        check_rank_correlation(free[a], free[b], 0.0)


def test_extreme_correlations_stay_inside():
    """A mixed score that no double can tell from certainty is still inside (0, 1)."""
    largest = np.array([2.0**-53, 1.0 - 2.0**-53])
    mixed = correlated({"a": largest, "b": largest, "c": largest}, (("a", "c", 0.68), ("b", "c", 0.68)))
    assert 0.0 < mixed["c"].min() < mixed["c"].max() < 1.0


def test_the_remedy_of_impossible_correlations_works():
    """Scaled as the message says, they can hold; a little more, and they cannot."""
    triples = [["a", "b", 0.9], ["b", "c", 0.9], ["a", "c", -0.9]]
    variables = dict.fromkeys("abc", UNIT)
    with pytest.raises(ValidationError) as caught:
        spec(variables, correlations=triples)
    scale = float(str(caught.value).split("by at most ")[1].split()[0])
    spec(variables, correlations=[[a, b, scale * r] for a, b, r in triples])
    with pytest.raises(ValidationError, match="not positive definite"):
        spec(variables, correlations=[[a, b, (scale + 0.01) * r] for a, b, r in triples])
