"""What the pages show works: marked examples run, links have targets, commands and options exist, tables are readable.

An example is marked by the word `runnable` after the language of its fence. Pages with tests of their own
(`tests/campaign`, `tests/engine/mechanism`, `tests/reporting`) have no marks.
"""

import re
import tomllib
from functools import cache
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from campaign.spec.load import load_campaign
from clearcap.cli import app
from engine.mechanism import mechanism_from
from tests.each import each

ROOT = Path(__file__).parents[1]
PAGES = {
    page.relative_to(ROOT).as_posix(): page.read_text("utf-8")
    for pattern in ("*.md", "docs/**/*.md", "deploy/*.md", "studies/*.md")
    for page in sorted(ROOT.glob(pattern))
}
EXAMPLES = [
    pytest.param(language, code, id=f"{name}-{number}")
    for name, text in PAGES.items()
    for number, (language, code) in enumerate(re.findall(r"^```(\w+) runnable\n(.*?)^```", text, re.M | re.S))
]
LINKS = [
    (name, link) for name, text in PAGES.items() for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link
]
COMMANDS = sorted({line for text in PAGES.values() for line in re.findall(r"^(?:    |\$ )clearcap (.+)$", text, re.M)})


def test_patterns_find_examples_links_and_commands():
    """The patterns above match what the pages contain."""
    assert {"README.md", "ARCHITECTURE.md", "docs/README.md"} <= set(PAGES)
    assert {example.values[0] for example in EXAMPLES} == {"python", "toml"}
    assert ("README.md", "docs/images/report.png") in LINKS
    assert {"run", "simulate", "status"} <= {command.split()[0] for command in COMMANDS}


@pytest.mark.parametrize(("language", "code"), EXAMPLES)
def test_example(language, code, tmp_path, capsys):
    """Python prints what its last comment says; TOML is a campaign or a mechanism."""
    if language == "python":
        exec(compile(code, "example", "exec"), {})
        expected = re.search(r"# prints (.*)$", code, re.M)
        assert capsys.readouterr().out.strip() == expected[1]
    elif "mechanism" in (data := tomllib.loads(code)):
        path = tmp_path / "example.toml"
        path.write_text(code)
        assert load_campaign(str(path)).spec.name == data["name"]
    else:
        assert mechanism_from(data, "example").name == data["name"]


@each(("page", "link"), LINKS)
def test_link(page, link):
    """The file of a relative link exists, and has the heading after its `#`."""
    path, _, anchor = link.partition("#")
    target = (ROOT / page).parent / path if path else ROOT / page
    assert target.exists()
    if anchor:
        headings = re.findall(r"^#+ (.+)$", target.read_text("utf-8"), re.M)
        assert anchor in {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_modules_named_exist():
    """Every module that a page names is there, by its path or the end of it; the history names former ones."""
    there = {f"/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("[a-z]*/**/*.py")}
    named = {(page, name) for page, text in PAGES.items() for name in re.findall(r"`([\w/]+\.py)`", text)}
    assert len(named) > 50
    gone = [(page, name) for page, name in named if not any(path.endswith(f"/{name}") for path in there)]
    assert sorted(each for each in gone if each[0] != "CHANGELOG.md") == []


def test_table_cells_are_short():
    """No table cell has more than 250 characters: longer explanations are text or a list."""
    cells = ((name, cell) for name, text in PAGES.items() if name != "ARCHITECTURE.md" for cell in _cells(text))
    assert [(name, cell) for name, cell in cells if len(cell) > 250] == []


def _cells(text):
    rows = re.findall(r"^ *\|.*\|$", text, re.M)
    return [cell.strip() for row in rows for cell in row.split("|")]


@cache
def exit_code_of_help(*path):
    """Return how a verb's help ends: most verbs are shown several times."""
    return CliRunner().invoke(app, [*path, "--help"]).exit_code


@each("line", COMMANDS)
def test_command(line):
    """Every verb shown prints its help, and has every option shown."""
    words, command = re.split(r"\s{2,}|#", line)[0].split(), get_command(app)  # two spaces begin the explanation
    path = []
    while hasattr(command, "commands") and words[len(path)] in command.commands:
        path.append(words[len(path)])
        command = command.commands[path[-1]]
    assert path or words[0].startswith("--"), f"no such verb: {words[0]}"
    assert {word for word in words if word.startswith("--")} <= {o for p in command.params for o in p.opts}
    assert exit_code_of_help(*path) == 0


def test_notes_of_changes():
    """`make release` finds every file in changelog/: one of another ending would be left out without a word."""
    kinds = {
        kind["directory"] for kind in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["towncrier"]["type"]
    }
    notes = [path.name for path in (ROOT / "changelog").iterdir() if path.name != "README.md"]
    assert [name for name in notes if not re.fullmatch(rf"\+[a-z0-9-]+\.({'|'.join(kinds)})\.md", name)] == []


def test_make_targets():
    """Every `make` target that a page shows is in the Makefile."""
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(), re.M))
    shown = {verb for text in PAGES.values() for verb in re.findall(r"(?:^    |`|\$ )make ([a-z0-9-]+)", text, re.M)}
    assert {"run", "test"} <= shown <= targets


def test_make_run_says_how_to_go_on():
    """The end of `make run` prints how to have the command, and an example that the command takes."""
    recipe = (ROOT / "Makefile").read_text().split("\nrun: ")[1].split("\n\n")[0]
    after = recipe.split("--store runs\n")[1]
    assert "source $(VENV)/bin/activate" in after
    command = re.search(r"clearcap (.+?)\\n", after)[1]
    assert command in COMMANDS or any(line.startswith(command) for line in COMMANDS)


SIMULATIONS = [
    line for line in re.findall(r"^    clearcap (simulate .+)$", PAGES["docs/command.md"], re.M) if "MECH" not in line
]


@pytest.mark.slow
@pytest.mark.parametrize("line", SIMULATIONS)
def test_simulation_shown_succeeds(line, tmp_path, monkeypatch):
    """Each `simulate` of the page about the command ends with exit status 0 and writes what it names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("clearcap.pictures.animation.FRAMES", 3)
    words = line.split()
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    named = {word for word in words if Path(word).suffix in (".h5", ".svg", ".html", ".png")}
    assert named <= {path.name for path in tmp_path.iterdir()}


def test_fields_of_the_json_documents():
    """The page about the command names the fields of what `--json` prints, for verbs that print fields of their own."""
    page = PAGES["docs/command.md"]
    sections = dict(re.findall(r"^## ([a-z ]+)\n(.*?)(?=^## |\Z)", page, re.M | re.S))
    shown = {
        "simulate": ("status", "message", "responses", "units", "ranges", "remarks", "certificate", "files"),
        "status": (
            "campaign",
            "store",
            "state",
            "message",
            "since",
            "open",
            "fault",
            "samples",
            "done",
            "ok",
            "failed",
        ),
        "list": ("campaign", "title", "samples", "done", "failed", "left", "state", "when", "differs", "fault"),
        "delete": ("campaign", "store", "rows"),
        "rerun": ("campaign", "store", "samples", "before", "after"),
    }
    missing = [(verb, name) for verb, names in shown.items() for name in names if f'"{name}"' not in sections[verb]]
    assert missing == []
