"""Importance sampling: shares of a few ppm come out right for any distributions; weights are what they say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import norm

from campaign.inputs.sampling import draw, sampler_named
from tests.campaign.inputs.sampling.campaigns import BOLT, CORRELATED, INDEPENDENT, UNIT, J, spec
from tests.each import each

pytestmark = pytest.mark.bits

NORMAL = {"distribution": "normal", "mean": 0.0, "std": 1.0}
SAMPLER = sampler_named("importance")


def weighted(variables, components, samples=20_000, **keys):
    """Return the values of an importance campaign's samples and their weights."""
    campaign = spec(variables, samples, sampler="importance", importance={"components": components}, **keys)
    own = SAMPLER.own_columns(campaign, np.arange(samples))
    return draw(campaign, 0, samples), np.exp(own["log_weight"]), own["component"]


def share(weights, rejects):
    """Return the weighted share of rejects and its standard error."""
    terms = weights * rejects
    return terms.mean(), terms.std(ddof=1) / np.sqrt(terms.size)


AIMED = [{"share": 0.6, "shift": {"a": 2.7, "b": 3.6}}, {"share": 0.2, "scale": 2.0}]


def test_one_ppm_of_a_linear_response():
    """(3 a + 4 b) / 5 above 4.753 is 1 ppm, exactly; 20,000 runs know it to a few percent, over many seeds unbiased."""
    found = []
    for seed in range(20):
        x, w, _ = weighted({"a": NORMAL, "b": NORMAL}, AIMED, seed=seed)
        found.append(share(w, 0.6 * x["a"] + 0.8 * x["b"] > 4.753424))
    values, errors = np.array(found).T
    exact = norm.sf(4.753424)
    assert exact == pytest.approx(1e-6, rel=1e-3)
    assert (errors / exact).max() < 0.05  # far within 20 %
    assert np.abs((values - exact) / errors).max() < 4.0
    assert values.mean() == pytest.approx(exact, rel=4 * 0.03 / np.sqrt(20))


def test_two_regions_correlations_and_cuts():
    """Both sides of a sum of correlated, cut variables: the share is that of 4 million plain samples, some 0.1 %."""
    cut = {"distribution": "truncated_normal", "mean": 0.0, "std": 1.0, "lower": -2.5, "upper": 2.5}
    variables = {"a": cut, "b": NORMAL, "c": UNIT}
    relation = [["a", "b", 0.5]]
    components = [
        {"share": 0.4, "shift": {"a": 2.0, "b": 1.2, "c": 0.8}},
        {"share": 0.4, "shift": {"a": -2.0, "b": -1.2, "c": -0.8}},
    ]

    def rejects(x):
        total = x["a"] + x["b"] + x["c"]
        return (total > 5.6) | (total < -4.6)

    x, w, _ = weighted(variables, components, 40_000, correlations=relation)
    plain = draw(spec(variables, 4_000_000, correlations=relation, seed=3), 0, 4_000_000)
    truth = rejects(plain).mean()
    value, error = share(w, rejects(x))
    assert 1e-4 < truth < 3e-3
    assert error < 0.03 * truth
    assert abs(value - truth) < 4.0 * np.hypot(error, np.sqrt(truth / 4_000_000))


def test_moments_of_the_whole_production():
    """Weighted means of every kind of variable are those of its distribution, and the mean weight is 1."""
    components = [{"share": 0.3, "shift": {"J1": 2.0, "life": 1.0, "count": -1.0}}, {"share": 0.2, "scale": 1.4}]
    campaign = spec(INDEPENDENT, 40_000, sampler="importance", importance={"components": components})
    x, w, _ = weighted(INDEPENDENT, components, 40_000, correlations=CORRELATED)
    assert np.abs(w.mean() - 1.0) < 4.0 * w.std() / 200.0
    for name, variable in campaign.variables.items():
        mean, std = variable.moments()
        error = (w * (x[name] - mean)).std() / 200.0
        assert np.abs((w * (x[name] - mean)).mean()) <= 4.0 * error, name
        assert std == 0.0 or error > 0.0


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 399), st.integers(1, 100))
def test_any_slice_is_the_same_bits(first, count):
    """Values, components and weights of a batch are those of the whole, and so are those of scattered samples."""
    components = [{"share": 0.5, "shift": {"J1": 3.0, "life": -1.5}}, {"share": 0.3, "scale": 2.0}]
    keys = {"sampler": "importance", "importance": {"components": components}, "correlations": CORRELATED}
    campaign = spec(INDEPENDENT, **keys)
    count = min(count, 400 - first)
    whole, own = draw(campaign, 0, 400), SAMPLER.own_columns(campaign, np.arange(400))
    for name, values in draw(campaign, first, count).items():
        assert values.tobytes() == whole[name][first : first + count].tobytes()
    scattered = np.array([first + count - 1, first])
    for name, values in SAMPLER.own_columns(campaign, scattered).items():
        assert values.tobytes() == own[name][scattered].tobytes()
    assert SAMPLER.own_columns(campaign, np.zeros(0, np.int64))["component"].size == 0


PINNED = (
    [1, 2, 0, 1, 2, 2, 1, 2],
    [
        0.999497685300062,
        0.048875833639706,
        0.828122066582598,
        0.997802419718776,
        0.00668446289796695,
        0.494364263320922,
        0.999997603917017,
        0.999195289339851,
    ],
    [
        -4.73933443130937,
        -1.91882419088835,
        0.915866064650611,
        -3.48776577453119,
        -0.0946261726341507,
        0.779517612286379,
        -8.56989606666813,
        -4.67907823178742,
    ],
)


def test_drawn_values_never_change():
    """A stored campaign can be extended by a later version: components, values and weights are part of the format."""
    components = [{"share": 0.5, "shift": {"J1": 3.0}}, {"share": 0.3, "scale": 2.0}]
    keys = {"sampler": "importance", "importance": {"components": components}, "correlations": [["J1", "J2", 0.5]]}
    campaign = spec({"J1": UNIT, "J2": UNIT}, 8, **keys)
    own = SAMPLER.own_columns(campaign, np.arange(8))
    assert own["component"].tolist() == PINNED[0]
    assert draw(campaign, 0, 8)["J1"] == pytest.approx(PINNED[1], rel=1e-12)
    assert own["log_weight"] == pytest.approx(PINNED[2], rel=1e-11)


def test_the_rest_is_production():
    """Samples of component 0 are those of sampler random, to the bit; no weight exceeds 1 over their share."""
    components = [{"share": 0.5, "shift": {"J1": 3.0, "life": -1.5}}, {"share": 0.3, "scale": 2.0}]
    x, w, component = weighted(INDEPENDENT, components, 5000, correlations=CORRELATED)
    campaign = spec(INDEPENDENT, 5000, correlations=CORRELATED)
    plain = draw(campaign, 0, 5000)
    assert all(np.array_equal(x[name][component == 0], plain[name][component == 0]) for name in plain)
    assert np.bincount(component) / 5000 == pytest.approx([0.2, 0.5, 0.3], abs=0.03)
    assert w.max() <= 5.0 + 1e-12
    assert w[component == 0].max() > 4.5


def test_aimed_is_beyond_three_quarters_of_the_way():
    """A sample is aimed at if it lies that far in the direction of a component's centre; widening aims at nothing."""
    components = [{"share": 0.5, "shift": {"a": 3.0, "b": -4.0}}, {"share": 0.4, "scale": 3.0}]
    keys = {"sampler": "importance", "importance": {"components": components}}
    campaign = spec({"a": NORMAL, "b": NORMAL}, 2000, **keys)
    x, own = draw(campaign, 0, 2000), SAMPLER.own_columns(campaign, np.arange(2000))
    beyond = 0.6 * x["a"] - 0.8 * x["b"] > 0.75 * 5.0
    assert own["aimed"].tolist() == beyond.tolist()
    assert 0 < beyond.sum() < 2000


def test_far_out_values_stay_drawable():
    """Where a component reaches beyond double precision, values end at the outermost ones and nothing is infinite."""
    components = [{"share": 0.9, "shift": {"a": 8.0, "b": -8.0}, "scale": 5.0}]
    x, w, _ = weighted({"a": NORMAL, "b": NORMAL}, components, 5000)
    assert np.isfinite(x["a"]).all()
    assert np.isfinite(x["b"]).all()
    assert np.isfinite(w).all()
    assert x["a"].max() == pytest.approx(8.2, abs=0.1)


TOO_MUCH = [{"share": 0.5}, {"share": 0.46}]
REFUSED = [
    ({}, {"importance": None}, r"importance: missing; .* clearcap design"),
    ({}, {"importance": {"components": TOO_MUCH}}, r"their shares add up to 0\.96; allowed: up to 0\.95"),
    (
        {},
        {"importance": {"components": [{"share": 0.5, "shift": {"aa": 1.0}}]}},
        r"shift\.aa: no variable .* allowed: a, b",
    ),
    ({}, {"importance": {"components": [{"share": 0.5, "shift": {"k": 1.0}}]}}, r"shift\.k: .* allowed: a, b"),
    ({}, {"importance": {"components": [{"share": 0.5, "shift": {"a": 9.0}}]}}, "less than or equal to 8"),
    ({}, {"importance": {"components": []}}, "at least 1"),
    ({"bolt": BOLT}, {}, "production batch share a shift"),
    ({}, {"stop": {"response": "FC-1", "statistic": "ppm", "half_width": 1.0}}, "stop: .* have weights; remove stop"),
    ({}, {"sampler": "random"}, 'importance is only for sampler "importance"'),
]


@each(("more", "keys", "message"), REFUSED)
def test_what_cannot_be_weighted_is_refused(more, keys, message):
    """Each refusal names the key and the remedy."""
    variables = {"a": NORMAL, "b": J, "k": {"distribution": "constant", "value": 1.0}, **more}
    table = {"components": [{"share": 0.5, "shift": {"a": 1.0}}]}
    with pytest.raises(ValidationError, match=message):
        spec(variables, **{"sampler": "importance", "importance": table, **keys})
