"""The documentation as a site: short how-tos, a bound of all words, no page left out, and a build without a warning."""

import re
import runpy
import subprocess
import sys

import pytest
from typer.main import get_command

from clearcap.cli import app
from tests.each import each
from tests.house import ROOT
from tests.test_docs import COMMANDS, PAGES

DOCS = {name: text for name, text in PAGES.items() if name.startswith("docs/")}
HOWTOS = sorted(name for name in DOCS if name.startswith("docs/howto/"))
MOST_WORDS = 47_500  # of those with a letter or digit: bars of tables, braces and signs of equations are none
SITE = runpy.run_path(str(ROOT / "docs" / "build_site.py"))


@each("name", HOWTOS)
def test_a_how_to_is_short(name):
    """60 to 200 words, a title, and a command whose verb and options exist."""
    text = DOCS[name]
    assert 60 <= len(text.split()) <= 200
    assert text.startswith("# ")
    assert set(re.findall(r"^    clearcap (.+)$", text, re.M)) & set(COMMANDS)


def test_all_words():
    """The docs have a bound: whoever adds a page cuts another."""
    words = [word for text in DOCS.values() for word in text.split() if re.search(r"[^\W_]", word)]
    assert len(words) <= MOST_WORDS


def test_the_index_has_every_page():
    """Each page of docs/ is in one section of the index, which is the navigation of the site."""
    names = SITE["pages"]()
    trees = list(SITE["contents"](names))
    assert [tree.split(":caption: ")[1].split("\n")[0] for tree in trees] == [
        *("Tutorials", "How-to guides", "Reference", "Explanation", "Project")
    ]
    entries = [line for tree in trees for line in tree.splitlines() if re.fullmatch(r"[\w/-]+", line)]
    assert len(entries) == len(set(entries))
    pages = {name.removesuffix(".md") for name in names.values()} - {"index"}
    assert pages <= set(entries)
    project = next(tree for tree in trees if "Project" in tree)
    assert not [page for page in DOCS if f"\n{page.removeprefix('docs/').removesuffix('.md')}\n" in project]


def test_links_are_those_of_the_site():
    """A page's relative links are moved with it; a link to a file that is no page becomes text; code stays."""
    names = SITE["pages"]()
    text = SITE["on_site"](ROOT / "docs" / "howto" / "step.md", names)
    assert "[" not in re.sub(r"\[[^\]]*\]\([^)]*\.md[^)]*\)|`[^`]*`", "", text)
    assert "](../ARCHITECTURE.md)" in PAGES["docs/README.md"]
    assert "](architecture.md)" in SITE["on_site"](ROOT / "docs" / "README.md", names)


def test_every_key_is_on_a_page():
    """The reference of a file has each table and key of its schema once."""
    schema = SITE["mechanism_schema"]()
    page = SITE["key_reference"]("Keys", "mechanism", schema)
    for name, table in schema["$defs"].items():
        if table.get("properties"):
            section = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
            assert re.findall(r"^\| `(\w+)` \|", section, re.M) == list(table["properties"])


def test_every_option_is_on_a_page():
    """The reference of the command has each verb, and each of its options with a meaning."""
    page = SITE["command_reference"]()
    for words in ("run", "simulate", "mechanism import", "serve"):
        section = page.split(f"\n## clearcap {words}\n")[1].split("\n## ")[0]
        command = get_command(app)
        for word in words.split():
            command = command.commands[word]
        options = {name for parameter in command.params for name in parameter.opts if name.startswith("--")}
        assert options <= set(re.findall(r"`(--[\w-]+)`", section))
    assert re.findall(r"^\| `--[^|]+ \|  \|$", page, re.M) == []
    assert page.count("\n## ") == len(re.findall(r"^## clearcap ", page, re.M)) > 30


@pytest.mark.slow
@pytest.mark.processes
@pytest.mark.gate
def test_the_site_builds(tmp_path):
    """No warning, so no link without a target; names, keys and how-tos are found; no code that the policy forbids."""
    site = tmp_path / "site"
    done = subprocess.run([sys.executable, ROOT / "docs" / "build_site.py", site], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    index = (site / "searchindex.js").read_text("utf-8")
    assert all(
        f'"{page}"' in index
        for page in (
            "howto/step",
            "reference/command",
            "reference/http-api",
            "reference/python",
            "reference/mechanism-keys",
        )
    )
    assert "clearcap.Results.advise" in (site / "reference" / "python.html").read_text("utf-8")
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    forbidden = re.compile(r"<script>|<style>|\son\w+=\"|(?:src|href)=\"https?://[^\"]*\.(?:js|css)\"")
    assert [page.name for page in pages if forbidden.search(page.read_text("utf-8"))] == []
