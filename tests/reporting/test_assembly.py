"""The share of samples that cannot be assembled: interval, limit, and what the rest of a report is about."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import beta

from reporting.analysis import CONFIDENCE, Analysis, analyse
from reporting.product_yield import assembly_share
from reporting.samples import read_samples
from tests.reporting.synthetic import c60_spec, c60_table

N = 1000


def table(unfit: int, failed: int = 0) -> pa.Table:
    """Return rows of which every so many cannot be assembled, and as many failed as told."""
    rows = c60_table(N, failed)
    status = np.array(rows["status"].to_pylist(), dtype=object)
    status[: 2 * unfit : 2] = "not_assemblable"
    rows = rows.set_column(rows.schema.get_field_index("status"), "status", pa.array(status.tolist(), pa.string()))
    for name in (r.name for r in c60_spec(N).responses):
        values = [None if s != "ok" else x for s, x in zip(status, rows[name].to_pylist(), strict=True)]
        rows = rows.set_column(rows.schema.get_field_index(name), name, pa.array(values, pa.float64()))
    return rows


def analysed(unfit: int, limit: float | None, failed: int = 0) -> Analysis:
    """Return the analysis of such rows."""
    spec = replace(c60_spec(N), max_not_assemblable=limit)
    return analyse(read_samples(table(unfit, failed), spec), spec)


@pytest.mark.parametrize(("limit", "verdict"), [(0.05, "kept"), (0.02, "open"), (0.005, "exceeded")])
def test_the_share_is_judged_by_its_one_sided_bounds(limit, verdict):
    """Clopper and Pearson's interval of 20 of 1000, from the beta distribution."""
    spec = replace(c60_spec(N), max_not_assemblable=limit)
    share = assembly_share(read_samples(table(20), spec), spec, CONFIDENCE)
    assert share is not None
    assert (share.count, share.n, share.share, share.limit, share.verdict) == (20, N, 0.02, limit, verdict)
    rest = (1 - CONFIDENCE) / 2
    assert share.interval == pytest.approx((beta.ppf(rest, 20, N - 19), beta.ppf(1 - rest, 21, N - 20)), rel=1e-9)
    said = " ".join(share.words.split())  # narrow and hard spaces
    assert said.startswith("20 of 1 000 samples cannot be assembled (2 %, 1.23 % to 3.07 %); the limit of ")


def test_with_a_limit_all_else_is_about_the_samples_that_fit():
    """They no longer count among the failures: verdicts are those of the other rows; the product loses them."""
    judged, counted = analysed(50, 0.1), analysed(50, None)
    fit = table(50).filter(pa.array([s != "not_assemblable" for s in table(50)["status"].to_pylist()]))
    alone = analyse(read_samples(fit, c60_spec(N)), c60_spec(N))
    assert [r.verdict for r in judged.responses] == [r.verdict for r in alone.responses]
    assert {r.verdict.word for r in counted.responses if r.spec.lsl is not None} == {"no verdict"}
    assert judged.product is not None
    assert alone.product is not None
    assert (judged.product.with_failures.n, alone.product.with_failures.n) == (N, N - 50)
    assert judged.product.with_failures.conforming == alone.product.with_failures.conforming
    assert (judged.finished, judged.ok, judged.failed) == (N, N - 50, 0)


@pytest.mark.parametrize(
    ("limit", "level", "lead"), [(0.1, "good", False), (0.05, "attention", True), (0.01, "bad", True)]
)
def test_trust_card_and_headline_say_so(limit, level, lead):
    """The headline begins with what is not kept, or may not be."""
    analysis = analysed(50, limit)
    (line,) = (check for check in analysis.trust if check.name == "Assembly")
    assert (line.level, line.value) == (level, 0.05)
    assert ("cannot be assembled" in analysis.headline.split(";")[0]) == lead
    (failures,) = (check for check in analysis.trust if check.name == "Failures")
    assert failures.level == "good"


@pytest.mark.slow
def test_nothing_is_said_where_all_fit_and_no_limit_asks():
    """With a limit the share is stated even if it is 0."""
    assert analysed(0, None).assembly is None
    share = analysed(0, 0.01).assembly
    assert share is not None
    assert (share.count, share.verdict) == (0, "kept")
    unlimited = analysed(3, None)
    assert unlimited.assembly is not None
    assert unlimited.assembly.verdict == ""
