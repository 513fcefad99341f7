"""The files beside the page: their schema, their rows, and what is said where one cannot be written."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import jsonschema
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from reporting import Assumption, ReportError, write, write_report
from reporting.analysis import OtherSpreads
from reporting.render.data_files import capability_table, document, report_schema
from reporting.render.html import render_html
from reporting.shape.nonnormal import NonnormalIndices
from reporting.tolerance.reweighting import Change
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, drawn_by


@cache
def fullest_analysis():
    """Return the analysis of a campaign with as much in it as there can be."""

    def flat(factors, columns):
        (name, factor), *_ = factors.items()
        return Change(0.0 * columns[name], 0.0, factor)

    return analysis_of(c60_table(400, 9), c60_spec(400), OtherSpreads(flat), (c60_table(300, seed=1), c60_spec(300)))


def odd_analyses():
    """Yield analyses of campaigns with as much, and as little, in them as there can be."""
    table, spec = c60_table(400, 9), c60_spec(400)
    yield fullest_analysis()
    yield analysis_of(table, replace(spec, production_batch_column="steps", correlations=(("J1", "J2", 0.1),)))
    yield analysis_of(table, replace(spec, **drawn_by("worst_case")))
    yield analysis_of(table.slice(0, 1), spec)
    yield analysis_of(table.slice(0, 0), replace(spec, responses=(), variables=()))
    yield analysis_of(table.slice(395), spec)


def test_every_document_keeps_its_schema() -> None:
    schema = report_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    for analysis in odd_analyses():
        content = json.loads(json.dumps(document(analysis), allow_nan=False))
        jsonschema.Draft202012Validator(schema).validate(content)
        assert set(content) == set(schema["properties"])


def test_a_document_with_another_key_breaks_the_schema() -> None:
    validator = jsonschema.Draft202012Validator(report_schema())
    content = json.loads(json.dumps(document(fullest_analysis())))
    for change in ({"extra": 1}, {"ok": "many"}, {"responses": [{}]}):
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({**content, **change})


def test_parquet_has_a_row_a_response_with_units(campaign, tmp_path: Path) -> None:
    table, spec = campaign(200, 3)
    a = analysis_of(table, spec)
    found = pq.read_table(write_report(table, spec, tmp_path, kinds=("parquet",))["parquet"])
    assert found["response"].to_pylist() == [r.name for r in spec.responses]
    assert found["unit"].to_pylist() == [r.unit for r in spec.responses]
    assert found["cpk"].to_pylist() == [r.capability.cpk for r in a.responses]
    assert found["cpk_interval_low"][0].as_py() == a.responses[0].capability.cpk_interval[0]
    assert found.schema.field("ppm_expected").metadata == {b"unit": b"ppm"}
    assert found.schema.field("cpk").metadata == {b"unit": b"1"}
    assert found.schema.metadata[b"campaign"] == spec.campaign.encode()


def test_parquet_has_the_share_of_the_fitted_z_score_unless_families_disagree() -> None:
    given = {"method": "z_score", "family": "weibull", "assumed": "", "ppm_expected": 12.0}
    given |= {"ppm_expected_interval": (3.0, 40.0)}
    agreed, disagreed = (NonnormalIndices(**given, ppm_range=range_) for range_ in (None, (5.0, 30.0)))
    percentile = NonnormalIndices("percentile", "weibull", "", ppk=1.5, ppm_expected=99.0)
    analysis = fullest_analysis()
    for methods, ppm in (((percentile, agreed), 12.0), ((percentile, disagreed), None)):
        rows = capability_table(replace(analysis, responses=(replace(analysis.responses[0], methods=methods),)))
        (row,) = rows.to_pylist()
        assert (row["nonnormal_ppk"], row["nonnormal_ppm"]) == (1.5, ppm)
        assert (row["nonnormal_ppm_low"], row["nonnormal_ppm_high"]) == (3.0, 40.0)


def test_the_workbook_holds_the_numbers_and_no_formula(campaign, tmp_path: Path) -> None:
    table, spec = campaign(200, 3)
    spec = replace(spec, header={"part": "=1+1"})
    a = analysis_of(table, spec)
    book = openpyxl.load_workbook(write_report(table, spec, tmp_path, kinds=("xlsx",))["xlsx"])
    assert book.sheetnames[:2] == ["Summary", "Trust"]
    rows = list(book["Summary"].values)
    at = rows[0].index("Cpk")
    # A spreadsheet keeps 16 digits.
    right = [r.capability.cpk for r in a.responses]
    assert [row[at] for row in rows[1:]] == [None if cpk is None else pytest.approx(cpk, rel=1e-15) for cpk in right]
    assert list(book["Provenance"].values)[1] == ("part", "=1+1")
    assert book["Provenance"]["B2"].data_type == "s"
    samples = list(book["Samples"].values)
    assert samples[0][:3] == ("sample", "status", "J1 [mm]")
    assert len(samples) == 201
    assert samples[-1][1] != "ok"


def test_a_file_that_takes_another_package_is_left_out_and_told(campaign, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(write, "find_spec", lambda package: None)
    written = write_report(*campaign(60, 4), tmp_path, kinds=("pdf", "xlsx", "parquet"))
    assert sorted(written) == ["html", "json", "parquet"]
    page = Path(written["html"]).read_text(encoding="utf-8")
    assert "report.pdf needs pip install &#39;clearcap[pdf]&#39;" in page
    assert "report.xlsx needs pip install &#39;clearcap[excel]&#39;" in page


def test_rows_in_tables_that_follow_each_other_are_one_table(campaign) -> None:
    table, spec = campaign(60, 4)
    pieces = [table.slice(0, 0), table.slice(0, 40), table.slice(40)]
    whole, streamed = analysis_of(table, spec), analysis_of(iter(pieces), spec)
    assert streamed.run_seconds == pytest.approx(whole.run_seconds)
    assert replace(streamed, run_seconds=whole.run_seconds) == whole
    with pytest.raises(ReportError, match="sample 0 comes after 59"):
        analysis_of([table.slice(40), table.slice(0, 40)], spec)
    with pytest.raises(ReportError, match=r"sample 39\b"):
        analysis_of([table.slice(0, 40), table.slice(39)], spec)


def test_batches_of_production_give_the_sigma_within(campaign) -> None:
    table, spec = campaign(200)
    table = table.append_column("batch", pa.array([i // 20 for i in range(200)]))
    found = analysis_of(table, replace(spec, production_batch_column="batch")).responses[0].capability.within
    assert (found.batches, found.nu) == (10, 190)


@pytest.mark.parametrize("sampler", ["grid", "list", "worst_case"])
def test_samples_that_are_no_production_get_no_verdict(campaign, sampler) -> None:
    a = analysis_of(*campaign(200, **drawn_by(sampler)))
    assert {r.verdict.word for r in a.responses} == {"no verdict", "no limits"}
    first = a.trust[0]
    assert (first.name, first.level) == ("Sampling", "attention")
    assert not a.advice


def test_the_worst_case_of_another_campaign_stands_beside_the_statistics(campaign) -> None:
    """Against corners nothing is tested: their extremes are shown, found over them and not over this campaign."""
    table, spec = campaign(200)
    corners, of_corners = campaign(60, **drawn_by("worst_case"))
    a = analysis_of(table, spec, against=(corners, of_corners))
    assert a.comparison is None
    assert a.responses[0].verdict.word == "capable"
    assert a.responses[0].worst == analysis_of(corners, of_corners).responses[0].worst
    assert "Mean ± 3σ" in render_html(a)


def test_heads_of_the_workbook_have_filters(campaign, tmp_path: Path) -> None:
    """On every sheet, over all its columns and rows; and the assumptions have a sheet."""
    openpyxl = pytest.importorskip("openpyxl")
    table, spec = campaign(60, 4)
    fixed = (Assumption("g", "stiffness of spring A", 1.5, "N/mm", "springs.A.stiffness"),
             Assumption("g", "gravity", (0.0, 0.0, -9.81), "m/s2", "gravity"))  # fmt: skip
    path = write_report(table, replace(spec, assumptions=fixed), tmp_path, kinds=("xlsx",))["xlsx"]
    book = openpyxl.load_workbook(path)
    for sheet in book.worksheets:
        assert sheet.auto_filter.ref == sheet.dimensions, sheet.title
    rows = list(book["Assumptions"].iter_rows(values_only=True))
    assert rows[1] == ("g", "stiffness of spring A", 1.5, "N/mm", "springs.A.stiffness")
    assert [row[2] for row in rows[2:]] == [0, 0, -9.81]
