"""The capability of measured parts: what the table's files say, in which order, and what the report says of them."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import clearcap
from campaign.errors import SpecError
from clearcap.cli import app
from clearcap.questions.measured import asked_of_parts, load_limits, parts_table
from clearcap.questions.measurement_table import read_parts
from reporting.analysis import analyse
from reporting.samples import read_samples
from tests.each import each

LIMITS = {"characteristics": {"d": {"unit": "mm", "nominal": 20.0, "tolerance": 0.02, "source": "drawing 7"}}}
OF_SIMULATIONS = (
    "simulat",
    "campaign",
    "mechanism",
    "replay",
    "penetration",
    "residual",
    " runs",
    "repeated",
    "half the step",
)


def normal(n=200, seed=1):
    return np.random.default_rng(seed).normal(20.002, 0.004, n).round(4)


def texts(values, decimal="."):
    return [("" if np.isnan(x) else f"{x:.4f}".replace(".", decimal)) for x in values]


def analysed(parts, limits):
    table, spec = asked_of_parts(parts, limits)
    return analyse(read_samples(table, spec), spec)


def check_of(analysis, name):
    return next(check for check in analysis.trust if check.name == name)


def test_the_numbers_are_those_of_the_formulas():
    d = normal()
    capability = analysed(pd.DataFrame({"d": d}), LIMITS).responses[0].capability
    assert (capability.n, capability.mean, capability.std) == (
        200,
        pytest.approx(d.mean()),
        pytest.approx(d.std(ddof=1)),
    )
    assert capability.cpk == pytest.approx(min(20.02 - d.mean(), d.mean() - 19.98) / (3 * d.std(ddof=1)), rel=1e-12)


def test_a_table_is_the_same_in_every_format(tmp_path):
    """Comma, semicolon, tab, decimal point and comma, Parquet, Excel, and a table of pandas; one value is missing."""
    d = normal(30)
    d[7] = np.nan
    files = {}
    for name, separator, decimal in (
        ("a.csv", ",", "."),
        ("b.csv", ";", ","),
        ("c.txt", "\t", ","),
        ("d.csv", ";", "."),
    ):
        rows = [f"{i}{separator}{text}" for i, text in enumerate(texts(d, decimal))]
        files[name] = tmp_path / name
        files[name].write_bytes("\r\n".join([f"no{separator}d", *rows, ""]).encode("utf-8-sig"))
    frame = pd.DataFrame({"no": range(30), "d": d})
    frame.to_parquet(tmp_path / "e.parquet")
    frame.to_excel(tmp_path / "f.xlsx", index=False)
    files |= {name: tmp_path / name for name in ("e.parquet", "f.xlsx")}
    limits = load_limits(LIMITS)
    tables = {name: read_parts(path) for name, path in files.items()} | {"table": frame}
    for name, table in tables.items():
        np.testing.assert_array_equal(parts_table(table, limits)["d"].to_numpy(), d, err_msg=name)


def test_parts_are_in_the_order_of_a_column_and_lots_in_the_order_in_which_they_begin():
    d, when = normal(6), ["2026-11-03 10:00", "2026-11-03 09:00", "2026-11-02 23:00", "2026-11-03 11:00"]
    frame = pd.DataFrame({"d": d, "at": [*when, "2026-11-04 01:00", "2026-11-04 00:00"], "lot": list("BAABCC")})
    frame["number"] = [30, 20, 9, 40, 60, 50]
    frame["text"] = frame["number"].astype(str)
    frame["serial"] = "P" + frame["text"] + "-007"
    times = pd.to_datetime(frame["at"])
    frame["dotted"], frame["slashed"] = times.dt.strftime("%d.%m.%Y %H:%M"), times.dt.strftime("%m/%d/%y %H:%M")
    frame.loc[5, "slashed"], frame.loc[4, "slashed"] = "11/13/26", "11/14/26"  # the second number is a day
    for column in ("at", "number", "text", "serial", "dotted", "slashed"):
        limits = load_limits(LIMITS | {"order": column, "lot": "lot"})
        table = parts_table(frame, limits)
        assert table["d"].to_pylist() == [d[row - 1] for row in (3, 2, 1, 4, 6, 5)], column
        assert table["production lot"].to_pylist() == [0, 0, 1, 1, 2, 2]


def test_days_and_months_are_told_apart_by_the_whole_column():
    """The last of January was before the first of February, with the day first, or the month, as one date tells."""
    for column in (["01/02/26", "31/01/26"], ["02/01/26", "01/31/26"], ["01.02.2026", "09.01.2026"]):
        table = parts_table(pd.DataFrame({"d": [2.0, 1.0], "at": column}), load_limits(LIMITS | {"order": "at"}))
        assert table["d"].to_pylist() == [1.0, 2.0], column


def test_empty_rows_are_no_parts_and_two_columns_of_one_name_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text("no;d\n1;20,01\n;\n2;\n3;20,02\n;\n")
    (tmp_path / "b.csv").write_text("d,d\n20.01,30\n")
    pd.DataFrame([[20.01, 30.0]], columns=["d", "d"]).to_excel(tmp_path / "c.xlsx", index=False)
    limits = load_limits(LIMITS)
    np.testing.assert_array_equal(
        parts_table(read_parts(tmp_path / "a.csv"), limits)["d"].to_numpy(), [20.01, np.nan, 20.02]
    )
    for name in ("b.csv", "c.xlsx"):
        with pytest.raises(SpecError, match="2 columns d"):
            parts_table(read_parts(tmp_path / name), limits)


def test_an_unstable_process_is_called_one():
    """A step, spikes, and the same values in another order; nothing is said where the order means nothing."""
    d = normal(120)
    step, spiked = d.copy(), d.copy()
    step[60:] += 0.006
    spiked[[10, 11, 40, 41, 90, 91]] += 0.03
    for values in (step, spiked):
        assert check_of(analysed(pd.DataFrame({"d": values}), LIMITS), "Stability").level == "bad"
    mixed = np.random.default_rng(3).permutation(step)
    for values in (d, mixed):
        assert check_of(analysed(pd.DataFrame({"d": values}), LIMITS), "Stability").level == "good"
    unordered = analysed(pd.DataFrame({"d": step}), LIMITS | {"ordered": False})
    assert check_of(unordered, "Stability").level == "info"
    few = analysed(pd.DataFrame({"d": d[:4]}), LIMITS)
    assert check_of(few, "Stability").level == "info"


def test_the_chart_is_chosen_in_the_limits_file(tmp_path):
    """Subgroups by a column or a number, tests by name; the page has the chart of the spread, and the JSON both."""
    d = normal(120)
    d[40] += 0.05
    frame = pd.DataFrame({"d": d, "hour": np.repeat(np.arange(30), 4)}).sample(frac=1, random_state=1)
    frame["at"] = frame.index
    chosen = LIMITS | {"order": "at", "subgroup": "hour", "rules": "western electric"}
    chart = analysed(frame, chosen).responses[0].chart
    assert (chart.kind, chart.of, len(chart.points), chart.beyond) == ("xbar-r", "subgroups", 30, (10,))
    assert chart.spread.beyond == (10,)
    assert list(chart.marks) == [f"western electric {n}" for n in (1, 2, 3, 4)]
    assert chart == analysed(frame, chosen | {"subgroup": 4}).responses[0].chart
    assert list(analysed(frame, LIMITS | {"rules": [8, 1]}).responses[0].chart.marks) == ["nelson 1", "nelson 8"]
    averages = analysed(frame, LIMITS | {"order": "at", "chart": "ewma", "ewma_weight": 0.1})
    assert averages.responses[0].chart.kind == "ewma"
    files = clearcap.capability_report(frame, chosen, tmp_path, ["html", "json"])
    page = Path(files["html"]).read_text("utf-8")
    assert "Ranges with control limits; beyond them: 1." in page
    assert "western electric 1, beyond 3 sigma: 1" in page
    assert json.loads(Path(files["json"]).read_text("utf-8"))["responses"][0]["chart"]["kind"] == "xbar-r"


def test_the_gauge_is_taken_out_of_sigma_and_into_the_decision(tmp_path):
    """Parts of sigma 4 um, a gauge of 1.9 um: Cpk of the parts; counts by hand; no interval where none holds."""
    rng = np.random.default_rng(4)
    parts = rng.normal(20.0019, 0.004, 2000)
    d = parts + rng.normal(0, 0.0019, 2000)
    chosen = {"characteristics": {"d": {**LIMITS["characteristics"]["d"], "gauge_sigma": 0.0019, "uncertainty": 0.004}}}
    found = analysed(pd.DataFrame({"d": d}), chosen)
    r = found.responses[0]
    assert r.gauge.std == pytest.approx(np.sqrt(d.std(ddof=1) ** 2 - 0.0019**2))
    assert r.gauge.cpk == pytest.approx((20.02 - d.mean()) / (3 * r.gauge.std))
    low, high = r.gauge.cpk_interval
    assert low < 0.018 / (3 * 0.004) < high
    assert r.gauge.of_tolerance == pytest.approx(6 * 0.0019 / 0.04)
    inside = np.count_nonzero((d >= 19.984) & (d <= 20.016))
    beyond = np.count_nonzero((d < 19.976) | (d > 20.024))
    assert (r.conformity.conforming, r.conformity.nonconforming, r.conformity.undecided) == (
        inside,
        beyond,
        2000 - inside - beyond,
    )
    line = check_of(found, "Gauge")
    assert (line.level, f"{2000 - inside - beyond} undecided" in line.text) == ("attention", True)
    for change in ({"gauge_sigma": 0.0046}, {"gauge_sigma": 0.004, "gauge_freedom": 3}):
        few = analysed(pd.DataFrame({"d": d[:40]}), {"characteristics": {"d": {"usl": 20.02, **change}}})
        assert few.responses[0].gauge.cpk_interval is None
        assert few.responses[0].gauge.note
    wide = {"characteristics": {"d": {**LIMITS["characteristics"]["d"], "uncertainty": 0.02}}}
    assert check_of(analysed(pd.DataFrame({"d": d}), wide), "Gauge").level == "bad"
    page = Path(clearcap.capability_report(pd.DataFrame({"d": d}), chosen, tmp_path, ["html"])["html"]).read_text(
        "utf-8"
    )
    assert "Cpk without the gauge" in page
    assert "Proved to conform" in page


def test_the_report_says_nothing_of_simulations(tmp_path):
    frame = pd.DataFrame({"d": normal(80), "lot": np.repeat(list("ABCDEFGH"), 10)})
    frame.loc[5, "d"] = np.nan
    for limits in (LIMITS, LIMITS | {"lot": "lot", "header": {"part": "lever"}}):
        files = clearcap.capability_report(frame, limits, tmp_path, ["html", "json", "summary", "xlsx", "parquet"])
        assert set(files) == {"html", "json", "summary", "xlsx", "parquet"}
        for kind in ("html", "summary"):
            page = re.sub(r"<style.*?</style>|<[^>]+>", " ", Path(files[kind]).read_text("utf-8"), flags=re.S)
            said = " ".join(html.unescape(page).split()).lower()
            assert [word for word in OF_SIMULATIONS if word in said] == []
            assert "20.0" in said
            assert "measured parts" in said


@each(
    "limits, table, words",
    [
        ({"characteristics": {}}, {"d": [1.0]}, ["characteristics"]),
        (LIMITS | {"colour": 1}, {"d": [1.0]}, ["colour", "unknown key"]),
        ({"characteristics": {"d": {"lsl": 2.0, "usl": 1.0}}}, {"d": [1.0]}, ["characteristics.d", "lsl = 2"]),
        ({"characteristics": {"d": {"usl": 1.0, "requirement": "high"}}}, {"d": [1.0]}, ["requirement", "high"]),
        (LIMITS, {"dia": [1.0]}, ["characteristics.d", "no column d", "dia"]),
        (LIMITS | {"order": "time"}, {"d": [1.0]}, ["order", "time"]),
        (LIMITS, {"d": ["20.1", "about 20"]}, ["row 2", "about 20"]),
        ({"characteristics": {"d": {"usl": 1.0, "gauge_freedom": 9}}}, {"d": [1.0]}, ["gauge_freedom", "gauge_sigma"]),
        (LIMITS | {"subgroup": "hour"}, {"d": [1.0]}, ["subgroup", "hour"]),
        (LIMITS | {"chart": "xbar-r"}, {"d": [1.0]}, ["xbar-r", "subgroup"]),
        (LIMITS | {"chart": "i-mr", "subgroup": 5}, {"d": [1.0]}, ["i-mr", "subgroup"]),
        (LIMITS | {"chart": "ewma", "rules": "nelson"}, {"d": [1.0]}, ["rules", "leave"]),
        (LIMITS | {"ewma_weight": 0.2}, {"d": [1.0]}, ["ewma_weight"]),
        (LIMITS | {"rules": [9]}, {"d": [1.0]}, ["rules"]),
        (LIMITS, {"d": ["20.1", "20,2"]}, ["decimal comma (20,2)", "decimal point (20.1)"]),
        (LIMITS, {"d": []}, ["0 rows"]),
        (LIMITS, {"d": ["", " "], "no": [None, ""]}, ["0 rows"]),
        (LIMITS | {"order": "at"}, {"d": [1.0, 2.0], "at": ["3/4/26", "4/5/26"]}, ["at", "3/4/26", "month"]),
        (LIMITS | {"order": "at"}, {"d": [1.0, 2.0], "at": ["2026-11-03", "later"]}, ["row 2", "later"]),
        (LIMITS | {"order": "at"}, {"d": [1.0, 2.0], "at": ["2026-11-03", None]}, ["row 2", "empty"]),
    ],
)
def test_what_does_not_fit_is_refused(limits, table, words):
    with pytest.raises(SpecError) as refused:
        analysed(pd.DataFrame(table), limits)
    assert [word for word in words if word not in str(refused.value)] == []


def test_files_that_are_no_tables_are_refused(tmp_path):
    for name, content in (
        ("a.pdf", b"%PDF"),
        ("b.parquet", b"PAR1"),
        ("c.xlsx", b"PK"),
        ("d.csv", b""),
        ("e.csv", None),
    ):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(SpecError, match=name):
            read_parts(tmp_path / name)


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts.csv").write_text("\n".join(["d", *texts(normal(400))]))
    (tmp_path / "limits.toml").write_text('[characteristics.d]\nunit = "mm"\nnominal = 20\ntolerance = 0.02\n')
    done = CliRunner().invoke(app, ["capability", "parts.csv", "--limits", "limits.toml", "--json"])
    document = json.loads(done.stdout)
    assert (document["parts"], set(document["verdicts"])) == (400, {"d"})
    assert (tmp_path / document["report"]["html"]).exists()
    told = CliRunner().invoke(app, ["capability", "parts.csv", "--limits", "limits.toml", "--folder", "other"])
    assert told.exit_code == 0
    assert "other/report.html" in told.stdout
    assert "d [mm]" in told.stdout


def test_the_study_of_a_gauge(tmp_path, monkeypatch):
    """The command and the function agree; decimal commas; a table without repeats, with reference values."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    frame = pd.DataFrame([(o, p) for o in "ABC" for p in range(10) for _ in range(2)], columns=["who", "part"])
    frame["value"] = (rng.normal(size=10)[frame["part"]] + 0.1 * rng.normal(size=60)).round(4)
    frame.to_csv("study.csv", sep=";", decimal=",", index=False)
    found = clearcap.gauge_study("study.csv", operator="who", tolerance=6.0).repeatability
    assert found == clearcap.gauge_study(frame, operator="who", tolerance=6.0).repeatability
    words = ["gauge", "study.csv", "--operator", "who", "--tolerance", "6"]
    printed = CliRunner().invoke(app, words).stdout
    assert found.verdict in printed
    assert f"gauge_sigma = {found.components[0].std:.4g}" in printed
    document = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert document["repeatability"]["components"][0]["std"] == pytest.approx(found.components[0].std)
    known = pd.DataFrame({"reference": np.repeat([1.0, 2.0, 3.0], 12)})
    known["value"] = 1.02 * known["reference"] + 0.01 * rng.normal(size=36)
    bias = clearcap.gauge_study(known).bias
    assert bias.linearity.slope_interval[0] < 0.02 < bias.linearity.slope_interval[1]
    known.to_csv("known.csv", index=False)
    assert "linearity: bias = " in CliRunner().invoke(app, ["gauge", "known.csv"]).stdout
    for table, options in (
        (known.drop(columns="value"), {}),
        (frame[1:], {"operator": "who"}),
        (frame, {"part": "no"}),
    ):
        with pytest.raises(SpecError, match="table"):
            clearcap.gauge_study(table, **options)


def test_the_head_names_part_drawing_and_class(tmp_path):
    """Fields of PPAP and VDA, with the sample size, in report, summary and workbook; keys are checked."""
    part = {"number": "4711", "name": "Lever", "drawing": "D-4711", "revision": "C", "operator": "E. Weber"}
    d = LIMITS["characteristics"]["d"] | {"requirement": "critical"}
    limits = {
        "part": part | {"machine": "press 3", "gauge": "micrometer"},
        "header": {"customer": "Schneider"},
        "requirements": {"critical": 1.67},
        "characteristics": {"d": d},
    }
    kinds = ["html", "json", "summary", "xlsx"]
    files = clearcap.capability_report(pd.DataFrame({"d": normal()}), limits, tmp_path, kinds)
    document = json.loads(Path(files["json"]).read_text())
    header = document["header"]
    assert list(header) == [
        *("part number", "part name", "drawing", "revision", "machine", "gauge", "operator"),
        *("sample size", "customer"),
    ]
    assert header["sample size"] == "200"
    assert document["responses"][0]["spec"]["characteristic_class"] == "critical"
    for kind in ("html", "summary"):
        said = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", Path(files[kind]).read_text())))
        for name, text in header.items():
            assert f"{name.capitalize()} {text}" in said, (kind, name)
        assert "critical" in said, kind
    sheet = pd.read_excel(files["xlsx"], sheet_name="Provenance", index_col=0)["value"]
    assert str(sheet["part number"]) == "4711"
    with pytest.raises(SpecError, match=r"part\.revison"):
        load_limits(LIMITS | {"part": {"revison": "C"}})
    assert "sample size" not in asked_of_parts(pd.DataFrame({"d": normal()}), LIMITS)[1].header


def test_the_model_class_is_named_with_what_it_rests_on():
    """Of parts in order; of others nothing is said, nor of simulated samples."""
    found = analysed(pd.DataFrame({"d": normal()}), LIMITS)
    model = found.responses[0].time_model
    assert (model.name, model.groups, model.of) == ("A1", 40, "consecutive values")
    check = check_of(found, "Model class (ISO 22514-2)")
    assert (check.text, check.level) == (f"d: {model.text}", "info")  # too few to exclude a spread that varies
    assert model.possible == ("B",)
    many = analysed(pd.DataFrame({"d": normal(300)}), LIMITS)
    assert check_of(many, "Model class (ISO 22514-2)").level == "good"
    drifts = analysed(pd.DataFrame({"d": normal() + np.linspace(0, 0.02, 200)}), LIMITS)
    assert drifts.responses[0].time_model.name == "C3"
    assert check_of(drifts, "Model class (ISO 22514-2)").level == "attention"
    unordered = analysed(pd.DataFrame({"d": normal()}), LIMITS | {"ordered": False})
    assert unordered.responses[0].time_model is None
