"""Write the files of a report, each whole or not at all."""

import os
import tempfile
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from reporting.errors import ReportError
from reporting.render.json import render_json
from reporting.samples import Samples, read_samples
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    from reporting.analysis import Analysis, Widen
    from reporting.samples import Rows

NAMES = {
    "html": "report.html",
    "pdf": "report.pdf",
    "xlsx": "report.xlsx",
    "json": "capability.json",
    "parquet": "capability.parquet",
}
USUAL = ("html", "json", "parquet", "xlsx")
# What a file takes beyond the packages that clearcap needs anyway.
EXTRAS = {"pdf": ("weasyprint", "pdf"), "xlsx": ("xlsxwriter", "excel")}


def write_report(
    rows: "Rows",
    spec: ReportSpec,
    folder: Path,
    *,
    kinds: Collection[str] = USUAL,
    widen: "Widen | None" = None,
    against: "tuple[Rows, ReportSpec] | None" = None,
) -> dict[str, str]:
    """Analyse the samples and write the files of their report.

    All are rendered before the first is written, so an error leaves the folder as it was.

    Parameters
    ----------
    rows : pyarrow.Table or iterable of pyarrow.Table
        One row per finished sample, see `reporting.samples.read_samples`.
    spec : ReportSpec
        What was asked.
    folder : Path
        Where the files go; created if it does not exist.
    kinds : collection of str
        Keys of `NAMES`; "html" and "json" are always written. A file whose package is not installed is left out, and
        the page says how to get it.
    widen, against
        See `reporting.analysis.analyse`.

    Returns
    -------
    dict of str to str
        Path of each file by kind.

    Raises
    ------
    ReportError
        The rows do not fit the spec, or the folder cannot be written.
    """
    from reporting.analysis import analyse

    samples = read_samples(rows, spec)
    analysis = analyse(samples, spec, widen, against)
    contents = _rendered(analysis, samples, {"html", "json", *kinds})
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return {kind: str(_replace(folder / NAMES[kind], content)) for kind, content in contents.items()}
    except OSError as error:
        raise ReportError(f"report folder {folder}: {error.strerror or error}; name a folder you may write") from error


def _rendered(analysis: "Analysis", samples: Samples, kinds: set[str]) -> dict[str, bytes]:
    """Return the content of the files by kind, in the order of `NAMES`."""
    from reporting.render.html import render_html

    there = {kind for kind in kinds if kind not in EXTRAS or _installed(EXTRAS[kind][0])}
    files = tuple(NAMES[kind] for kind in NAMES if kind in there and kind != "html")
    page = render_html(analysis, files, _missing(kinds - there))
    render: dict[str, Callable[[], bytes]] = {
        "html": page.encode,
        "pdf": lambda: _pdf(page),
        "xlsx": lambda: _workbook(analysis, samples),
        "json": lambda: render_json(analysis).encode(),
        "parquet": lambda: _parquet(analysis),
    }
    return {kind: render[kind]() for kind in NAMES if kind in there}


def _missing(kinds: set[str]) -> str:
    """Return how to get the files that are left out."""
    told = [f"{NAMES[kind]} takes pip install 'clearcap[{EXTRAS[kind][1]}]'" for kind in NAMES if kind in kinds]
    return f"Not written: {'; '.join(told)}." if told else ""


def _installed(package: str) -> bool:
    from importlib.util import find_spec

    return find_spec(package) is not None


def _pdf(page: str) -> bytes:
    from reporting.render.pdf import render_pdf

    return render_pdf(page)


def _workbook(analysis: "Analysis", samples: Samples) -> bytes:
    from reporting.render.excel import render_workbook

    return render_workbook(analysis, samples)


def _parquet(analysis: "Analysis") -> bytes:
    from reporting.render.parquet import render_parquet

    return render_parquet(analysis)


def _replace(path: Path, content: bytes) -> Path:
    """Write `content` beside `path`, then rename: a reader sees the old file or the new one."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)  # mkstemp's files are the writer's alone
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
    return path
