"""What the wheel brings for pages: scripts of others with their licences, as they were made; no Python loads them."""

import hashlib
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
STATIC = ROOT / "clearcap" / "import_page" / "static"
THREE = "b29411bbb018946af275a4233de35909d51aaba3cbf36ce519b109da4b10bbd7"
FORBIDDEN = ("eval(", "new Function", "importScripts", "XMLHttpRequest", "fetch(", "WebSocket", "innerHTML", "</script")


@pytest.fixture(scope="module")
def in_wheel():
    """Return the files besides modules that the wheel has by `[tool.setuptools.package-data]`."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    patterns = [(ROOT.joinpath(*package.split(".")), each) for package, globs in table.items() for each in globs]
    return {path.relative_to(ROOT).as_posix() for folder, glob in patterns for path in folder.glob(glob)}


@pytest.mark.parametrize(
    "path",
    [
        "clearcap/import_page/static/three.min.js",
        "clearcap/import_page/static/three.LICENSE.txt",
        "clearcap/import_page/static/import_page.js",
        "clearcap/import_page/static/mechanism_text.js",
        "clearcap/import_page/static/answers.js",
        "clearcap/import_page/static/import_page.css",
        "clearcap/import_page/templates/import_page.html.j2",
        "clearcap/web/pages/static/htmx.min.js",
        "clearcap/web/pages/static/htmx.LICENSE.txt",
    ],
)
def test_it_is_in_the_wheel(in_wheel, path):
    """As package data of its folder."""
    assert path in in_wheel
    assert (ROOT / path).parent.with_name("__init__.py").exists()


def test_three_is_what_was_made():
    """Its bytes are those that the licence file says how to make, and the licence is in both."""
    content = (STATIC / "three.min.js").read_bytes()
    assert hashlib.sha256(content).hexdigest() == THREE
    licence = (STATIC / "three.LICENSE.txt").read_text()
    assert "three.js 0.187.0" in licence
    assert "three.js 0.187.0" in content[:100].decode()
    terms = licence[licence.index("The MIT License") :].strip()
    assert terms in content[:2000].decode()


@pytest.mark.parametrize("name", ["three.min.js", "import_page.js", "mechanism_text.js", "answers.js"])
def test_scripts_run_no_text_and_ask_nobody(name):
    """They make no code of texts and no requests."""
    content = (STATIC / name).read_text()
    assert [word for word in FORBIDDEN if word in content] == []


@pytest.mark.processes
def test_python_code_does_without():
    """Neither `import clearcap` nor the command's own modules load what draws the page."""
    code = (
        "import sys, clearcap, clearcap.cli\n"
        "print([m for m in sys.modules if m.startswith(('clearcap.import_page', 'clearcap.pictures', 'matplotlib'))])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert ran.stdout.strip() == "[]", ran.stderr
