"""Latin hypercubes, and consecutive samples that share a shift."""

import numpy as np
import pytest
from scipy.stats import norm, spearmanr

from campaign.inputs.distributions import Continuous, ProductionBatch
from campaign.inputs.sampling import draw, production_batch
from campaign.inputs.sampling.inverse_transform import uniforms
from tests.campaign.inputs.sampling.campaigns import BOLT, UNIT, J, seven, spec
from tests.campaign.statistics import SURE, check_moments, check_sample, strata


@pytest.mark.parametrize("samples", [1, 7, 400, 1000])
def test_lhs_has_one_sample_in_each_stratum(samples):
    """Every one-dimensional projection, whatever the number of samples."""
    drawn = draw(spec({"a": UNIT, "b": UNIT}, samples=samples, sampler="lhs"), 0, samples)
    for u in drawn.values():
        assert (strata(u, samples) == 1).all()
    assert samples < 7 or not np.array_equal(drawn["a"], drawn["b"])


def test_parts_come_in_batches():
    """Samples of a batch share their shift; shifts are independent and of the deviation asked for."""
    size, batches = 50, 800
    bolt = {**BOLT, "batch": {"size": size, "std": 0.2}}
    campaign = spec({"bolt": bolt, "nut": bolt}, samples=size * batches)
    drawn = {name: x.reshape(batches, size) for name, x in draw(campaign, 0, size * batches).items()}
    means = drawn["bolt"].mean(axis=1)
    assert abs(drawn["bolt"].std(axis=1, ddof=1).mean() - 0.1) < 0.001
    expected = np.hypot(0.2, 0.1 / np.sqrt(size))
    assert abs(means.std() - expected) < SURE * expected / np.sqrt(2 * batches)
    assert abs(means.mean() - 8.0) < SURE * expected / np.sqrt(batches)
    for other in (drawn["nut"].mean(axis=1), np.roll(means, 1)):
        assert abs(spearmanr(means, other).statistic) < SURE / np.sqrt(batches)


def test_a_batch_of_one_is_the_mixture():
    """With a new shift for every part, parts are independent draws of what `cdf` and `moments` describe."""
    tables = {"size": 1, "std": 0.02}
    variables = {"cut": {**J, "batch": tables}, "free": {**BOLT, "batch": tables}}
    campaign = spec(variables, samples=20_000)
    for name, values in draw(campaign, 0, 20_000).items():
        check_sample(values, campaign.variables[name])
        check_moments(values, campaign.variables[name])
        assert isinstance(campaign.variables[name], Continuous)


def test_shifts_have_their_own_stream():
    """A variable's shift is not a function of its own values: batch 0 and sample 0 use different words."""
    batch = ProductionBatch(size=1, std=1.0)
    shift = [batch.shifts(uniforms(seed, "bolt", 0, 1, "batch\n"))[0] for seed in range(400)]
    value = [norm.ppf(uniforms(seed, "bolt", 0, 1))[0] for seed in range(400)]
    assert abs(spearmanr(shift, value).statistic) < SURE / 20.0


def test_production_batch_of_a_sample():
    """Numbers go up where any variable begins a new batch; without batches there are none."""
    sizes = [4, 6]
    variables = {f"v{n}": {**BOLT, "batch": {"size": n, "std": 0.1}} for n in sizes}
    sample = np.arange(30)
    number = production_batch(spec(variables), sample)
    assert number.tolist() == [sum(1 for k in range(1, i + 1) if k % 4 == 0 or k % 6 == 0) for i in range(30)]
    assert production_batch(spec(variables), sample[20:]).tolist() == number[20:].tolist()
    assert production_batch(spec({"bolt": BOLT}), np.array([0, 16, 17, 400])).tolist() == [0, 0, 1, 23]
    assert production_batch(seven(), sample) is None
