"""report.xlsx: the tables of the report as sheets, for further calculations.

The head of a sheet stays in view, columns fit their texts, and numbers have few enough digits to read.
"""

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from reporting.analysis import Analysis
from reporting.capability.indices import NAMES
from reporting.capability.verdict import CAPABLE, MARGINAL
from reporting.format_numbers import decimals_for, fixed, plain
from reporting.response import ResponseAnalysis
from reporting.samples import Samples

if TYPE_CHECKING:
    from xlsxwriter import Workbook
    from xlsxwriter.format import Format

DIGITS = 6  # shown in a cell, which stores the full number
LEAST_WIDTH, MOST_WIDTH = 9, 60  # width of a column in letters; longer texts are wrapped
LONGEST_TEXT = 32_000  # letters; Excel allows 32,767
_SMALLEST = 1e-6  # smaller numbers are shown with an exponent
ROWS = 2_000  # samples in the preview; all of them are in the store
_WORDS = {"capable": "#E4F3EA", "marginal": "#FDF1D3", "not capable": "#FCE6E1"}

Table = tuple[Sequence[str], Iterable[Sequence[Any]]]


def render_workbook(analysis: Analysis, samples: Samples) -> bytes:
    """Return the workbook: summary, trust, indices, causes, inputs, failures, provenance, first samples and more."""
    import xlsxwriter

    target = io.BytesIO()
    # In memory; text that looks like a formula stays text, because names come from users' files.
    options = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False, "nan_inf_to_errors": False}
    with xlsxwriter.Workbook(target, options) as book:
        # A fixed date: the same samples give the same bytes at any time.
        about = {"title": analysis.spec.title, "subject": f"campaign {analysis.spec.campaign}"}
        book.set_properties({**about, "created": datetime(2000, 1, 1)})
        limits = [limit for r in analysis.spec.responses for limit in (r.lsl, r.usl) if limit is not None]
        writer = SheetWriter(book, (MARGINAL, CAPABLE, *limits), _WORDS)
        for name, (heads, rows) in _tables(analysis, samples).items():
            writer.write(name, heads, rows)
    return target.getvalue()


def _tables(analysis: Analysis, samples: Samples) -> dict[str, Table]:
    """Return the sheets in order."""
    spec = analysis.spec
    people = [("author", spec.author), ("campaign completed", spec.ended)]
    about = [*spec.header.items(), *((name, text) for name, text in people if text), ("campaign", spec.campaign)]
    about += spec.provenance.items()
    return {
        "Summary": _summary(analysis),
        "Trust": (("check", "result", "finding"), [(c.name, c.level, c.text) for c in analysis.trust]),
        "Repeatability": _repeatability(analysis.responses),
        "Product": _product(analysis),
        "Indices": _indices(analysis.responses),
        "Tolerance intervals": _tolerance_intervals(analysis.responses),
        "Stack-up": _stack(analysis.responses),
        "Causes": _causes(analysis),
        "Advice": _advice(analysis),
        "Inputs": _inputs(analysis),
        "Assumptions": _assumptions(analysis),
        "Failures": (
            ("sample", "status", "message", "command"),
            [(f.sample, f.status, f.message, f.command) for f in analysis.failures],
        ),
        "Provenance": (("item", "value"), about),
        "Samples": _samples(analysis, samples),
    }


def _summary(analysis: Analysis) -> Table:
    """Return the sheet with one row per response."""
    heads = ("response", "unit", "verdict", "index", "index low", "index high", "required", "certain", "by",
             "why", "LSL", "USL", "mean", "sigma", "min", "max", "Cp",
             "Cpk", "Cpk low", "Cpk high", "Cc", "ppm observed", "ppm at most", "ppm expected (normal)",
             "ppm expected", "ppm expected low", "ppm expected high", "expected by")  # fmt: skip
    rows = []
    for r in analysis.responses:
        c, spec = r.capability, r.spec
        low, high = c.cpk_interval or (None, None)
        found, expected = r.verdict, r.expected
        share = (
            (expected.ppm, *(expected.interval or (None, None)), expected.by) if expected else (None, None, None, "")
        )
        rows.append((spec.name, spec.unit, found.word, found.index, found.index_low, found.index_high,
                     spec.requirement, {True: "yes", False: "no", None: ""}[found.certain], found.by,
                     " ".join(found.reasons), spec.lsl, spec.usl, c.mean, c.std, c.min, c.max,
                     c.cp, c.cpk, low, high, c.cc, c.ppm_observed, c.ppm_upper, c.ppm_expected, *share))  # fmt: skip
    return heads, rows


def _repeatability(responses: tuple[ResponseAnalysis, ...]) -> Table:
    """Return the scatter of each response between runs of the same sample with different steps."""
    heads = ("response", "unit", "pairs", "one run failed", "sigma of the scatter", "sigma low", "sigma high",
             "share of the variance", "share low", "share high", "inputs explain at most",
             "half the step moves the mean by", "move low", "move high")  # fmt: skip
    rows = [
        (r.spec.name, r.spec.unit, f.pairs, f.lost, f.sigma, *(f.sigma_interval or (None, None)), f.share,
         *(f.share_interval or (None, None)), f.removable, f.shift, *(f.shift_interval or (None, None)))
        for r in responses if (f := r.repeatability)
    ]  # fmt: skip
    return heads, rows


def _product(analysis: Analysis) -> Table:
    """Return the yield of the whole product, and the loss by response."""
    heads = ("what", "conforming", "samples", "share", "low", "high", "yield without its rejects")
    found = analysis.product
    if found is None:
        return heads, []
    counts = {"all limits together": found.counted, "failures as rejects": found.with_failures}
    rows: list[Sequence[Any]] = [
        (name, c.conforming, c.n, c.share, *c.interval) for name, c in counts.items() if c is not None
    ]
    rows.append(("rolled throughput", None, None, found.rolled))
    n = found.counted.n if found.counted else 0
    for loss in found.losses:
        part = f"part of the rejects: {loss.response}"
        rows.append((part, n - loss.rejects, n, loss.share, *loss.share_interval, loss.yield_without))
    for each in found.by_variable.shares if found.by_variable else ():
        rows.append((f"of all rejects: {each.variable}", None, n, each.share, *each.interval))
    return heads, rows


def _indices(responses: tuple[ResponseAnalysis, ...]) -> Table:
    """Return every index with both of its names and its interval."""
    rows: list[Sequence[Any]] = []
    for r in responses:
        for key, name in NAMES.items():
            interval = getattr(r.capability, f"{key}_interval", None) or (None, None)
            rows.append((r.spec.name, name.paper, name.overall, getattr(r.capability, key), *interval, name.formula))
        if r.target_indices:
            t = r.target_indices
            rows.append((r.spec.name, "Cpm*", "", t.cpm_star, *(t.cpm_star_interval or (None, None)),
                         "min(USL − T, T − LSL) / 3τ"))  # fmt: skip
            rows.append((r.spec.name, "Cpmk", "", t.cpmk, *(t.cpmk_interval or (None, None)),
                         "min(USL − m, m − LSL) / 3τ"))  # fmt: skip
        if r.historical:
            h = r.historical
            rows += [(r.spec.name, f"{name}, historical", "", value, None, None, "with historical mean and sigma")
                     for name, value in (("Cp", h.cp), ("Cpk", h.cpk))]  # fmt: skip
        rows += [(r.spec.name, f"Cpk, {s.method}", "", s.cpk, None, None, "sigma within batches") for s in r.subgroups]
        for m in r.methods:
            interval = m.ppk_interval or (None, None)
            rows.append((r.spec.name, f"Ppk by {m.method}", m.family or "", m.ppk, *interval, m.assumed))
    return ("response", "index", "AIAG, ISO 22514-2", "value", "low", "high", "formula"), rows


def _tolerance_intervals(responses: tuple[ResponseAnalysis, ...]) -> Table:
    """Return the tolerance intervals of each response."""
    heads = ("response", "share of production", "confidence", "normal low", "normal high", "normal: above",
             "normal: below", "any low", "any high", "any: above", "any: below", "note")  # fmt: skip
    rows = [
        (r.spec.name, t.content, found.confidence, *(t.normal or (None, None)), t.normal_lower, t.normal_upper,
         *(t.free or (None, None)), t.free_lower, t.free_upper, found.note)
        for r in responses if (found := r.tolerance_intervals) for t in found.claims
    ]  # fmt: skip
    return heads, rows


def _stack(responses: tuple[ResponseAnalysis, ...]) -> Table:
    """Return worst case and root sum of squares from slopes, and the contribution of each variable."""
    heads = ("response", "variable or range", "low", "high", "slope", "adds to the worst case", "bounds",
             "variance explained", "shape")  # fmt: skip
    rows: list[Sequence[Any]] = []
    for name, s in ((r.spec.name, r.stack) for r in responses if r.stack):
        three = 3 * s.rss_sigma
        rows += [
            (name, "samples", *s.sampled),
            (name, "worst case by slopes", *s.worst, None, None, None, s.explained, s.shape),
            (name, "RSS by slopes", *s.rss),
            (name, "3 sigma RSS by slopes", s.nominal - three, s.nominal + three),
        ]
        for v in s.variables:
            ends = "bounds" if v.bounded else "mean ± 3 sigma"
            rows.append((name, v.variable, v.lower, v.upper, v.slope, v.half_width, ends))
    return heads, rows


def _causes(analysis: Analysis) -> Table:
    """Return the influence of the variables on each response."""
    rows = [
        (r.spec.name, i.variable, i.first_order, *(i.first_order_interval or (None, None)), i.total,
         *(i.total_interval or (None, None)), i.contribution, i.coefficient, i.spearman, i.verdict)
        for r in analysis.responses if r.sensitivity for i in r.sensitivity.influences
    ]  # fmt: skip
    heads = ("response", "variable", "share alone", "alone low", "alone high", "share with interactions",
             "with interactions low", "with interactions high", "linear share", "coefficient", "Spearman",
             "verdict")  # fmt: skip
    return heads, rows


def _advice(analysis: Analysis) -> Table:
    """Return the spreads that must shrink for responses below target, then those that may grow for the others."""
    heads = ("question", "variable", "factor on sigma", "low", "high", "at least", "limited by", "Cpk then", "write",
             "method", "why no more")  # fmt: skip
    asked = [(f"bring {s.response} to {s.aim}", a) for s in analysis.shortfalls
             for a in (*s.alone, s.together) if a is not None]  # fmt: skip
    asked += [(f"keep {', '.join(analysis.kept)} at {analysis.kept_at}", a) for a in analysis.advice]
    rows = [
        (question, a.variable, a.factor, *a.interval, "" if a.bounded else "yes", a.binding or "", a.cpk,
         " ".join(a.settings), a.method, a.refusal or a.limit)
        for question, a in asked
    ]  # fmt: skip
    return heads, rows


def _inputs(analysis: Analysis) -> Table:
    """Return the requested and the drawn distributions."""
    heads = ("variable", "unit", "distribution", "mean requested", "mean obtained", "sigma requested",
             "sigma obtained", "min", "max", "distance", "p")  # fmt: skip
    rows = [
        (v.spec.name, v.spec.unit, v.spec.distribution, v.spec.mean, v.mean, v.spec.std, v.std, v.min, v.max,
         v.distance, v.p_value)
        for v in analysis.variables
    ]  # fmt: skip
    return heads, rows


def _assumptions(analysis: Analysis) -> Table:
    """Return the quantities that are the same in every run; vector components are listed one below the other."""
    heads = ("group", "assumption", "value", "unit", "key")
    rows: list[Sequence[Any]] = []
    for each in analysis.spec.assumptions:
        numbers = each.value if isinstance(each.value, tuple) else (each.value,)
        names = [f"{each.name}, {axis}" for axis in "xyz"] if isinstance(each.value, tuple) else [each.name]
        rows += [(each.group, name, x, each.unit, each.key) for name, x in zip(names, numbers, strict=True)]
    return heads, rows


def _samples(analysis: Analysis, samples: Samples) -> Table:
    """Return the first samples."""
    spec = analysis.spec
    units = {v.name: v.unit for v in spec.variables} | {r.name: r.unit for r in spec.responses}
    columns = [samples.values[name][:ROWS].tolist() for name in units]
    status = np.asarray(samples.statuses)[samples.status[:ROWS]].tolist() if samples.status.size else []
    heads = ("sample", "status", *(name if u in ("", "1") else f"{name} [{u}]" for name, u in units.items()))
    return heads, zip(samples.sample[:ROWS].tolist(), status, *columns, strict=True)


class SheetWriter:
    """Writes the sheets of one workbook."""

    # No displayed number is rounded onto or across one of `fences`: limits, and the thresholds of an index. `colours`
    # are background colours of a cell, by its word.

    def __init__(self, book: "Workbook", fences: Iterable[float], colours: Mapping[str, str]) -> None:
        self._book, self._fences = book, tuple(fences)
        self._head = book.add_format(
            {"bold": True, "text_wrap": True, "valign": "top", "bottom": 1, "bg_color": "#F4F6F9"}
        )
        self._text = book.add_format({"text_wrap": True, "valign": "top"})
        self._words = {word: book.add_format({"bg_color": c, "valign": "top"}) for word, c in colours.items()}
        # One format for each pattern, because the workbook keeps every format that is added.
        self._numbers = cache(self._number_format)

    def write(self, name: str, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        """Write a sheet of texts, numbers and None, which becomes an empty cell; all headings differ."""
        sheet = self._book.add_worksheet(name)
        sheet.freeze_panes(1, 1)
        sheet.set_landscape()
        sheet.repeat_rows(0)
        sheet.fit_to_pages(1, 0)
        widths = [max(map(len, head.split())) for head in heads]
        for column, head in enumerate(heads):
            sheet.write_string(0, column, head, self._head)
        last = 0
        for last, row in enumerate(rows, start=1):
            for column, value in enumerate(row):
                if isinstance(value, str):
                    sheet.write_string(last, column, value[:LONGEST_TEXT], self._words.get(value, self._text))
                    widths[column] = max(widths[column], len(value))
                elif value is not None and math.isfinite(value):
                    pattern = number_pattern(value, self._fences)
                    sheet.write_number(last, column, value, self._numbers(pattern, heads[column] == "index"))
                    widths[column] = max(widths[column], len(pattern) + len(str(abs(int(value)))))
        for column, width in enumerate(widths):
            sheet.set_column(column, column, min(max(width + 2, LEAST_WIDTH), MOST_WIDTH))
        sheet.autofilter(0, 0, last, len(heads) - 1)

    def _number_format(self, pattern: str, is_bold: bool) -> "Format":
        """Return the format of numbers with a pattern; that of the index that decides is bold."""
        return self._book.add_format({"num_format": pattern, "valign": "top", "bold": is_bold})


def number_pattern(value: float, fences: Sequence[float]) -> str:
    """Return Excel's format of a number: as given if it is short, else with `DIGITS` digits, or more near a fence."""
    short = plain(value)
    if "e" not in short and len(short.lstrip("-0.").replace(".", "")) <= DIGITS:
        return "General"
    if abs(value) < _SMALLEST:
        return f"0.{'0' * (DIGITS - 1)}E+00"
    decimals = len(fixed(value, decimals_for(value, DIGITS), fences).partition(".")[2])
    return f"0.{'0' * decimals}" if decimals else "0"
