"""Rare rejects of campaigns with a known share: estimates, intervals that hold, and doubts where they would not."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm

from campaign.inputs.sampling.importance import Proposal, aimed, drawn_from, log_weights, moved
from reporting import Design, ReportSpec, ResponseSpec
from reporting.capability.intervals import Estimate
from reporting.rare.rare_rejects import Draws, decisive, flat_bound, rare_rejects, rare_share, tail_shape
from reporting.render.html import render_html
from reporting.samples import read_samples
from reporting.spec import ProposalPart
from reporting.trust.evidence import rare_checks
from tests.each import each
from tests.reporting.synthetic import analysis_of

LIMIT = 4.753424  # standard scores: 1 ppm beyond
ONE_PPM = float(norm.sf(LIMIT))
WIDE = {"share": 0.1, "scale": 2.0}


def at(share, *centre):
    """Return a component with a centre in the scores a, b, c, ..."""
    return {"share": share, "shift": dict(zip("abcdefg", centre, strict=False))}


def scores_of(components, n, seed, dimensions=2):
    """Return standard scores as an importance campaign draws them, and its own columns."""
    rng, proposal = np.random.default_rng(seed), Proposal.model_validate({"components": components})
    component = drawn_from(proposal, rng.random(n))
    z = moved(proposal, component, {name: rng.standard_normal(n) for name in "abcdefg"[:dimensions]})
    return z, {"component": component, "log_weight": log_weights(proposal, z), "aimed": aimed(proposal, z)}


def parts_of(components):
    """Return components as a report has them."""
    return tuple(
        ProposalPart(c["share"], c.get("scale", 1.0), tuple((k, v) for k, v in c.get("shift", {}).items() if v))
        for c in components
    )


def share_of(limit_state, components, n, seed, dimensions=2):
    """Return the weighted share of the samples where a limit state is broken."""
    z, own = scores_of(components, n, seed, dimensions)
    return rare_share(limit_state(z), draws_of(components, own))


def draws_of(components, own):
    """Return how samples were drawn."""
    unshifted = np.isin(own["component"], [0, *(k for k, c in enumerate(components, 1) if "shift" not in c)])
    by_chance = unshifted & ~own["aimed"]
    scales = {0: 1.0} | {k: c.get("scale", 1.0) for k, c in enumerate(components, 1) if "shift" not in c}
    spreads = tuple((float(np.mean(by_chance & (own["component"] == k))), scale) for k, scale in scales.items())
    return Draws(np.exp(own["log_weight"]), by_chance, unshifted, spreads, 0.95, own["component"] == 0)


def linear(z):
    """Break the limit beyond 1 ppm of production."""
    return z["a"] > LIMIT


def series(z):
    """Return the failures of the four-branch series system (Waarts 2000; k = 7): 2.2228e-3 of production."""
    a, b = z["a"], z["b"]
    branches = (
        3.0 + 0.1 * (a - b) ** 2 - (a + b) / np.sqrt(2.0),
        3.0 + 0.1 * (a - b) ** 2 + (a + b) / np.sqrt(2.0),
        (a - b) + 7.0 / np.sqrt(2.0),
        (b - a) + 7.0 / np.sqrt(2.0),
    )
    return np.min(branches, axis=0) < 0.0


def test_one_ppm_to_a_few_percent():
    """20,000 runs, 7 variables: a standard error below 5 %, an interval within 20 % that holds, worth 1e8 runs."""
    share = share_of(linear, [at(0.8, LIMIT), WIDE], 20_000, 1, 7)
    low, high = share.interval
    assert low < 1e6 * ONE_PPM < high
    assert share.standard_error < 0.05
    assert high / share.ppm < 1.2
    assert low / share.ppm > 0.8
    assert share.plain_runs > 1e8
    assert share.effective > 1000
    assert share.doubt == ""


CURVED = quad(lambda b: norm.sf(1.5 + 0.2 * b * b) * norm.pdf(b), -9.0, 9.0)[0]  # 4.6 % of production
THIRD = 3.5 / np.sqrt(2.0)
POINTS = ((2.12, 2.12), (-2.12, -2.12), (-THIRD, THIRD), (THIRD, -THIRD))  # of the series system
SCENES = {  # limit state, truth, components, runs
    "aimed": (linear, ONE_PPM, [at(0.8, LIMIT), WIDE], 3000),
    "too near": (linear, ONE_PPM, [at(0.8, 3.5), WIDE], 3000),
    "too far": (linear, ONE_PPM, [at(0.8, 6.0), WIDE], 3000),
    "beside": (linear, ONE_PPM, [at(0.8, 4.1, 2.4), WIDE], 3000),
    "few runs": (linear, ONE_PPM, [at(0.8, LIMIT), WIDE], 300),
    "only wide": (linear, ONE_PPM, [{"share": 0.8, "scale": 2.0}], 3000),
    "both sides": (lambda z: np.abs(z["a"]) > LIMIT, 2 * ONE_PPM, [at(0.4, LIMIT), at(0.4, -LIMIT), WIDE], 3000),
    "one of two": (lambda z: np.abs(z["a"]) > LIMIT, 2 * ONE_PPM, [at(0.8, LIMIT), WIDE], 3000),
    "across": (lambda z: (z["a"] > LIMIT) | (z["b"] > LIMIT), 2 * ONE_PPM, [at(0.8, LIMIT), WIDE], 20_000),
    "one of four": (series, 2.2228e-3, [*(at(0.28, *p) for p in POINTS[:3]), WIDE], 20_000),
    "nothing aimed": (linear, ONE_PPM, [at(0.8, 0.0, -4.0), WIDE], 3000),
    "no spread": (linear, ONE_PPM, [at(0.8, 0.0, -4.0)], 3000),
    "curved away": (lambda z: z["a"] - 0.2 * z["b"] ** 2 > 1.5, CURVED, [{"share": 0.9, "scale": 2.0}], 3000),
    "curved, aimed": (lambda z: z["a"] - 0.2 * z["b"] ** 2 > 1.5, CURVED, [at(0.8, 2.0), WIDE], 3000),
}


@pytest.mark.slow
@each("scene", SCENES)
def test_intervals_hold(scene):
    """Coverage over 200 campaigns is at least 92 % (2 errors below at most), where the campaign aims well or not."""
    limit_state, truth, components, n = SCENES[scene]
    repeats = 200 if n < 10_000 else 60
    shares = [share_of(limit_state, components, n, seed) for seed in range(repeats)]
    covered = np.mean([s.interval[0] <= 1e6 * truth <= s.interval[1] for s in shares])
    assert covered >= 0.92 - 2.0 * np.sqrt(0.92 * 0.08 / repeats)


def test_four_branches():
    """The series system's published 2.2e-3 from components at its four design points, and with one of them missing."""
    whole = share_of(series, [*(at(0.2, *p) for p in POINTS), WIDE], 20_000, 3)
    assert whole.interval[0] < 2223.0 < whole.interval[1]
    assert whole.standard_error < 0.02
    part = share_of(series, [*(at(0.25, *p) for p in POINTS[:3]), WIDE], 20_000, 4)
    assert part.by_chance > 20
    assert part.interval[0] < 2223.0 < part.interval[1]


def test_rejects_in_all_directions():
    """2 ppm outside a sphere in 7 variables, found by a component without shift: a narrow interval that holds."""
    radius = chi2.isf(2e-6, 7)
    components = [{"share": 0.8, "scale": 2.45}, WIDE]
    share = share_of(lambda z: sum(x * x for x in z.values()) > radius, components, 20_000, 5, 7)
    assert share.doubt == ""
    assert share.interval[0] < 2.0 < share.interval[1] < 1.3 * share.ppm


def test_the_upper_end_has_the_error_of_weights_found_by_chance():
    """3 % beyond a limit at which nothing aims: the estimate and two standard errors."""
    share = share_of(SCENES["curved away"][0], [{"share": 0.9, "scale": 2.0}], 3000, 8)
    assert share.interval[1] / share.ppm == pytest.approx(1.0 + 2.0 * share.standard_error, abs=0.02)


def test_plain_runs_cap_the_upper_end():
    """Seven rejects far out, found by chance, would allow a third of production behind a flat limit."""
    draws = Draws(
        np.full(3000, 1e-7),
        np.arange(3000) < 800,
        np.arange(3000) < 1000,
        ((0.1, 1.0), (0.2, 5.0)),
        0.95,
        np.arange(3000) < 300,
    )
    share = rare_share(np.isin(np.arange(3000), [*range(500, 507), *range(2000, 2400)]), draws)
    assert share.doubt == ""
    assert share.by_chance == 7
    assert share.interval[1] <= 1e6 * (1.0 - 0.005 ** (1 / 300))


def test_a_flat_limit_that_nobody_meets():
    """2,000 of the runs spread twice: an unseen flat limit holds at most 0.004 ppm; without them, 1,800 ppm."""
    none = np.zeros(0, bool)
    draws = Draws(np.ones(0), none, none, ((0.1, 1.0), (0.1, 2.0)), 0.95, none)
    b = -norm.ppf(flat_bound(0, 20_000, draws))
    assert 2000 * norm.sf(b / 2) + 2000 * norm.sf(b) == pytest.approx(3.689, rel=1e-3)
    assert flat_bound(0, 20_000, draws) < 4e-9
    plain = replace(draws, spreads=((0.1, 1.0),))
    assert flat_bound(0, 20_000, plain) == pytest.approx(3.689 / 2000, rel=1e-3)
    assert flat_bound(0, 10, plain) == 1.0


def test_doubts_have_words():
    """Few rejects in effect, one large weight, a heavy tail: only a bound, and the reason; none at all: the bound."""
    weights = np.full(1000, 1e-6)
    none = np.zeros(1000, bool)
    spreads = ((0.2, 1.0), (0.1, 2.0))
    draws = Draws(weights, none, none, spreads, 0.95, np.arange(1000) >= 800)
    rejects = np.arange(1000) < 10
    few = rare_share(rejects, draws)
    assert few.doubt == "its 10 rejects are worth 10 of equal weight, and 20 are needed"
    assert few.interval[0] == 0.0
    by_count = 1e6 * (1.0 - 0.025 ** (1 / 200))  # no reject among 200 plain runs
    assert few.interval[1] == pytest.approx(by_count)
    heavy = replace(draws, weights=np.where(np.arange(1000) == 3, 1e-5, 1e-6))
    assert rare_share(np.arange(1000) < 60, heavy).doubt == "one reject has 14 % of the weight of all"
    many = np.ones(9000, bool)
    weights = 1e-6 * (1.0 - (np.arange(9000) + 0.5) / 9000.0) ** -0.75
    tail = Draws(weights, ~many, ~many, spreads, 0.95, ~many)
    assert tail_shape(tail.weights) > 0.7
    assert "heavy tail (Pareto shape 0." in rare_share(many, tail).doubt
    nothing = rare_share(none, draws)
    assert (nothing.ppm, nothing.interval[0], nothing.standard_error, nothing.doubt) == (0.0, 0.0, None, "")
    assert nothing.interval[1] == pytest.approx(by_count)
    assert "4 rejects were found" in rare_share(np.arange(1000) < 4, draws).doubt


def table_of(components, n, seed=1, fails=None):
    """Return the rows of a campaign whose response y is the sum of two standard scores, and its spec."""
    z, own = scores_of(components, n, seed)
    y = (z["a"] + z["b"]) / np.sqrt(2.0)
    ok = np.ones(n, bool) if fails is None else ~fails(z)
    columns = {
        "sample": pa.array(np.arange(n)),
        **{name: pa.array(x) for name, x in own.items()},
        "y": pa.array(y, mask=~ok),
        "status": pa.array(np.where(ok, "ok", "jammed").tolist(), pa.string()),
        "message": pa.array([""] * n, pa.string()),
        "max_residual": pa.array(np.full(n, 1e-9)),
        "max_penetration": pa.array(np.full(n, 1e-9)),
        "settled": pa.array(ok),
    }
    response = ResponseSpec("y", "a sum", "mm", -LIMIT, 4.0, None, "a test")
    design = Design(True, "Importance sampling.")
    request = ReportSpec("Sum", "sum-0123456789", {}, (response,), (), {}, n, sampler="importance", design=design)
    return pa.table(columns), replace(request, proposal=parts_of(components))


AIMED = [at(0.4, 2.9, 2.9), at(0.4, -3.3, -3.3), WIDE]


def test_the_report_of_a_campaign():
    """Sides, sum and index are those of the normal sum; other numbers are over the plain runs; the page says it all."""
    table, request = table_of(AIMED, 20_000)
    analysis = analysis_of(table, request)
    [y] = analysis.rare.responses
    above = 1e6 * norm.sf(4.0)
    assert y.below.interval[0] < 1.0 < y.below.interval[1]
    assert y.above.interval[0] < above < y.above.interval[1]
    assert y.total.ppm == pytest.approx(y.below.ppm + y.above.ppm)
    assert analysis.rare.together.ppm == pytest.approx(y.total.ppm)
    assert y.index == pytest.approx(4.0 / 3.0, abs=0.01)
    assert y.index_interval[0] < 4.0 / 3.0 < y.index_interval[1]
    plain = np.asarray(table["component"]) == 0
    assert analysis.used == analysis.rare.plain == plain.sum()
    assert analysis.responses[0].capability.mean == pytest.approx(np.asarray(table["y"])[plain].mean())
    assert [check.level for check in analysis.trust if check.name in ("Rare rejects", "Weights")] == ["good", "good"]
    page = render_html(analysis)
    assert '<h2 id="rare">Rare rejects</h2>' in page
    assert "any limit, or failed" in page


def test_verdict_is_the_worse_of_cpk_and_share():
    """A long tail far out: the plain runs' Cpk knows nothing of it, the share does."""
    table, request = table_of([at(0.4, 2.9, 2.9), at(0.4, -3.3, -3.3), WIDE], 20_000)
    y = np.asarray(table["y"])
    stretched = np.where(np.abs(y) > 3.5, y * 1.4, y)  # 233 ppm a side instead of 2
    table = table.set_column(table.schema.get_field_index("y"), "y", pa.array(stretched))
    request = replace(request, responses=(replace(request.responses[0], lsl=-4.6, usl=4.6),))
    analysis = analysis_of(table, request)
    assert analysis.responses[0].capability.cpk > 1.33
    assert analysis.rare.responses[0].total.ppm == pytest.approx(2e6 * norm.sf(3.5), rel=0.08)
    verdict = analysis.responses[0].verdict
    assert (verdict.word, verdict.by) == ("marginal", "rare rejects")
    assert "20\u202f000 weighted runs of" in verdict.reasons[0]
    assert "marginal, although Cpk" in verdict.reasons[0]


def test_failures_are_weighed_too():
    """Runs that fail where rejects are: their share, and the sum, as weighted shares."""
    table, request = table_of(AIMED, 20_000, fails=lambda z: z["a"] + z["b"] > 4.0 * np.sqrt(2.0))
    rare = rare_rejects(read_samples(table, request), request, 0.95)
    assert rare.failed.ppm == pytest.approx(1e6 * norm.sf(4.0), rel=0.15)
    assert rare.responses[0].above.ppm == 0.0
    assert rare.with_failures.ppm == pytest.approx(rare.together.ppm + rare.failed.ppm)
    assert rare.runs == 20_000


def test_wrong_weights_are_seen():
    """Weights that are 10 % too large differ from what the plain runs count, and the card says so."""
    table, request = table_of(AIMED, 20_000)
    wrong = pa.array(np.asarray(table["log_weight"]) + 0.2)
    table = table.set_column(table.schema.get_field_index("log_weight"), "log_weight", wrong)
    _, weights = rare_checks(rare_rejects(read_samples(table, request), request, 0.95))
    assert weights.level == "bad"
    assert "the weights do not fit the runs" in weights.text


def test_what_is_not_known_is_a_line_of_the_card():
    """Few runs that could meet a region where nothing aims; rejects that are worth too little."""
    table, request = table_of(AIMED, 3000)
    request = replace(request, responses=(replace(request.responses[0], usl=None),))
    known, _ = rare_checks(rare_rejects(read_samples(table, request), request, 0.95))
    assert known.level == "attention"
    assert known.text.startswith("Further rejects may lie where no component aims: y up to ")
    table, request = table_of([at(0.8, 1.0, 1.0), WIDE], 3000)
    known, _ = rare_checks(rare_rejects(read_samples(table, request), request, 0.95))
    assert known.level == "attention"
    assert known.text.startswith("Only an upper bound is known for y: ")
    table, request = table_of(AIMED, 20_000)
    request = replace(request, responses=(replace(request.responses[0], lsl=-9.0, usl=None),))
    known, _ = rare_checks(rare_rejects(read_samples(table, request), request, 0.95))
    assert known.level == "good"
    assert "No reject of y was found: at most" in known.text
    assert "below 0.004" in known.text


def test_nothing_to_say():
    """No section for other samplers, and none before the first run."""
    table, request = table_of(AIMED, 100)
    assert rare_rejects(read_samples(table, replace(request, proposal=())), replace(request, proposal=()), 0.95) is None
    assert rare_rejects(read_samples(table.slice(0, 0), request), request, 0.95) is None


def test_a_bound_replaces_no_interval():
    """Of runs that decide, the last with an interval count; of mere bounds the last."""
    interval, bound = ((Estimate(1.1, (1.0, high), "x", ""),) for high in (1.2, np.inf))
    known = {"a": interval, "b": interval, "c": bound}
    later = {"a": bound, "b": interval, "c": bound, "d": bound}
    assert set(decisive(known, later)) == {"b", "c", "d"}
    assert decisive({}, later) == later
