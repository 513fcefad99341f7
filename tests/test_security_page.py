"""What docs/security.md says of paths, options, variables, limits and ports is so."""

import re
from pathlib import Path

import pytest
from typer.main import get_command

from campaign.cluster import local, tls_certificates
from campaign.spec import named_files, parquet_columns
from campaign.store import measured_library
from campaign.store.files import files
from campaign.store.store import LARGEST_DOCUMENT
from clearcap.cli import app
from clearcap.questions import measured, measurement_table
from engine.cad import ReadingLimits
from engine.mechanism import expression
from engine.platform import toml_file
from tests.each import each

ROOT = Path(__file__).parents[1]
PAGE = " ".join((ROOT / "docs/security.md").read_text("utf-8").split())
CODE = sorted(set(re.findall(r"`([^`]+)`", PAGE)))
SOURCES = "".join(
    path.read_text("utf-8")
    for folder in ("engine", "campaign", "deploy")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.is_file() and "__pycache__" not in path.parts
)


def verbs():
    """Return every verb, and all options of all verbs."""
    commands = get_command(app).commands
    return set(commands), {option for command in commands.values() for p in command.params for option in p.opts}


def test_what_is_in_code():
    """The pattern finds what the tests below look at."""
    assert {"--insecure", "NUMBA_CACHE_DIR", "clearcap run", "deploy/"} <= set(CODE)


@each("code", [code for code in CODE if code.startswith(("clearcap ", "--"))])
def test_commands(code):
    """Verbs and options exist."""
    known, options = verbs()
    words = code.removeprefix("clearcap ").split()
    assert words[0].startswith("--") or words[0] in known
    assert {word for word in words if word.startswith("--")} <= options


@pytest.mark.parametrize("name", [code for code in CODE if re.fullmatch(r"[A-Z][A-Z_]+", code)])
def test_variables(name):
    """Variables of the environment are read by some program."""
    assert name in SOURCES


@pytest.mark.parametrize("verb", [code.removeprefix("make ") for code in CODE if code.startswith("make ")])
def test_verbs_of_make(verb):
    """They are in the Makefile."""
    assert re.search(rf"^{verb}:", (ROOT / "Makefile").read_text(), re.M)


def test_limits():
    """Limits are those of the code."""
    cad = ReadingLimits()
    limits = [
        f"{toml_file.LARGEST // 10**6} MB, keys of {toml_file.MOST_PARTS} parts, {toml_file.MOST_NESTED} levels,"
        f" {toml_file.MOST_TABLES} keys, words and numbers of {toml_file.LONGEST_WORD} characters",
        f"{expression.LONGEST} characters, {expression.DEEPEST} levels",
        f"{named_files.LARGEST_FILE // 10**6} MB, {parquet_columns.MOST_ROWS} rows, {parquet_columns.MOST_COLUMNS}"
        f" columns; a separate process reads Parquet, with {named_files.LARGEST_DECODED >> 30} GiB of memory and"
        f" {named_files.LONGEST_READ:g} s",
        f"{cad.file_bytes >> 20} MiB; a separate process reads it, with {cad.memory_bytes >> 30} GiB of memory and"
        f" {cad.seconds} s",
        f"{named_files.MOST_FILES} files, {named_files.LARGEST_TOTAL // 10**6} MB in all",
        f"{measurement_table.LARGEST_TABLE // 10**6} MB, {measured.MOST_PARTS} parts, an Excel file"
        f" {measurement_table.LARGEST_UNPACKED // 10**6} MB unpacked; sent to a server"
        f" {measured_library.LARGEST_PARTS >> 20} MiB, {measured_library.MOST_TABLES} tables in a store",
        f"{files.LARGEST >> 20} MiB; state, lease and heartbeat {LARGEST_DOCUMENT >> 20} MiB each",
        f"at most {tls_certificates.LONGEST}",
        f"`{local.PREFIX}...`",
    ]
    for limit in limits:
        assert limit in PAGE


def test_each_promise_has_a_test():
    """The files that the page names as what holds the service to its promises are there."""
    named = [code for code in CODE if code.startswith("tests/")]
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_ports():
    """The scheduler's port is that of every descriptor which has a fixed one."""
    [port] = set(re.findall(r"--port(?: |\n +- |\", \")\"?(\d{2,})", SOURCES.replace('\\"', '"')) or ["none"])
    assert f"| {port} (in an allocation a random port), mutual TLS" in PAGE
    assert "scheduler --port 0 " in (ROOT / "deploy/batch/allocation.sh").read_text()


def test_the_way_to_report_has_no_address():
    """SECURITY.md names no e-mail address that nobody reads, and leads to the page."""
    text = (ROOT / "SECURITY.md").read_text("utf-8")
    assert "@" not in text
    assert "docs/security.md" in text
