"""The sessions of the docs, line by line: what a reader types gives what the page shows.

A page's blocks belong together. ``toml file=NAME`` is appended to a file, ``diff file=NAME`` changes lines of it, piece
by piece between empty lines; the files of docs/examples are there. ``console session`` holds commands, each followed
by what it prints; ``python session`` continues the Python of the blocks before. In what a command prints,
``...`` stands for anything, and a number may differ by a hundredth; real times, ids of campaigns, and numbers that are
all rounding are not compared.
"""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.each import each

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(\w+) (session|file=\S+)\n(.*?)^```", re.M | re.S)
# times, ids of campaigns, and what hangs on rounding, which is the processor's
VARYING = re.compile(
    r"(?<=wall_s = )\S+|(?<= in )\S+(?= s\b)|(?<=-)[0-9a-f]{10}\b"
    r"|(?<=max_residual = )\S+|(?<=max_penetration = )\S+|(?<=created_energy = )\S+|(?<=iterations = )\S+"
)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if BLOCK.search(page.read_text("utf-8"))
]


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.gate] * (page.stem == "README"), id=page.stem) for page in PAGES]
)
def test_session(page, tmp_path, monkeypatch, capsys):
    """Every block of a page works in the order of the page."""
    monkeypatch.chdir(tmp_path)
    for example in (ROOT / "docs" / "examples").glob("*.*"):
        shutil.copy(example, tmp_path)
    names = {}
    for language, mark, text in BLOCK.findall(page.read_text("utf-8")):
        if language == "diff":
            path = Path(mark.removeprefix("file="))
            path.write_text(changed(path.read_text(), text))
        elif mark.startswith("file="):
            with Path(mark.removeprefix("file=")).open("a") as file:
                file.write(text)
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)
            assert capsys.readouterr().out.splitlines() == re.findall(r"# prints (.*)$", text, re.M)
        else:
            for command, expected in commands(text):
                printed = output_of(command)
                assert is_shown(expected, printed), f"$ {command}\n{printed}\nthe page shows:\n{expected}"


def changed(text, diff):
    """Return a text with the pieces of a diff applied; each fits in one place."""
    for piece in re.split(r"\n\n+", diff.strip("\n")):
        lines = piece.splitlines()
        old = "".join(f"{line[1:]}\n" for line in lines if line[0] in " -")
        new = "".join(f"{line[1:]}\n" for line in lines if line[0] in " +")
        assert text.count(old) == 1, f"{old!r} is in the file {text.count(old)} times"
        text = text.replace(old, new)
    return text


def test_changed():
    """A diff must fit."""
    assert changed("a\nb\nc\nd\n", " a\n-b\n+x\n+y\n\n-d\n") == "a\nx\ny\nc\n"
    with pytest.raises(AssertionError, match="2 times"):
        changed("a\nb\na\n", "-a\n")


def commands(text):
    """Return the commands of a console block, each with the lines that the page shows after it."""
    parts = re.split(r"^\$ ", text, flags=re.M)
    return [(part.partition("\n")[0], part.partition("\n")[2]) for part in parts if part.strip()]


def output_of(command):
    """Return what a command prints; it must succeed."""
    words = shlex.split(command, comments=True)
    assert words[0] == "clearcap", f"{words[0]} is no command of this project"
    run = subprocess.run([sys.executable, "-P", "-m", "clearcap", *words[1:]], capture_output=True, text=True)
    assert run.returncode == 0, f"$ {command}\n{run.stderr}"
    return run.stdout


def is_shown(expected, printed):
    """Return whether a text is what a page shows."""
    expected, printed = (VARYING.sub("*", text) for text in (expected, printed))
    pattern = r"\s+".join(map(_token, expected.split())).replace(r".*?\s+", r".*?\s*")
    match = re.fullmatch(rf"\s*{pattern}\s*", printed, re.S)
    numbers = [float(text) for token in expected.split() for text in NUMBER.findall(token) if "..." not in token]
    return match is not None and all(
        abs(float(found) - shown) <= max(0.01 * abs(shown), 1e-12)
        for found, shown in zip(match.groups(), numbers, strict=True)
    )


def _token(token):
    """Return the pattern of a word: its numbers are groups, and three dots are anything."""
    if "..." in token:
        return ".*?".join(map(re.escape, token.split("...")))
    pieces = NUMBER.split(token)
    return f"({NUMBER.pattern})".join(map(re.escape, pieces))


@each(
    ("expected", "printed", "is_same"),
    [
        ("force 1.27 N\n", "force  1.266 N\n", True),
        ("force 1.27 N\n", "force  1.2 N\n", False),
        ("force 1.27 N\n", "lift  1.27 N\n", False),
        ("ok\n...\nrepeated = 0\n", "ok\nsteps = 3\nwall = 2e-3\nrepeated = 0\n", True),
        ("ok\n", "ok\nmore\n", False),
        ("a ... 1.2 (...) ... 3.4\n", "a    1.2 (0 to 9)   3.4\n", True),
        ("a ... 1.2 (...) ... 3.4\n", "a    1.3 (0 to 9)   3.4\n", False),
        ("report: .../report.html\n", "report: /tmp/x/report.html\n", True),
        ("time 1e-3\n", "time 0.001\n", True),
        ("c60-fcbae707b3: 2 in 22.3 s\n", "c60-10616bd7f6: 2 in 7 s\n", True),
        ("c60-fcbae707b3: 2 in 22.3 s\n", "c60-10616bd7f6: 3 in 7 s\n", False),
    ],
)
def test_shown(expected, printed, is_same):
    """The comparison sees another word, a line too many, and a number that is off by more than a hundredth."""
    assert is_shown(expected, printed) is is_same
