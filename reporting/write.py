"""Write the files of a report, each whole or not at all."""

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from reporting.analysis import analyse
from reporting.errors import ReportError
from reporting.json import render_json
from reporting.spec import ReportSpec

if TYPE_CHECKING:
    import pyarrow


def write_report(table: "pyarrow.Table", spec: ReportSpec, folder: Path) -> dict[str, str]:
    """Analyse the samples and write `report.html` and `capability.json`.

    Both are rendered before the first is written, so an error leaves the folder as it was.

    Parameters
    ----------
    table : pyarrow.Table
        One row per finished sample, see `reporting.analysis.analyse`.
    spec : ReportSpec
        What was asked.
    folder : Path
        Where the files go; created if it does not exist.

    Returns
    -------
    dict of str to str
        Path of each file by kind: "html", "json".

    Raises
    ------
    ReportError
        The table does not fit the spec, or the folder cannot be written.
    """
    from reporting.html import render_html

    analysis = analyse(table, spec)
    texts = {
        "html": ("report.html", render_html(analysis)),
        "json": ("capability.json", render_json(analysis)),
    }
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return {kind: str(_replace(folder / name, text)) for kind, (name, text) in texts.items()}
    except OSError as error:
        raise ReportError(f"report folder {folder}: {error.strerror or error}; name a folder you may write") from error


def _replace(path: Path, text: str) -> Path:
    """Write `text` beside `path`, then rename: a reader sees the old file or the new one."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(name, 0o644)  # mkstemp's files are the writer's alone
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
    return path
