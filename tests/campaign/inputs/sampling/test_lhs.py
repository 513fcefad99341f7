"""Latin hypercubes."""

import numpy as np
import pytest

from campaign.inputs.sampling import draw
from tests.campaign.inputs.sampling.campaigns import UNIT, spec
from tests.campaign.statistics import strata


@pytest.mark.parametrize("samples", [1, 7, 400, 1000])
def test_lhs_has_one_sample_in_each_stratum(samples):
    """Every one-dimensional projection, whatever the number of samples."""
    drawn = draw(spec({"a": UNIT, "b": UNIT}, samples=samples, sampler="lhs"), 0, samples)
    for u in drawn.values():
        assert (strata(u, samples) == 1).all()
    assert samples < 7 or not np.array_equal(drawn["a"], drawn["b"])
