"""Settings of whatif: another kind of distribution takes what it lacks from the old one, and says so."""

import math

import pytest

from campaign.errors import SpecError
from campaign.inputs.distributions import DISTRIBUTIONS
from clearcap.questions.whatif import changed_variables
from tests.each import each

STANDS_ALONE = {
    "poisson": "rate",
    "geometric": "probability",
    "empirical": "values",
    "selective": "fit",
    "position": "zone",
}


@each("kind", [kind for kind in DISTRIBUTIONS if kind not in STANDS_ALONE])
@each("name", ["J1", "preload"])
def test_any_kind_can_be_swapped_in(campaign, kind, name):
    """The bounds stay, or mean and sigma do; what was taken from before is said."""
    old = campaign.spec.variables[name]
    found = changed_variables(campaign.spec, [f"{name}.distribution={kind}"])
    if not found.variables:
        assert old.distribution == kind
        return
    new = found.variables[name]
    assert new.distribution == kind
    low, high = new.support()
    assert old.support()[0] <= low <= high <= old.support()[1]
    if kind not in ("constant", "exponential"):
        assert (low, high) == old.support()
    assert new.moments()[0] == pytest.approx(old.moments()[0], rel=0.02)
    (said,) = found.assumptions
    assert f"{name} is now" in said
    assert f"sigma was {old.moments()[1]:.4g} and is {new.moments()[1]:.4g}" in said


@pytest.mark.parametrize(("kind", "key"), STANDS_ALONE.items())
def test_what_no_old_distribution_can_give_is_named(campaign, kind, key):
    """A rate, a probability or measured values are to be given in the same command."""
    with pytest.raises(SpecError, match=key):
        changed_variables(campaign.spec, [f"J1.distribution={kind}"])


def test_no_bounds_no_matter(campaign):
    """From an unbounded law, a uniform and a triangular one get the same mean and sigma; a beta wants its ends."""
    free = changed_variables(campaign.spec, ["J1.distribution=normal", "J1.lower=", "J1.upper="]).variables["J1"]
    spec = campaign.spec.model_copy(update={"variables": {**campaign.spec.variables, "J1": free}})
    for kind in ("uniform", "triangular", "gamma", "lognormal", "weibull", "exponential"):
        new = changed_variables(spec, [f"J1.distribution={kind}"]).variables["J1"]
        assert new.moments() == pytest.approx((0.07, 0.0175), rel=1e-6)
    with pytest.raises(SpecError, match="lower: missing"):
        changed_variables(spec, ["J1.distribution=beta"])


def test_another_set_of_parameters_replaces_the_old_one(campaign):
    """Tolerance and Cpk in place of mean and std; the same key of another kind means another thing and goes."""
    found = changed_variables(campaign.spec, ["J1.nominal=0.07", "J1.tolerance=0.05", "J1.cpk=1.25"])
    assert found.variables["J1"].scale == pytest.approx(0.05 / 3.75)
    assert "no longer used: mean, std" in found.assumptions[0]
    drawn = changed_variables(campaign.spec, ["J1.fit=100 F8/h9", "J1.cpk=1.25"])  # no clearance of its old bounds
    assert drawn.variables["J1"].support() == pytest.approx((0.018, 0.0885))
    spec = campaign.spec.model_copy(update={"variables": {**campaign.spec.variables, **drawn.variables}})
    better = changed_variables(spec, ["J1.cpk=1.67"]).variables["J1"]
    assert (better.fit, better.support()) == ("100 F8/h9", drawn.variables["J1"].support())
    given = {"distribution": "gamma", "shape": 16.0, "scale": 0.004375}
    spec = changed_variables(campaign.spec, [f"J1.{key}={x}" for key, x in given.items()]).variables["J1"]
    gamma = campaign.spec.model_copy(update={"variables": {"J1": spec}})
    for settings in (["J1.std=0.0175"], ["J1.distribution=weibull"]):
        new = changed_variables(gamma, settings).variables["J1"]
        assert new.moments() == pytest.approx(spec.moments(), rel=0.03)
    assert changed_variables(campaign.spec, ["J1.std=0.01"]).assumptions == ()


def test_what_is_written_stays(campaign):
    """A key of the command is never replaced, and a target is no distribution."""
    new = changed_variables(campaign.spec, ["J1.distribution=uniform", "J1.lower=0.02"]).variables["J1"]
    assert (new.lower, new.upper) == (0.02, 0.13)
    assert new.moments()[1] == pytest.approx(0.11 / math.sqrt(12))
    with pytest.raises(SpecError, match="needs a new campaign"):
        changed_variables(campaign.spec, ["J1.target=J2"])


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("J9.std=0.01", "VARIABLE one of J1, preload"),
        ("J1=0.01", "allowed is VARIABLE.KEY=VALUE"),
        ("J1.sigma=0.01", "unknown key"),
        ("J1.std=-1", "variables.J1.std = -1"),
        ("J1.std=wide", "must be a number"),
        ("preload.lower=2.0", "not below upper"),
        ("J1.distribution=gauss", "unknown distribution"),
    ],
)
def test_a_setting_that_cannot_be_is_one_message(campaign, setting, said):
    """It names the key, and what is allowed."""
    with pytest.raises(SpecError, match="--set") as error:
        changed_variables(campaign.spec, [setting])
    assert said in str(error.value)
