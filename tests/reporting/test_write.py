"""The files of a report: self-contained, safe, complete, and there for every campaign however odd."""

import json
import os
import re
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import asdict, is_dataclass, replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.report import report_of
from reporting import ReportError, ResponseSpec, write_report
from reporting.key_findings import weakest
from reporting.render.data_files import render_json
from reporting.render.figures import response_figure
from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

VOID = {"meta", "link", "br", "input", "img", "hr"}


class Page(HTMLParser):
    """Collects what the tests ask of a page, and checks that every element is closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs) -> None:
        """Note an element and that it is open."""
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs) -> None:
        """Note an element that closes itself."""
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag) -> None:
        """Check that the element opened last is the one that closes."""
        assert self.open.pop() == tag

    def handle_data(self, data) -> None:
        """Collect the text a reader sees."""
        if "style" not in self.open:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """Return the attributes of every such element."""
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def page() -> Page:
    return Page(render_html(analysis_of(c60_table(200, 3), c60_spec(200))))


def test_the_page_needs_nothing_from_outside_and_no_script(page: Page) -> None:
    for tag, attributes in page.tags:
        assert tag not in ("script", "iframe", "object", "embed", "img")
        for name, value in attributes.items():
            assert not name.startswith("on"), (tag, name)
            if name in ("src", "href", "xlink:href"):
                assert (value or "").startswith(("#", "data:,")), (tag, name, value)
    css = render_html(analysis_of(c60_table(5), c60_spec(5)))
    assert "@import" not in css
    assert "url(http" not in css


def test_every_figure_says_what_it_shows(page: Page) -> None:
    figures = page.all("svg")
    small = [figure for figure in figures if figure["aria-label"].startswith("Distribution of")]
    assert len(small) == 7  # beside each response
    # Two over all, six on the page of a response, five of its details, the six of one without limits, one a variable.
    assert len(figures) - len(small) == 2 + 6 * (6 + 5) + 6 + 7
    assert len(page.all("figcaption")) == len(figures) - len(small)
    labels = [figure["aria-label"] for figure in figures]
    assert all(figure["role"] == "img" for figure in figures)
    assert len(set(labels)) == len(labels)
    fc1 = next(label for label in labels if label.startswith("Histogram of FC-1:"))
    assert "lower limit 9 N" in fc1
    assert "upper limit 16 N" in fc1
    assert "0 values out of limits" in fc1


def test_the_page_is_a_sound_outline(page: Page) -> None:
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(set(ids)) == len(ids)
    targets = [a["href"][1:] for a in page.all("a")]
    assert targets
    assert set(targets) <= set(ids)
    assert len(page.all("caption")) == len(page.all("table"))
    assert all(th.get("scope") for th in page.all("th"))
    assert page.all("html")[0]["lang"] == "en"


def test_the_page_says_the_words_not_only_the_colours(page: Page) -> None:
    for word in ("capable", "marginal", "not capable", "no limits", "assumed", "Ppk", "not_converged", "crashed"):
        assert word in page.text, word
    assert "clearcap simulate c60 --set J1=" in page.text
    assert "197 of 200 samples ok, 3 failed" in " ".join(page.text.split())


def test_the_headline_names_the_weakest(campaign) -> None:
    a = analysis_of(*campaign(500))
    bad = "Not capable: FC-4. Marginal, not certain: FC-3. Capable, not certain: FC-1, FC-2, FC-5, FC-6."
    assert a.headline == f"{bad} Certainly capable: none of 6 responses with limits."
    assert weakest(a).spec.name == "FC-4"


HOSTILE = "<script>alert('x')</script>\"&$x^2$ Ω轴"


def test_hostile_and_foreign_names_are_only_text(campaign) -> None:
    table, spec = campaign(60, 4)
    table = table.rename_columns(
        [{"FC-1": HOSTILE, "J1": HOSTILE + "1"}.get(name, name) for name in table.column_names]
    )
    at = table.schema.get_field_index("message")
    table = table.set_column(at, "message", pa.array([HOSTILE] * 60))
    spec = replace(
        spec,
        title=HOSTILE,
        campaign=HOSTILE,
        header={HOSTILE: HOSTILE},
        provenance={HOSTILE: HOSTILE},
        responses=(
            replace(spec.responses[0], name=HOSTILE, title=HOSTILE, unit=HOSTILE, source=HOSTILE),
            *spec.responses[1:],
        ),
        variables=(
            replace(spec.variables[0], name=HOSTILE + "1", unit=HOSTILE, distribution=HOSTILE),
            *spec.variables[1:],
        ),
    )
    hostile = Page(render_html(analysis_of(table, spec)))
    assert hostile.all("script") == []
    assert HOSTILE in hostile.text
    assert len(hostile.all("svg")) == len(Page(render_html(analysis_of(*campaign(60, 4)))).all("svg"))
    axis = response_figure(analysis_of(table, spec).responses[0]).partition(">")[2]
    assert "&amp;$x^2$ Ω轴" in axis  # the label as written, not as a formula
    assert "Ω轴" in render_json(analysis_of(table, spec))


def test_the_same_samples_give_the_same_bytes(campaign, tmp_path: Path, fitted_once) -> None:
    table, spec = campaign(60, 4)
    first = {kind: Path(path).read_bytes() for kind, path in write_report(table, spec, tmp_path / "a").items()}
    with ExitStack() as stack:
        for remembered in fitted_once:
            stack.enter_context(remembered.forgotten())
        second = {kind: Path(path).read_bytes() for kind, path in write_report(table, spec, tmp_path / "b").items()}
    assert first == second


def test_json_holds_every_number_of_the_analysis(campaign) -> None:
    a = analysis_of(*campaign(60, 4))
    found = json.loads(render_json(a))
    assert found["format"] == 2
    assert (found["requested"], found["finished"], found["ok"], found["failed"]) == (60, 60, 56, 4)
    assert found["campaign"] == "c60-0123456789"
    assert found["thresholds"] == {"capable": 1.33, "marginal": 1.0}
    assert {s["status"]: s["count"] for s in found["statuses"]}["timeout"] == 2
    for written, r in zip(found["responses"], a.responses, strict=True):
        found_verdict = (
            written["verdict"],
            written["certain"],
            written["verdict_by"],
            tuple(written["verdict_reasons"]),
        )
        assert found_verdict == (r.verdict.word, r.verdict.certain, r.verdict.by, r.verdict.reasons)
        assert written["spec"]["lsl"] == r.spec.lsl
        for name, value in vars(r.capability).items():
            if name not in ("lsl", "usl", "target"):
                value = asdict(value) if is_dataclass(value) else value
                expected = list(value) if isinstance(value, tuple) else value
                assert written["capability"][name] == expected, name
        assert written["histogram"]["counts"] == list(r.histogram.counts)
        assert (written["yield"] is None) == (r.yield_ is None)
    assert [v["mean"] for v in found["variables"]] == [v.mean for v in a.variables]
    assert [c["text"] for c in found["trust"]] == [c.text for c in a.trust]
    assert [f["command"] for f in found["failures"]] == [f.command for f in a.failures]
    assert found["provenance"]["seed"] == "2018"


def test_every_number_of_the_page_is_in_the_json(campaign) -> None:
    """The summary row of FC-1, digit by digit: what is shown is a rounding of what is stored."""
    a = analysis_of(*campaign(200, 3))
    c = json.loads(render_json(a))["responses"][0]["capability"]
    text = Page(render_html(a)).text
    for shown in (f"{c['mean']:.3f}", f"{c['cp']:.3f}", f"{c['cpk']:.3f}", f"{c['cc']:.3f}", f"{c['max']:.3f}"):
        assert shown in text


def odd(table: pa.Table, spec, what: str):
    """Return a campaign with nothing normal about it."""
    one = (ResponseSpec("FC-1", "", "N", 9.0, 16.0, None, ""),)
    n = len(table)
    spec = replace(spec, responses=spec.responses[:2], variables=spec.variables[:1])

    def with_values(values) -> pa.Table:
        return table.set_column(table.schema.get_field_index("FC-1"), "FC-1", pa.array(values, pa.float64()))

    failed = table.set_column(table.schema.get_field_index("status"), "status", pa.array(["diverged"] * n))
    return {
        "no limits": (table, replace(spec, responses=(replace(one[0], lsl=None, usl=None),))),
        "lower only": (table, replace(spec, responses=(replace(one[0], usl=None),))),
        "upper only": (table, replace(spec, responses=(replace(one[0], lsl=None),))),
        "constant": (with_values([13.6] * n), replace(spec, responses=one)),
        "constant on a limit": (with_values([16.0] * n), replace(spec, responses=one)),
        "constant zero": (with_values([0.0] * n), replace(spec, responses=one)),
        "huge": (with_values(np.linspace(1e12, 3e12, n)), replace(spec, responses=one)),
        "tiny spread": (with_values(13.6 + 1e-9 * np.arange(n)), replace(spec, responses=one)),
        "one row": (table.slice(0, 1), replace(spec, requested=1)),
        "one row of many": (table.slice(0, 1), spec),
        "all failed": (failed, spec),
        "no row": (table.slice(0, 0), spec),
        "NaN column": (with_values([float("nan")] * n), spec),
        "infinite values": (with_values([float("inf")] * n), spec),
        "null column": (table.set_column(table.schema.get_field_index("FC-1"), "FC-1", pa.nulls(n)), spec),
        "no responses": (table, replace(spec, responses=())),
        "no variables": (table, replace(spec, variables=())),
        "no header, no provenance": (table, replace(spec, header={}, provenance={})),
        "constant variable": (
            table.set_column(table.schema.get_field_index("J1"), "J1", pa.array([0.07] * n)),
            replace(spec, variables=(replace(spec.variables[0], std=0.0, density=(), lower=0.07, upper=0.07),)),
        ),
        "bare unit": (table, replace(spec, responses=(replace(one[0], unit="1"),))),
    }[what]


@pytest.mark.parametrize(
    "what",
    [
        "no limits",
        "lower only",
        "upper only",
        "constant",
        "constant on a limit",
        "constant zero",
        "huge",
        "tiny spread",
        "one row",
        "one row of many",
        "all failed",
        "no row",
        "NaN column",
        "infinite values",
        "null column",
        "no responses",
        "no variables",
        "no header, no provenance",
        "constant variable",
        "bare unit",
    ],
)
def test_every_odd_campaign_gets_a_report(campaign, tmp_path: Path, what: str) -> None:
    table, spec = odd(*campaign(12), what)
    paths = write_report(table, spec, tmp_path)
    odd_page = Page(Path(paths["html"]).read_text(encoding="utf-8"))
    words = odd_page.text.split()
    assert not {"nan", "inf", "None", "-inf", "nan,"} & set(words)
    json.loads(Path(paths["json"]).read_text(encoding="utf-8"), parse_constant=pytest.fail)


def test_a_limit_is_in_view_however_far(campaign) -> None:
    """The LSL label of a response that lies far above it stands within the figure's box."""
    table, spec = campaign(60)
    far = replace(spec, responses=(replace(spec.responses[0], lsl=-500.0),), variables=())
    svg = re.search(
        r'<svg viewBox="0 0 ([\d.]+) [\d.]+" role="img" aria-label="Histogram of FC-1.*?</svg>',
        render_html(analysis_of(table, far)),
        re.DOTALL,
    )
    x = re.search(r"translate\(([\d.-]+) [\d.-]+\)[^>]*>LSL -500<|x=\"([\d.-]+)\"[^>]*>LSL -500<", svg[0])
    assert 0 <= float(x[1] or x[2]) <= float(svg[1])


def test_an_error_leaves_the_folder_as_it_was(campaign, tmp_path: Path) -> None:
    table, spec = campaign(12)
    write_report(table, spec, tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ReportError):
        write_report(table.drop_columns(["FC-1"]), spec, tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert sorted(before) == ["capability.json", "capability.parquet", "report.html", "report.xlsx"]


def test_a_write_that_breaks_off_keeps_the_old_file(campaign, tmp_path: Path, monkeypatch) -> None:
    table, spec = campaign(12)
    paths = write_report(table, spec, tmp_path)
    before = Path(paths["html"]).read_bytes()

    def refuse(source: str, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(ReportError, match="No space left on device"):
        write_report(table, replace(spec, title="another"), tmp_path)
    assert Path(paths["html"]).read_bytes() == before
    assert len(list(tmp_path.iterdir())) == len(paths)


def test_a_folder_that_cannot_be_made_is_one_clear_error(campaign, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ReportError, match=r"report folder .*file"):
        write_report(*campaign(12), tmp_path / "file" / "report")


@pytest.mark.slow
def test_the_page_of_the_papers_campaign_has_less_than_three_megabytes(tmp_path: Path) -> None:
    """What it takes: `python -m benchmarks report`."""
    paths = write_report(c60_table(30_850, 50), c60_spec(30_850), tmp_path)
    assert os.path.getsize(paths["html"]) < 3e6


@pytest.mark.slow
def test_a_million_samples_take_less_than_a_gigabyte(tmp_path: Path) -> None:
    """Six responses of seven variables, streamed."""
    figures = report_of(1_000_000)
    assert (figures["responses"], figures["variables"]) == (6, 7)
    assert figures["page_MB"] < 3
    assert figures["memory_MiB"] < 1024


@pytest.mark.processes
def test_importing_reporting_is_light() -> None:
    heavy = ("matplotlib", "pyarrow", "pandas", "dask", "scipy.stats")
    code = f"import sys, reporting; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
