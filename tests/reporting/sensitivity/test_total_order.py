"""Total indices of Saltelli's design: against known ones, scipy's, and what a report makes of them."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import openpyxl
import pyarrow as pa
import pytest
from scipy.special import ndtri
from scipy.stats import qmc, sobol_indices

from reporting import ReportError, ReportSpec, ResponseSpec, VariableSpec, write_report
from reporting.render.data_files import document, report_schema
from reporting.render.html import render_html
from reporting.sensitivity.first_order import jackknife_quantile
from reporting.sensitivity.polynomials import GROUPS
from reporting.sensitivity.total_order import total_order_indices
from tests.reporting.models import ISHIGAMI_FIRST, ISHIGAMI_TOTAL, LINEAR_FIRST, WEIGHTS, ishigami_of
from tests.reporting.synthetic import analysis_of, c60_spec, drawn_by

NAMES = ("x1", "x2", "x3")


def points(n, k, rng, *, sobol=True):
    """Return the design's points in the unit cube, shape (n, k + 2, k), from a Sobol sequence or from random rows."""
    both = qmc.Sobol(2 * k, rng=rng).random(n) if sobol else rng.random((n, 2 * k))
    a, b = both[:, :k], both[:, k:]
    mixed = [np.where(np.arange(k) == j, b, a) for j in range(k)]
    return np.stack([a, b, *mixed], axis=1)


def ishigami_design(n, rng, *, sobol=True):
    """Return variables (n 5, 3) and the response (n 5,), row by row of the design."""
    x = (2 * points(n, 3, rng, sobol=sobol) - 1).reshape(-1, 3) * np.pi
    return x, ishigami_of(x)


def report_of(x, responses, failed=(), **changes):
    """Return table and spec of a campaign of these samples; ``failed`` ones have no value."""
    n, k = x.shape
    names = tuple(f"x{j + 1}" for j in range(k))
    ok = ~np.isin(np.arange(n), failed)
    columns = {
        "sample": np.arange(n),
        **dict(zip(names, x.T, strict=True)),
        **{name: pa.array(y, mask=~ok) for name, y in responses.items()},
        "status": np.where(ok, "ok", "not_converged"),
        "message": np.full(n, ""),
        "max_residual": np.full(n, 1e-9),
        "max_penetration": np.full(n, 1e-9),
        "settled": ok,
    }
    spec = ReportSpec(
        title="designed",
        campaign="designed-0",
        header={},
        responses=tuple(ResponseSpec(name, "", "mm", -20.0, 20.0, None, "a test") for name in responses),
        variables=tuple(
            VariableSpec(name, "mm", "", None, None, v.mean(), v.std(), ()) for name, v in zip(names, x.T, strict=True)
        ),
        provenance={},
        requested=n,
        designed=names,
        **drawn_by("saltelli"),
    )
    return pa.table(columns), replace(spec, **changes)


def test_indices_of_ishigami():
    """First-order and total indices of the three variables, far from the origin; intervals hold them."""
    _, y = ishigami_design(2048, np.random.default_rng(1))
    found = total_order_indices(1e6 + y, NAMES)
    assert found.first_order == pytest.approx(ISHIGAMI_FIRST, abs=0.02)
    assert found.total == pytest.approx(ISHIGAMI_TOTAL, abs=0.01)
    assert found.interactions == pytest.approx(ISHIGAMI_TOTAL - ISHIGAMI_FIRST, abs=0.015)
    assert np.all(np.abs(found.total - ISHIGAMI_TOTAL) < 3 * found.total_error)


def test_indices_are_scipys():
    """The same estimates to rounding, from any response; errors are those of its bootstrap to 40 %."""
    rng = np.random.default_rng(2)
    y = ishigami_design(512, rng)[1] ** 2
    found = total_order_indices(y, NAMES)
    a, b, *mixed = ((y - y.mean()) / y.std()).reshape(512, 5).T
    theirs = sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": np.array(mixed)[:, None]}, n=512)
    assert found.first_order == pytest.approx(theirs.first_order.ravel(), abs=1e-12)
    assert found.total == pytest.approx(theirs.total_order.ravel(), abs=1e-12)
    spread = theirs.bootstrap(n_resamples=200)
    assert found.total_error == pytest.approx(spread.total_order.standard_error.ravel(), rel=0.4)
    assert found.first_order_error == pytest.approx(spread.first_order.standard_error.ravel(), rel=0.4)


def test_an_additive_response_has_no_interactions():
    """Of a weighted sum total and first-order index are the same, and a variable of weight 0 has exactly none."""
    x = points(1024, 7, np.random.default_rng(3)).reshape(-1, 7)
    found = total_order_indices(x @ WEIGHTS, [f"x{j}" for j in range(7)])
    assert found.total == pytest.approx(LINEAR_FIRST, abs=0.01)
    assert found.interactions == pytest.approx(np.zeros(7), abs=0.02)
    assert found.total[6] == found.total_error[6] == 0.0


def test_a_product_is_nothing_but_interaction():
    """x1 x2 of centred variables: alone neither explains anything, with the other each explains all."""
    x = 2 * points(2048, 3, np.random.default_rng(4)).reshape(-1, 3) - 1
    found = total_order_indices(x[:, 0] * x[:, 1], NAMES)
    assert found.first_order == pytest.approx(np.zeros(3), abs=0.02)
    assert found.total == pytest.approx([1.0, 1.0, 0.0], abs=0.02)


@pytest.mark.parametrize("sobol", [False, True])
def test_intervals_cover_as_often_as_they_say(sobol):
    """Of 300 designs of Ishigami with 256 rows: of random rows 95 % (4.5 standard errors: 89 %), of Sobol's more."""
    rng, right = np.random.default_rng(5), np.array([ISHIGAMI_FIRST, ISHIGAMI_TOTAL, ISHIGAMI_TOTAL - ISHIGAMI_FIRST])
    held = np.zeros((3, 3))
    for _ in range(300):
        f = total_order_indices(ishigami_design(256, rng, sobol=sobol)[1], NAMES)
        off = np.abs(np.array([f.first_order, f.total, f.interactions]) - right)
        held += off <= jackknife_quantile(GROUPS, 0.95) * np.array(
            [f.first_order_error, f.total_error, f.interactions_error]
        )
    share = held / 300
    assert share.min() > 0.89
    assert share.mean() > 0.97 if sobol else 0.93 < share.mean() < 0.97


def test_what_is_no_design_is_refused_or_told():
    """Values that make no rows are an error of the caller; few rows and equal values are told in words."""
    with pytest.raises(ReportError, match=r"\b98 values.*\b3 variables"):
        total_order_indices(np.zeros(98), NAMES)
    assert "10 rows is too small" in total_order_indices(np.arange(50.0), NAMES)
    assert "all values are equal" in total_order_indices(np.full(500, 0.1), NAMES)


def test_a_report_says_who_acts_through_interactions(tmp_path: Path):
    """On the page, in the JSON by its schema, and in the workbook: total indices with intervals; x3 is named."""
    x, y = ishigami_design(1024, np.random.default_rng(6))
    written = write_report(*report_of(x, {"y": y, "sum": x @ [1.0, 1.0, 0.0]}), tmp_path)
    content = json.loads(Path(written["json"]).read_text())
    jsonschema.Draft202012Validator(report_schema()).validate(content)
    first, second = (r["sensitivity"] for r in content["responses"])
    assert [i["total"] for i in first["influences"]] == pytest.approx(ISHIGAMI_TOTAL, abs=0.02)
    assert [i["first_order"] for i in first["influences"]] == pytest.approx(ISHIGAMI_FIRST, abs=0.02)
    assert all(i["total_interval"][0] < i["total"] < i["total_interval"][1] for i in first["influences"])
    assert [i["verdict"] for i in first["influences"]] == ["critical"] * 3
    assert first["notes"][0].startswith("25 % of the variance does not come from")
    named = re.fullmatch(
        r"Variables that act together with others: x1 explains (\d+) % with them and (\d+) % alone,"
        r" x3 explains (\d+) % with them and (\d+) % alone\.",
        first["notes"][1],
    )
    right = [share[i] for i in (0, 2) for share in (ISHIGAMI_TOTAL, ISHIGAMI_FIRST)]
    assert [int(percent) / 100 for percent in named.groups()] == pytest.approx(right, abs=0.02)
    assert second["notes"] == []
    assert [i["verdict"] for i in second["influences"]] == ["critical", "critical", "not critical"]
    page = Path(written["html"]).read_text()
    assert first["notes"][1] in page
    assert page.count("With<br>interactions") == 2
    rows = list(openpyxl.load_workbook(written["xlsx"])["Causes"].values)
    at = rows[0].index("share with interactions")
    assert [row[at] for row in rows[1:4]] == pytest.approx([i["total"] for i in first["influences"]], rel=1e-15)


def test_what_only_interacts_is_not_passed_over():
    """Of a product no variable matters alone: with a design both are critical, and by a regression without one."""
    x = 2 * points(1024, 3, np.random.default_rng(7)).reshape(-1, 3) - 1
    table, spec = report_of(x, {"y": x[:, 0] * x[:, 1]})
    found = analysis_of(table, spec)
    assert [i.verdict for i in found.responses[0].sensitivity.influences] == ["critical", "critical", "not critical"]
    assert found.never_critical == ("x3",)
    blind = analysis_of(table, replace(spec, designed=None, **drawn_by("sobol"))).responses[0].sensitivity
    assert [i.verdict for i in blind.influences] == ["critical", "critical", "not critical"]
    assert "sampler saltelli" in blind.notes[1]


def test_statistics_are_over_the_samples_of_a_and_b():
    """Everything but the total indices is what a report of those samples alone says, and the page says so."""
    x, y = ishigami_design(256, np.random.default_rng(8))
    table, spec = report_of(x, {"y": y}, failed=(4, 10))
    found = analysis_of(table, spec)
    assert (found.finished, found.failed, found.used) == (1280, 2, 511)  # 10 is A's run of row 2, 4 a mixed one
    own = table.filter(pa.array(np.arange(1280) % 5 < 2))
    alone = analysis_of(own, replace(spec, designed=None, **drawn_by("sobol")))
    for name in ("capability", "yield_", "histogram", "nonconforming", "tails", "fits", "running", "normality"):
        assert getattr(found.responses[0], name) == getattr(alone.responses[0], name), name
    assert (found.variables, found.correlations) == (alone.variables, alone.correlations)
    assert found.responses[0].sensitivity.influences == alone.responses[0].sensitivity.influences
    page = render_html(found)
    assert "over the 511 ok samples of A and B" in page
    assert "every statistic, interval, share and tail here is over A and B alone" in page


def test_a_hole_in_the_design_is_told_and_closed_by_a_rerun():
    """Which samples, how many, what to do; shares alone stay, total ones return with the runs."""
    x, y = ishigami_design(256, np.random.default_rng(9))
    failed = (3, 17, 500, 501, 502, 503, 1279)
    found = analysis_of(*report_of(x, {"y": y}, failed)).responses[0].sensitivity
    assert all(i.total is None and i.first_order is not None for i in found.influences)
    assert found.notes[-1].startswith(
        "No total-order indices: 7 of the design's 1\u202f280 samples have no value"
        " (sample 3, 17, 500, 501, 502 and 2 more)"
    )
    assert "clearcap rerun" in found.notes[-1]
    table, spec = report_of(x, {"y": y})
    unfinished = analysis_of(table.slice(0, 1000), spec).responses[0].sensitivity
    assert "280 of the design's 1\u202f280 samples have no value (sample 1000, 1001," in unfinished.notes[-1]
    assert all(i.total is not None for i in analysis_of(table, spec).responses[0].sensitivity.influences)
    content = document(analysis_of(*report_of(x, {"y": y}, failed)))
    jsonschema.Draft202012Validator(report_schema()).validate(json.loads(json.dumps(content)))


@pytest.mark.parametrize("variables", [(), ("x1", "x4")])
def test_a_design_without_its_variables_is_refused(variables):
    """Its mixed runs would pass for draws, and intervals would be too narrow."""
    x, y = ishigami_design(32, np.random.default_rng(12))
    with pytest.raises(ReportError, match=r"\bdesign\b"):
        analysis_of(*report_of(x, {"y": y}, designed=variables))


@pytest.mark.parametrize("change", [{"sampler": "sobol"}, {"corners": True}, {"designed": NAMES}])
def test_samples_that_are_not_independent_do_not_pass_for_such(change):
    """Whoever gives no design for them has intervals that do not hold, or a verdict on no production."""
    with pytest.raises(ReportError, match=r"\bdesign\b"):
        replace(c60_spec(10), **change)


def test_sample_numbers_beyond_the_design_are_refused():
    """They would belong to no row."""
    x, y = ishigami_design(32, np.random.default_rng(10))
    table, spec = report_of(x, {"y": y})
    moved = table.set_column(0, "sample", pa.array(np.arange(160) + 1))
    with pytest.raises(ReportError, match=r"sample 160\b"):
        analysis_of(moved, spec)


@pytest.mark.slow
def test_the_page_of_a_design_of_the_papers_size_has_less_than_three_megabytes(tmp_path: Path):
    """4,096 rows of seven variables, six responses, with interactions: total indices add next to nothing."""
    x = 0.07 + 0.0175 * ndtri(points(4096, 7, np.random.default_rng(11)).reshape(-1, 7))
    z = (x - 0.07) / 0.0175
    table, spec = report_of(x, {f"y{i}": z @ np.roll(WEIGHTS, i) + z[:, i] * z[:, 0] for i in range(6)})
    written = write_report(table, spec, tmp_path)
    assert os.path.getsize(written["html"]) < 3e6
