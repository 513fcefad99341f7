"""What samples of one distribution are worth for another, against closed forms."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from campaign.inputs.distributions import Variable
from campaign.reports.samples_worth import samples_worth
from reporting.tolerance.reweighting import Change, weights

_DISTRIBUTION = TypeAdapter(Variable)


def made(**table):
    return _DISTRIBUTION.validate_python(table)


def normal(std, mean=0.0):
    return made(distribution="normal", mean=mean, std=std)


@pytest.mark.parametrize("factor", [1.1, 1.2, 1.3])
def test_a_wider_normal_distribution(factor):
    """E_old[w^2 (z^2 - 1)^2] is an integral of Gauss: with v = 1 / (2 - f^2), sqrt(v) (3 v^2 - 2 v + 1) / f."""
    v = 1.0 / (2.0 - factor**2)
    cost = np.sqrt(v) * (3 * v**2 - 2 * v + 1) / factor
    assert samples_worth([(normal(1.0), normal(factor))]) == pytest.approx(
        min(2.0 / cost, 1.0), rel=0.01
    )  # its grid ends at 1e-13


def test_where_the_variance_is_infinite_samples_are_worth_nothing():
    """From sqrt(2) times the sigma on, no number of samples determines the new sigma."""
    assert samples_worth([(normal(1.0), normal(1.5))]) < 1e-3
    cut = [made(distribution="truncated_normal", mean=0.0, std=s, lower=-3.0, upper=3.0) for s in (1.0, 1.5)]
    assert samples_worth([tuple(cut)]) > 0.08  # its bounds keep the weights bounded


def test_a_narrower_one_and_none():
    """No sample is worth more than a new run; two changed variables cost more than one."""
    assert samples_worth([]) == 1.0
    assert samples_worth([(normal(1.0), normal(0.7))]) == 1.0
    one, two = samples_worth([(normal(1.0), normal(1.2))]), samples_worth([(normal(1.0), normal(1.2))] * 2)
    assert two < one
    assert samples_worth([(made(distribution="poisson", rate=3.0), made(distribution="poisson", rate=3.0))]) == 1.0


def test_weights_are_refused_by_the_distributions_alone():
    """Samples whose weights look harmless are refused where the distributions say that their tail was missed."""
    ratio = np.zeros(1_000)
    assert not weights(Change(ratio)).refusal
    assert "worth 20 new runs; 30 are needed" in weights(Change(ratio, worth=0.02)).refusal
