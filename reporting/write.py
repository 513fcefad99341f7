"""Write the files of a report; each file is written completely or not at all."""

import logging
import os
import tempfile
from collections.abc import Callable, Collection, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from reporting.analysis import Analysis, Decision, OtherSpreads, analyse
from reporting.errors import ReportError
from reporting.render.data_files import render_json, render_parquet
from reporting.render.excel import render_workbook
from reporting.render.html import render_html
from reporting.render.one_page import render_one_page
from reporting.samples import Repeats, Samples, read_samples
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    from reporting.samples import Rows

NAMES = {
    "html": "report.html",
    "pdf": "report.pdf",
    "summary": "summary.html",
    "summary_pdf": "summary.pdf",
    "xlsx": "report.xlsx",
    "json": "capability.json",
    "parquet": "capability.parquet",
}
USUAL = ("html", "json", "parquet", "xlsx")
# Optional package that a file needs, and the extra of clearcap that installs it.
EXTRAS = {"pdf": ("weasyprint", "pdf"), "summary_pdf": ("weasyprint", "pdf"), "xlsx": ("xlsxwriter", "excel")}


def write_report(
    rows: "Rows",
    spec: ReportSpec,
    folder: Path,
    *,
    kinds: Collection[str] = USUAL,
    spreads: OtherSpreads | None = None,
    against: "tuple[Rows, ReportSpec] | None" = None,
    repeats: Repeats | None = None,
    decided: Sequence[Decision] = (),
) -> dict[str, str]:
    """Analyse the samples and write the files of their report.

    All files are rendered before the first one is written, so that an error leaves the folder as it was.

    Parameters
    ----------
    rows : pyarrow.Table or iterable of pyarrow.Table
        One row for each finished sample, see `reporting.samples.read_samples`.
    spec : ReportSpec
        Limits, requested distributions and provenance.
    folder : Path
        Folder of the files; created if it does not exist.
    kinds : collection of str
        Keys of `NAMES`; "html" and "json" are always written. A file whose package is missing is omitted, and
        the page says how to install it.
    spreads, against, repeats, decided
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
    samples = read_samples(rows, spec)
    analysis = analyse(samples, spec, spreads, against, repeats, decided)
    contents = _rendered(analysis, samples, {"html", "json", *kinds})
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return {kind: str(_replace(folder / NAMES[kind], content)) for kind, content in contents.items()}
    except OSError as error:
        raise ReportError(
            f"report folder {folder}: {error.strerror or error}; free the disk, or name a folder you may write to"
        ) from error


def _rendered(analysis: Analysis, samples: Samples, kinds: set[str]) -> dict[str, bytes]:
    """Return the content of the files by kind, in the order of `NAMES`."""
    available = {kind for kind in kinds if not lacks_package(kind)}
    files = tuple(NAMES[kind] for kind in NAMES if kind in available and kind != "html")
    page = render_html(analysis, files, _missing(kinds - available))
    render: dict[str, Callable[[], bytes]] = {
        "html": page.encode,
        "pdf": lambda: render_pdf(page),
        "summary": lambda: render_one_page(analysis).encode(),
        "summary_pdf": lambda: render_pdf(render_one_page(analysis)),
        "xlsx": lambda: render_workbook(analysis, samples),
        "json": lambda: render_json(analysis).encode(),
        "parquet": lambda: render_parquet(analysis),
    }
    return {kind: render[kind]() for kind in NAMES if kind in available}


def render_pdf(page: str) -> bytes:
    """Return the page as PDF on A4, without any request; ReportError if WeasyPrint's libraries are missing."""
    try:
        from weasyprint import HTML
    except OSError as error:
        raise ReportError(
            f"report.pdf: WeasyPrint finds no Pango ({error}); install it (Debian: libpango-1.0-0 libpangoft2-1.0-0)"
            " or leave the PDF out"
        ) from error
    # WeasyPrint logs every rule of the style sheet that applies to screens only.
    logging.getLogger("weasyprint").setLevel(logging.ERROR)
    content: bytes = HTML(string=page, url_fetcher=_refuse).write_pdf()
    return content


def _refuse(url: str, *_: object, **__: object) -> dict[str, object]:
    """Refuse every request, because the page is self-contained."""
    raise ReportError(f"the page refers to {url[:80]}, but a report must not load anything from outside")


def lacks_package(kind: str) -> bool:
    """Return whether a kind of file needs a package that is not installed."""
    return kind in EXTRAS and find_spec(EXTRAS[kind][0]) is None


def _missing(kinds: set[str]) -> str:
    """Return how to install the packages of the omitted files."""
    hints = [f"{NAMES[kind]} needs pip install 'clearcap[{EXTRAS[kind][1]}]'" for kind in NAMES if kind in kinds]
    return f"Not written: {'; '.join(hints)}." if hints else ""


def _replace(path: Path, content: bytes) -> Path:
    """Write `content` to a temporary file and rename it, so that a reader sees either the old or the new file."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)  # files of mkstemp are readable by their owner only
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
    return path
