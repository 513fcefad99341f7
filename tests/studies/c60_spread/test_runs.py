"""The runs of the study: every variant is a mechanism that can start, with the clearances that its name says."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from campaign.inputs.sampling import draw
from campaign.spec.load import load_campaign
from engine import check
from engine.mechanism import get_value
from studies.c60_spread import ENDS, UNIFORM, Variant, clearances, mechanism_of, run, variants
from tests.each import each

pytestmark = pytest.mark.slow


@each("variant", variants())
def test_every_variant_can_start(variant):
    """With its first sample's clearances and its values; it has its response."""
    mechanism = mechanism_of(variant, np.random.default_rng(1))
    check(mechanism, {joint: float(x[0]) for joint, x in clearances(variant, 1).items()} | variant.values)
    assert variant.response in mechanism.responses
    assert all(get_value(mechanism, key) for key in variant.varied)


def test_the_shipped_samples_are_the_campaigns():
    """The first row is the campaign `c60` itself."""
    ours, campaigns = clearances(Variant("v"), 50), draw(load_campaign("c60").spec, 0, 50)
    assert list(ours) == list(campaigns)
    assert all(np.array_equal(ours[joint], campaigns[joint]) for joint in ours)


@pytest.mark.parametrize("rank", [0.3, 0.9])
def test_correlated_clearances(rank):
    """Every pair has the rank correlation, and each clearance keeps its distribution."""
    drawn = np.array([*clearances(Variant("v", correlation=rank), 4000).values()])
    pairs = spearmanr(drawn, axis=1).statistic[np.triu_indices(7, 1)]
    assert pairs == pytest.approx(rank, abs=0.06)
    assert drawn.mean(axis=1) == pytest.approx(0.07, abs=1e-3)
    assert drawn.std(axis=1) == pytest.approx(0.0175, abs=6e-4)


@pytest.mark.parametrize("distribution", [{}, UNIFORM, ENDS])
def test_shared_clearances(distribution):
    """All joints have one clearance, that of J1 in the same variant without correlation."""
    shared = clearances(Variant("v", correlation=1.0, clearances=distribution), 100)
    alone = clearances(Variant("v", clearances=distribution), 100)
    assert all(np.array_equal(x, alone["J1"]) for x in shared.values())
    assert not np.array_equal(alone["J1"], alone["J2"])


def test_uniform_clearances_have_the_same_ranks():
    """Variants are compared sample by sample: another distribution does not exchange samples."""
    normal, uniform = clearances(Variant("v"), 300)["J3"], clearances(Variant("v", clearances=UNIFORM), 300)["J3"]
    assert np.array_equal(np.argsort(normal), np.argsort(uniform))
    assert uniform.min() < 0.02
    assert uniform.max() > 0.12


def test_random_velocities():
    """Each free body gets six numbers of the standard deviations given; the case stays."""
    variant, rng = Variant("v", speeds=(0.5, 0.05)), np.random.default_rng(3)
    bodies = [mechanism_of(variant, rng).bodies for _ in range(60)]
    assert set(bodies[0]["case"].velocity) == {0.0}
    linear = np.array([[b.velocity for b in m.values() if not b.fixed] for m in bodies])
    angular = np.array([[b.angular_velocity for b in m.values() if not b.fixed] for m in bodies])
    assert linear.shape == angular.shape == (60, 7, 3)
    assert linear.std() == pytest.approx(0.5, rel=0.06)
    assert angular.std() == pytest.approx(0.05, rel=0.06)


def test_a_run_that_is_no_breaker_in_on_has_no_responses():
    """With 0.4 mm in all joints the contact does not press, and the run counts as failed."""
    assert run(Variant("v"), 0, dict.fromkeys([f"J{i}" for i in range(1, 8)], 0.4)) == {}
