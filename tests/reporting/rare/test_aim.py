"""Where importance sampling aims: centres of rejects from plain runs, from weighted ones, and from a model of them."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import chi2, norm, truncnorm

from reporting.errors import ReportError
from reporting.rare.aim import MOST_AIMS, Target, aims, find_targets
from reporting.rare.rare_rejects import rare_share
from tests.reporting.rare.test_rare_rejects import LIMIT, ONE_PPM, draws_of, scores_of

NAMES = "abcdefg"
EVENLY = np.ones(7) / np.sqrt(7.0)


def plain(dimensions, n=2000, seed=1):
    """Return standard scores and weights of plain runs."""
    return np.random.default_rng(seed).standard_normal((n, dimensions)), np.ones(n)


def curved_share(curvature, dimensions, limit):
    """Return the share of x0 - curvature * sum of the other squares above a limit."""
    k = dimensions - 1
    return quad(lambda s: norm.sf(limit + curvature * s) * chi2.pdf(s, k), 0.0, chi2.isf(1e-14, k), points=[k / 2, k])[
        0
    ]


def tables(found):
    """Return components as a campaign file has them."""
    named = [(aim, {k: z for k, z in zip(NAMES, aim.centre, strict=False) if z}) for aim in found]
    return [{"share": 0.999 * a.share, "scale": a.scale} | ({"shift": shift} if shift else {}) for a, shift in named]


def test_a_model_of_plain_runs_finds_the_design_point():
    """A sum of 7 variables, 1 ppm beyond its limit: the centre is where rejects are, from 2,000 runs without any."""
    z, w = plain(7)
    [target] = find_targets(z, w, {"y": z @ EVENLY}, {"y": (None, LIMIT)})
    [(centre, part)] = target.centres
    assert np.linalg.norm(centre - 4.95 * EVENLY) < 0.5  # the mean of a normal score beyond 4.753 is 4.95
    assert target.ppm == pytest.approx(1.0, rel=0.3)
    assert (part, target.by) == (1.0, "quadratic model of 2000 runs, R2 1.000")


def test_a_limit_that_curves_away_is_found_in_many_variables():
    """x0 - 0.2 sum x_i^2 in 30 variables, 300 ppm beyond: its rejects are near the middle of all scores but one."""
    z, w = plain(30)
    y = z[:, 0] - 0.2 * np.sum(z[:, 1:] ** 2, axis=1)
    limit = brentq(lambda t: curved_share(0.2, 30, t) - 3e-4, -20.0, 5.0)
    [target] = find_targets(z, w, {"y": y}, {"y": (None, limit)})
    assert target.ppm == pytest.approx(300.0, rel=0.3)
    [(centre, _)] = target.centres
    assert centre[0] > 1.5
    assert np.abs(centre[1:]).max() < 0.3


def test_rejects_in_all_directions_have_one_wide_component():
    """A sphere in 20 variables, 2 ppm outside: no centre, and a spread at which half of its runs are outside."""
    z, w = plain(20)
    radius = np.sqrt(chi2.isf(2e-6, 20))
    [target] = find_targets(z, w, {"y": np.sum(z * z, axis=1)}, {"y": (None, radius**2)})
    assert target.ppm == pytest.approx(2.0, rel=0.5)
    assert target.centres == (((0.0,) * 20, 1.0),)
    assert target.scale == pytest.approx(radius / np.sqrt(20.0), rel=0.05)
    found = aims((target,), 20)
    assert [aim.scale for aim in found] == [target.scale, 2.0]


def test_rejects_that_are_there_need_no_model():
    """Of weighted runs it takes the rejects: a step, which no model of plain runs can see."""
    z, own = scores_of([{"share": 0.9, "scale": 2.0}], 4000, 1, 3)
    points = np.column_stack([z[name] for name in NAMES[:3]])
    [target] = find_targets(
        points, np.exp(own["log_weight"]), {"y": np.where(points[:, 0] > 4.5, 1.0, 0.0)}, {"y": (None, 0.5)}
    )
    [(centre, _)] = target.centres
    assert centre[0] == pytest.approx(4.8, abs=0.3)
    assert np.abs(centre[1:]).max() < 0.8
    assert "rejects" in target.by


def test_each_direction_has_a_component():
    """Either of two variables far out: two centres of one limit. Both sides of a sum: one for each limit."""
    z, own = scores_of([{"share": 0.9, "scale": 2.0}], 4000, 2)
    points, w = np.column_stack([z["a"], z["b"]]), np.exp(own["log_weight"])
    [either] = find_targets(points, w, {"y": points.max(axis=1)}, {"y": (None, LIMIT)})
    assert len(either.centres) == 2
    assert sorted(np.argmax(centre) for centre, _ in either.centres) == [0, 1]
    below, above = find_targets(points, w, {"y": points @ [0.6, 0.8]}, {"y": (-LIMIT, LIMIT)})
    assert np.dot(below.centres[0][0], above.centres[0][0]) < -16.0
    found = aims((below, above), 2)
    assert [aim.share for aim in found] == pytest.approx([0.4, 0.4, 0.1], rel=0.1)
    assert (found[-1].scale, found[-1].centre) == (2.0, (0.0, 0.0))


def test_a_model_of_the_variables_values_holds_farther_out():
    """A sum of normal variables cut at 3.4 sigma: its scores run away from it, where it comes to 1 ppm."""
    z, w = plain(7, 500)

    def inputs(scores):
        return truncnorm.ppf(norm.cdf(scores), -3.4, 3.4)

    limit = 12.5
    [target] = find_targets(z, w, {"y": inputs(z).sum(axis=1)}, {"y": (None, limit)}, inputs)
    [(centre, _)] = target.centres
    # The centre is where the rejects of 200,000 runs around it are.
    near = np.random.default_rng(2).standard_normal((200_000, 7)) + centre
    weights = np.exp(0.5 * np.dot(centre, centre) - near @ centre) * (inputs(near).sum(axis=1) > limit)
    assert np.linalg.norm(weights @ near / weights.sum() - centre) < 0.5
    assert target.ppm == pytest.approx(1e6 * weights.mean(), rel=0.3)


def test_the_worse_side_gets_more_runs():
    """As the root of the expected shares, so that an estimate that is wrong by a factor leaves enough for the other."""
    z, w = plain(3)
    targets = find_targets(z, w, {"y": z[:, 0], "x": z[:, 1]}, {"y": (-5.2, 4.3), "x": (None, 4.5)})
    found = aims(targets, 3)
    assert sum(aim.share for aim in found) == pytest.approx(0.9)
    assert found[2].share == pytest.approx(0.4)  # half of the aimed runs for each response
    assert found[1].share / found[0].share == pytest.approx((norm.sf(4.3) / norm.sf(5.2)) ** 0.5, rel=0.3)


def test_a_campaign_has_no_more_components_than_it_may():
    """The least are left out, and their runs go to the others."""
    centres = tuple(((3.0 * k, 0.0), 1.0 / 200.0) for k in range(200))
    found = aims((Target("y", 1.0, "", centres),), 2)
    assert len(found) == MOST_AIMS + 1
    assert sum(aim.share for aim in found) == pytest.approx(0.9)


def test_limits_that_need_no_aim():
    """A share that plain runs see, and one that never occurs: only a wide component is left, for what nobody knows."""
    z, w = plain(2)
    often, never = find_targets(z, w, {"y": z[:, 0], "x": z[:, 1]}, {"y": (None, 1.5), "x": (-9.0, None)})
    assert often.centres == never.centres == ()
    assert [(aim.share, aim.scale) for aim in aims((often, never), 2)] == [(0.9, 2.0)]


def test_two_limits_with_one_centre_share_a_component():
    """Responses that fail together are aimed at together."""
    z, w = plain(2)
    y = z @ [0.6, 0.8]
    found = aims(find_targets(z, w, {"y": y, "x": 2.0 * y}, {"y": (None, 4.5), "x": (None, 9.0)}), 2)
    assert [aim.share for aim in found] == pytest.approx([0.8, 0.1])
    assert found[0].source.startswith("y above 4.5: quadratic")
    assert "x above 9: quadratic" in found[0].source


def test_too_few_values():
    """A model needs three values a coefficient; failed runs are none."""
    z, w = plain(2, 20)
    y = np.where(np.arange(20) < 8, z[:, 0], np.nan)
    with pytest.raises(ReportError, match=r"8 values of y.*\b9\b"):
        find_targets(z, w, {"y": y}, {"y": (None, 3.0)})


SCENES = {  # response of the scores, upper limit, share beyond it
    "sum of 7": (lambda z: z @ EVENLY, 7, LIMIT, ONE_PPM),
    "either of 2": (lambda z: z.max(axis=1), 2, LIMIT, 2 * ONE_PPM),
    "a step": (lambda z: np.where(z[:, 0] > 4.5, 1.0, 0.0), 3, 0.5, norm.sf(4.5)),
    "distance": (lambda z: np.hypot(z[:, 0], z[:, 1]), 2, 5.0, np.exp(-12.5)),
    "lognormal": (lambda z: np.exp(0.5 * z @ EVENLY), 7, np.exp(0.5 * LIMIT), ONE_PPM),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_plain_runs_then_3000_then_20000_know_some_ppm(scene):
    """The user's way: 2,000 plain runs, 3,000 that aim by them, 20,000 that aim by those: an interval within 20 %."""
    response, d, limit, truth = SCENES[scene]
    z, w = plain(d, seed=5)
    for n in (3000, 20_000):
        components = tables(aims(find_targets(z, w, {"y": response(z)}, {"y": (None, limit)}), d))
        scores, own = scores_of(components, n, n, d)
        z, w = np.column_stack([scores[name] for name in NAMES[:d]]), np.exp(own["log_weight"])
    share = rare_share(response(z) > limit, draws_of(components, own))
    low, high = share.interval
    assert low < 1e6 * truth < high
    assert 0.8 * share.ppm < low < high < 1.2 * share.ppm
